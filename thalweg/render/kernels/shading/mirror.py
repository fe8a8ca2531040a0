"""Kernel for what rippled water mirrors below the sky: woods, banks and bridges, by a march over the map of canopies.

A mirrored ray is followed in growing steps until it runs below a canopy; the last step is then halved a few times. The
edge of a canopy is softened by the ripples that are too small to be seen, more with distance. What is met has the
colour of its crown, darker towards the foot, with the grain of leaves. `thalweg.render.bake.canopy` makes the map.

Absent on purpose: trunks below a crown and the openings of bridges, since all that is met reaches down to the ground.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.jit import kernel
from thalweg.render.kernels.fast_math import exp
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.table_lookup import channel, clamp, mix_texels
from thalweg.render.records import layout
from thalweg.render.records.appearance import HAZE_PER_M

f32 = np.float32

STEPS = 28
FIRST_M = 0.3
GROWTH = 1.22
"""Steps of a mirrored ray: their number, the first distance, and the factor from one to the next (64 m in all)."""
HALVINGS = 3
"""Halvings of the step within which a ray runs below a canopy."""
BLUR_M = 0.12
BLUR = 2.4
"""The edge of a canopy is softened over this height, and this times the distance and the ripples' root mean square
slope: a slope turns the mirrored ray by twice itself."""
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


class Mirrored(NamedTuple):
    """What mirrored rays meet below the sky, arrays [n] float32."""

    passing: Any
    """Share of the sky behind the canopies."""
    red: Any
    """Radiance of the canopies, haze included, as the next two."""
    green: Any
    blue: Any


@kernel(inlined=True, allocates=False)
def canopy_height(canopy, at, columns, rows, x, y):
    """Return the height of the canopy above the water in metres at cell coordinates x, y."""
    x = clamp(x, f32(0), f32(columns) - f32(1.001))
    y = clamp(y, f32(0), f32(rows) - f32(1.001))
    column = int32(x)
    row = int32(y)
    u = x - f32(column)
    v = y - f32(row)
    # One texel holds the heights of all four cells around the point.
    four = canopy[uint32(at + row * columns + column)]
    a = channel(four, 0)
    b = channel(four, 8)
    c = channel(four, 16)
    d = channel(four, 24)
    low = a + (b - a) * u
    high = c + (d - c) * u
    code = low + (high - low) * v
    return code * code * f32(layout.CANOPY_RANGE_M / 255.0**2)


@kernel(disjoint=True, allocates=False)
def mirror_canopy(scene, view, points, pixel, surface, mirrored, met_at, n):
    """Fill `Mirrored` [n] with what the mirrored rays of a `water.Surface` at `HitPoints` meet.

    pixel: height of a pixel at distance one; met_at [n] is scratch.
    """
    x, y, _, _, _, _, distance = points
    _, _, spread, _, rx, ry, rz = surface
    passing, red, green, blue = mirrored
    look = view.look
    columns = int32(scene.extents[view.world, layout.CANOPY_X])
    rows = int32(scene.extents[view.world, layout.CANOPY_Y])
    at = int32(scene.extents[view.world, layout.CANOPY_AT])
    fog_r = scene.constants[view.world, layout.FOG_R]
    fog_g = scene.constants[view.world, layout.FOG_G]
    fog_b = scene.constants[view.world, layout.FOG_B]
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    shrink = f32(1 / layout.CANOPY_CELL)
    offset = f32(0.5 / layout.CANOPY_CELL - 0.5)
    canopy = scene.canopy
    for i in range(n):
        met_at[i] = f32(FIRST_M)
        passing[i] = f32(1)
        # Free until colours are known: how fast the edges of canopies soften.
        red[i] = f32(BLUR) * math.sqrt(spread[i])
    # All pixels take the same steps together, so that the inner loop vectorises.
    s = f32(FIRST_M)
    for _ in range(STEPS):
        reach = s * inv_cell * shrink
        for i in range(n):
            height = canopy_height(
                canopy, at, columns, rows,
                x[i] * shrink + offset + rx[i] * reach, y[i] * shrink + offset + ry[i] * reach,
            )  # fmt: skip
            # How far the canopy rises above the ray is how much of it is met; the first to be met in full hides others.
            left = f32(1) - clamp((height - rz[i] * s) / (f32(BLUR_M) + red[i] * s), f32(0), f32(1))
            nearer = left < passing[i]
            met_at[i] = s if nearer else met_at[i]
            passing[i] = left if nearer else passing[i]
        s = s * f32(GROWTH)
    halve_steps(scene, view, points, surface, mirrored, met_at, n)
    scale = f32(layout.PAINT_RANGE / 255.0**2)
    cell = f32(1) / inv_cell
    for i in range(n):
        s = met_at[i]
        px = x[i] + rx[i] * s * inv_cell
        py = y[i] + ry[i] * s * inv_cell
        z = rz[i] * s
        r, g, b, tall = canopy_texel(scene.canopy_paint, at, columns, rows, px * shrink + offset, py * shrink + offset)
        # A wall of leaves is upright: its height moves the point across the tile of grain too.
        grain = tile_grain(
            scene.ripples, px * cell + f32(0.5) * z, py * cell + f32(0.8) * z, (distance[i] + s) * pixel, f32(LEAVES_M)
        )
        contrast = f32(LEAVES) * min(tall * f32(LEAFY), f32(1)) / (f32(1) + s * f32(1 / LEAVES_FADE_M))
        # Ground has no plant's height, so that it is as bright at the foot as above.
        rise = min((z + f32(1e-3)) / (tall * tall * f32(layout.CANOPY_RANGE_M / 255.0**2) + f32(1e-3)), f32(1))
        light = max(f32(1) + contrast * grain, f32(0.2)) * (f32(FOOT_LIGHT) + f32(1 - FOOT_LIGHT) * rise)
        clear = exp(-s * look[HAZE_PER_M])
        part = (f32(1) - passing[i]) * clear * light * scale
        haze = (f32(1) - passing[i]) * (f32(1) - clear)
        red[i] = r * r * part + fog_r * haze
        green[i] = g * g * part + fog_g * haze
        blue[i] = b * b * part + fog_b * haze


@kernel(disjoint=True, allocates=False)
def halve_steps(scene, view, points, surface, mirrored, met_at, n):
    """Move met_at [n] to where each ray comes to lie below the canopy in full, by halving the step that led there."""
    x, y, _, _, _, _, _ = points
    _, _, _, _, rx, ry, rz = surface
    passing, soft, length, _ = mirrored
    columns = int32(scene.extents[view.world, layout.CANOPY_X])
    rows = int32(scene.extents[view.world, layout.CANOPY_Y])
    at = int32(scene.extents[view.world, layout.CANOPY_AT])
    shrink = f32(1 / layout.CANOPY_CELL)
    offset = f32(0.5 / layout.CANOPY_CELL - 0.5)
    step = scene.constants[view.world, layout.INV_CELL] * shrink
    canopy = scene.canopy
    for i in range(n):
        # An edge that is met in part was met nowhere in full: its step is the best that is known.
        length[i] = met_at[i] * f32(1 - 1 / GROWTH) if passing[i] <= f32(0) else f32(0)
    for _ in range(HALVINGS):
        for i in range(n):
            length[i] *= f32(0.5)
            s = met_at[i] - length[i]
            height = canopy_height(
                canopy, at, columns, rows,
                x[i] * shrink + offset + rx[i] * s * step, y[i] * shrink + offset + ry[i] * s * step,
            )  # fmt: skip
            met_at[i] = s if height - rz[i] * s >= f32(BLUR_M) + soft[i] * s else met_at[i]


@kernel(inlined=True, allocates=False)
def canopy_texel(paint, at, columns, rows, x, y):
    """Return the four channels (0..255) of the canopy's paint at cell coordinates, interpolated."""
    x = clamp(x, f32(0), f32(columns) - f32(1.001))
    y = clamp(y, f32(0), f32(rows) - f32(1.001))
    column = int32(x)
    row = int32(y)
    k = at + row * columns + column
    return mix_texels(
        paint[uint32(k)],
        paint[uint32(k + 1)],
        paint[uint32(k + columns)],
        paint[uint32(k + columns + 1)],
        x - f32(column),
        y - f32(row),
    )
