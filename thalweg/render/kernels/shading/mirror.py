"""Kernel for what rippled water mirrors below the sky: woods, banks and bridges, by a march over the map of canopies.

A mirrored ray is followed in growing steps; where it meets a canopy, the step is halved a few times. The edge of a
canopy is softened by the ripples that are too small to be seen, more with distance, so that a ray sees up to two of
them: a low bank, say, and the wood behind it. What is met has the colour of its crown, darker towards the foot, with
the grain of leaves. `thalweg.render.bake.canopy` makes the map.

Absent on purpose: trunks below a crown and the openings of bridges, since all that is met reaches down to the ground.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.fast_math import exp
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.shading.water_optics import ROUGHNESS
from thalweg.render.kernels.table_lookup import channel, clamp, mix_texels
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M

f32 = np.float32

STEPS = 22
FIRST_M = 0.35
GROWTH = 1.28
"""Steps of a mirrored ray: their number, the first distance, and the factor from one to the next (62 m in all)."""
TOGETHER = 4
"""Steps between two checks whether any ray is still under way."""
HALVINGS = 3
"""Halvings of the step within which a ray meets a canopy."""
BLUR_M = 0.12
BLUR = 0.068
"""The edge of a canopy is softened over this height, and this times the distance from the water: ripples too small for
the tile."""
SPREAD_BLUR = 4.9
"""Height of the edge at distance one per root mean square slope, of both axes, of the ripples that filtering took away:
a slope turns the mirrored ray by twice itself, and a ramp is the root of 12 times as wide as its deviation."""
FOOT_LIGHT = 0.50
"""Share of its radiance that is left at the foot of a plant."""
LEAVES_M = 4.1
"""Side of the tile of grain that stands for leaves."""
LEAVES = 0.34
"""Contrast of the leaves' brightness close to the water's edge."""
LEAVES_FADE_M = 14.0
"""Distance from the water at which ripples have halved that contrast."""
LEAFY = 0.02
"""Factor on the code of a plant's height up to which its grain grows, so that the ground has none."""


class CanopyMap(NamedTuple):
    """Where a world's map of canopies lies, and how node coordinates become its cell coordinates."""

    at: Any
    """Index at which it begins in `Scene.canopy` and `Scene.canopy_paint`, int32, as the next two: its size."""
    columns: Any
    rows: Any
    shrink: Any
    """Cells per node."""
    offset: Any
    """Cell coordinate of the first node."""


class Mirrored(NamedTuple):
    """What mirrored rays meet below the sky, arrays [n] float32."""

    passing: Any
    """Share of the sky behind the canopies."""
    red: Any
    """Radiance of the canopies, haze included, as the next two."""
    green: Any
    blue: Any


@kernel(inlined=True, allocates=False)
def canopy_map(scene, world):
    """Return the `CanopyMap` of a world."""
    return CanopyMap(
        int32(scene.extents[world, layout.CANOPY_AT]),
        int32(scene.extents[world, layout.CANOPY_X]),
        int32(scene.extents[world, layout.CANOPY_Y]),
        f32(1 / layout.CANOPY_CELL),
        f32(0.5 / layout.CANOPY_CELL - 0.5),
    )


@kernel(inlined=True, allocates=False)
def canopy_height(canopy, cells, x, y):
    """Return the height of the canopy above the water in metres at cell coordinates x, y of a `CanopyMap`."""
    x = clamp(x, f32(0), f32(cells.columns) - f32(1.001))
    y = clamp(y, f32(0), f32(cells.rows) - f32(1.001))
    column = int32(x)
    row = int32(y)
    u = x - f32(column)
    v = y - f32(row)
    # One texel holds the heights of all four cells around the point.
    four = canopy[uint32(cells.at + row * cells.columns + column)]
    a = channel(four, 0)
    b = channel(four, 8)
    c = channel(four, 16)
    d = channel(four, 24)
    low = a + (b - a) * u
    high = c + (d - c) * u
    code = low + (high - low) * v
    return code * code * f32(layout.CANOPY_RANGE_M / 255.0**2)


@kernel(disjoint=True, allocates=False)
def mirror_canopy(scene, view, points, pixel, surface, mirrored, scratch, n):
    """Fill `Mirrored` [n] with what the mirrored rays of a `water.Surface` at `HitPoints` meet.

    pixel: height of a pixel at distance one; scratch: a `Radiance` [n].
    """
    # The arrays of the result hold other things until the last pass.
    near, near_at, far, far_at = mirrored.passing, scratch.red, scratch.green, scratch.blue
    march_canopy(scene, view, points, pixel, surface, mirrored, scratch, n)
    halve_steps(scene, view, points, surface, near, near_at, mirrored.blue, n)
    halve_steps(scene, view, points, surface, far, far_at, mirrored.blue, n)
    colour_canopy(scene, view, points, pixel, surface, mirrored, scratch, n)


@kernel(disjoint=True, allocates=False)
def march_canopy(scene, view, points, pixel, surface, mirrored, scratch, n):
    """Find the first two canopies on each mirrored ray: the shares of light that they stop, and their distances.

    Both are written to the arrays that `mirror_canopy` names.
    """
    x, y, _, _, _, _, distance = points
    _, _, spread, _, rx, ry, rz = surface
    near, soft_at_water, softening, _ = mirrored
    near_at, far, far_at = scratch
    cells = canopy_map(scene, view.world)
    shrink, offset = cells.shrink, cells.offset
    step = scene.constants[view.world, layout.INV_CELL] * shrink
    canopy = scene.canopy
    for i in range(n):
        near[i] = f32(0)
        near_at[i] = f32(FIRST_M)
        # Less than nothing: the first canopy is not passed yet.
        far[i] = f32(-1)
        far_at[i] = f32(FIRST_M)
        lost = max(spread[i] - f32(ROUGHNESS), f32(0))
        # A pixel's own height softens edges too.
        softening[i] = math.sqrt(f32(SPREAD_BLUR**2) * lost + f32(BLUR**2)) + pixel
        soft_at_water[i] = f32(BLUR_M) + distance[i] * pixel
    # All pixels take the same steps together, so that the inner loop vectorises.
    s = f32(FIRST_M)
    for k in range(STEPS):
        if k % TOGETHER == 0 and k > 0:
            most = f32(0)
            for i in range(n):
                most = max(most, f32(1) - max(near[i], far[i]))
            # Nothing is seen behind what stops all light, so that this changes no bit.
            if most <= f32(0):
                break
        reach = s * step
        for i in range(n):
            height = canopy_height(
                canopy, cells,
                x[i] * shrink + offset + rx[i] * reach, y[i] * shrink + offset + ry[i] * reach,
            )  # fmt: skip
            # Half of the light is stopped where a ray meets the top. What is low has a sharper edge, so that water does
            # not mirror itself.
            soft = min(soft_at_water[i] + softening[i] * s, f32(2) * height) + f32(1e-3)
            share = clamp(f32(0.5) + (height - rz[i] * s) / soft, f32(0), f32(1))
            # The first canopy ends where the ray leaves it again.
            first = far[i] < f32(0)
            to_near = first & (share > near[i])
            to_far = (share > far[i]) & ((not first) | (share < near[i]))
            near_at[i] = s if to_near else near_at[i]
            near[i] = share if to_near else near[i]
            far_at[i] = s if to_far else far_at[i]
            far[i] = share if to_far else far[i]
        s = s * f32(GROWTH)


@kernel(disjoint=True, allocates=False)
def halve_steps(scene, view, points, surface, share, met_at, length, n):
    """Move met_at [n] to where each ray meets the canopy, by halving the step that led there.

    share [n]: share of light that the canopy stops; length [n] is scratch.
    """
    x, y, _, _, _, _, _ = points
    _, _, _, _, rx, ry, rz = surface
    cells = canopy_map(scene, view.world)
    shrink, offset = cells.shrink, cells.offset
    step = scene.constants[view.world, layout.INV_CELL] * shrink
    canopy = scene.canopy
    for i in range(n):
        # A ray that only grazes an edge meets no top: the step nearest to one is the best that is known.
        length[i] = met_at[i] * f32(1 - 1 / GROWTH) if share[i] >= f32(0.5) else f32(0)
    for _ in range(HALVINGS):
        for i in range(n):
            length[i] *= f32(0.5)
            s = met_at[i] - length[i]
            height = canopy_height(
                canopy, cells,
                x[i] * shrink + offset + rx[i] * s * step, y[i] * shrink + offset + ry[i] * s * step,
            )  # fmt: skip
            met_at[i] = s if height >= rz[i] * s else met_at[i]


@kernel(disjoint=True, allocates=False)
def colour_canopy(scene, view, points, pixel, surface, mirrored, scratch, n):
    """Turn what `march_canopy` found into `Mirrored` [n]."""
    x, y, _, _, _, _, distance = points
    _, _, _, _, rx, ry, rz = surface
    passing, red, green, blue = mirrored
    near_at, far, far_at = scratch
    fog_r = scene.constants[view.world, layout.FOG_R]
    fog_g = scene.constants[view.world, layout.FOG_G]
    fog_b = scene.constants[view.world, layout.FOG_B]
    haze_per_m = view.look[HAZE_PER_M]
    for i in range(n):
        near = passing[i]
        behind = max(far[i], f32(0)) * (f32(1) - near)
        r0, g0, b0 = canopy_radiance(scene, view.world, x[i], y[i], rx[i], ry[i], rz[i], near_at[i], distance[i], pixel)
        r1, g1, b1 = canopy_radiance(scene, view.world, x[i], y[i], rx[i], ry[i], rz[i], far_at[i], distance[i], pixel)
        clear_near = near * exp(-near_at[i] * haze_per_m)
        clear_far = behind * exp(-far_at[i] * haze_per_m)
        haze = near + behind - clear_near - clear_far
        passing[i] = f32(1) - near - behind
        red[i] = r0 * clear_near + r1 * clear_far + fog_r * haze
        green[i] = g0 * clear_near + g1 * clear_far + fog_g * haze
        blue[i] = b0 * clear_near + b1 * clear_far + fog_b * haze


@kernel(inlined=True, allocates=False)
def canopy_radiance(scene, world, x, y, rx, ry, rz, s, distance, pixel):
    """Return the radiance (red, green, blue) of the canopy where a mirrored ray meets it at the distance s.

    The ray leaves the water at node coordinates x, y in the unit direction rx, ry, rz, seen from a distance.
    """
    cells = canopy_map(scene, world)
    inv_cell = scene.constants[world, layout.INV_CELL]
    cell = f32(1) / inv_cell
    x += rx * s * inv_cell
    y += ry * s * inv_cell
    z = rz * s
    r, g, b, tall = canopy_texel(
        scene.canopy_paint, cells, x * cells.shrink + cells.offset, y * cells.shrink + cells.offset
    )
    # A wall of leaves is upright: its height moves the point across the tile of grain too.
    grain = tile_grain(
        scene.ripples, x * cell + f32(0.5) * z, y * cell + f32(0.8) * z, (distance + s) * pixel, f32(LEAVES_M)
    )
    contrast = f32(LEAVES) * min(tall * f32(LEAFY), f32(1)) / (f32(1) + s * f32(1 / LEAVES_FADE_M))
    # Ground has no plant's height, so that it is as bright at the foot as above.
    rise = min((z + f32(1e-3)) / (tall * tall * f32(layout.CANOPY_RANGE_M / 255.0**2) + f32(1e-3)), f32(1))
    light = max(f32(1) + contrast * grain, f32(0.2)) * (f32(FOOT_LIGHT) + f32(1 - FOOT_LIGHT) * rise)
    light *= f32(layout.PAINT_RANGE / 255.0**2)
    return r * r * light, g * g * light, b * b * light


@kernel(inlined=True, allocates=False)
def canopy_texel(paint, cells, x, y):
    """Return the four channels (0..255) of the canopy's paint at cell coordinates of a `CanopyMap`, interpolated."""
    x = clamp(x, f32(0), f32(cells.columns) - f32(1.001))
    y = clamp(y, f32(0), f32(cells.rows) - f32(1.001))
    column = int32(x)
    row = int32(y)
    k = cells.at + row * cells.columns + column
    return mix_texels(
        paint[uint32(k)],
        paint[uint32(k + 1)],
        paint[uint32(k + cells.columns)],
        paint[uint32(k + cells.columns + 1)],
        x - f32(column),
        y - f32(row),
    )
