"""Kernels that march rays over the height field of ground and water, many neighbouring rays at a time.

`SPAN` rays, of pixels or of squares, advance together, so that LLVM works on 8 or 16 of them at once. A ray's parameter
t counts metres along the optical axis. A step is the longest of three: what the cone above the cell allows (no surface
is met sooner; cone step mapping, Dummer 2006), a share of the height above the surface, and a least step that grows
with distance.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.table_lookup import (
    bilinear,
    clamp,
    corner_codes,
    depth_map,
    sloped,
    top_map,
    within_map,
)
from thalweg.render.records import layout

f32 = np.float32

MOST_STEPS = 160
LEAST_STEP_M = 0.10
LEAST_STEP_SHARE = 0.008
"""The least step is the greater of LEAST_STEP_M and this share of the distance."""
STEEPEST = 1.0
"""Slope of the ground that a step by height allows for."""
SPAN = 32
"""Rays that a CPU advances together: two of its widest vectors. With more, too many would wait for the slowest."""
SQUARE = 2
"""Pixels a side of the squares that share a march in the reduced quality."""
TILE = 8
"""Pixels a side of the bundles of rays that start together."""
BUNDLE_STEPS = 40
"""Most steps of a bundle."""
BUNDLE_LEAST_M = 0.25
"""A bundle whose next step is shorter than this is left to its rays."""
SETTLE_SHARE = 0.35
"""A ray whose length would differ from its square's by more than this share keeps the square's: it is at an edge or
near the horizon."""
FAR_M = 320.0
"""Ground farther than this is lost in the haze and drawn as the horizon."""


class Track(NamedTuple):
    """Scratch of a march, arrays [n] float32."""

    before: Any
    """t of the last point above the surface."""
    gap_before: Any
    """Height of that point above the surface."""
    gap_after: Any
    """Height of the first point below the surface, not above zero."""
    speed: Any
    """Horizontal metres per metre along the axis."""
    leave: Any
    """t at which a ray is above every summit or too far away."""


class Tangents(NamedTuple):
    """Planes that touch the surface where rays meet it, arrays [n] float32."""

    slope_x: Any
    """Rise in metres per node in x, and in y."""
    slope_y: Any
    gap: Any
    """Metres from the camera straight down to the plane."""


@kernel(inlined=True, allocates=False)
def bundle_spread(camera):
    """Return the greatest distance between a ray of a tile and that through its middle, in metres per metre of axis."""
    per_row = row_step(camera)
    # Half of a tile's diagonal, and a little more for the rounding of float32.
    return f32(0.501 * TILE) * math.sqrt(per_row * per_row + camera.column_step * camera.column_step)


@kernel(disjoint=True, allocates=False)
def advance_bundles(scene, world, origin, spread, rays, t, n):
    """Advance n bundles of rays from t [n] as far as certainly none of their rays meets the surface.

    rays: the middle ray of each bundle; spread: how far the other rays stray from it, in metres per metre along the
    axis.
    """
    dx, dy, dz = rays
    columns = int32(scene.extents[world, layout.GX])
    rows = int32(scene.extents[world, layout.GY])
    cone_columns = int32(scene.extents[world, layout.CONE_X])
    cone_at = int32(scene.extents[world, layout.CONE_AT])
    cell = f32(1) / scene.constants[world, layout.INV_CELL]
    cone = scene.cone
    for _ in range(BUNDLE_STEPS):
        # A float counter, because an integer one would break up the vectors of floats.
        active = f32(0)
        for i in range(n):
            ti = t[i]
            x = clamp(origin.x + dx[i] * ti, f32(0), f32(columns) - f32(1.001))
            y = clamp(origin.y + dy[i] * ti, f32(0), f32(rows) - f32(1.001))
            column = int32(x) // int32(layout.CONE_CELL)
            row = int32(y) // int32(layout.CONE_CELL)
            block = uint32(cone_at + int32(2) * (row * cone_columns + column))
            height = cone[block]
            slope = cone[block + uint32(1)]
            # The lowest ray may sink this fast, and the outermost may be so far from the middle one.
            sink = dz[i] - spread
            speed = math.sqrt(dx[i] * dx[i] + dy[i] * dy[i]) * cell + spread
            gap = origin.z + sink * ti - height - slope * spread * ti
            step = gap / max(slope * speed - sink, f32(1e-6))
            # Near the surface the cone of a whole tile is too wide to gain anything.
            onward = (step > f32(BUNDLE_LEAST_M)) & (ti < f32(FAR_M))
            t[i] = ti + step if onward else ti
            active += f32(1) if onward else f32(0)
        if active == f32(0):
            break


@kernel(disjoint=True, allocates=False)
def march(scene, world, origin, rays, t, hit, track, n):
    """Advance n rays from t [n] until they meet the surface (hit 1) or leave (hit 0); t becomes where they meet it.

    Each ray must be above the surface at the t where it starts. track: a `Track`.
    """
    dx, dy, dz = rays
    before, gap_before, gap_after, speed, leave = track
    cell = f32(1) / scene.constants[world, layout.INV_CELL]
    summit = scene.constants[world, layout.TOP_MAX]
    for i in range(n):
        speed[i] = math.sqrt(dx[i] * dx[i] + dy[i] * dy[i]) * cell + f32(1e-9)
        # Above the highest summit, a rising ray meets nothing any more.
        rising = (summit + f32(0.01) - origin.z) / max(dz[i], f32(1e-9))
        leave[i] = min(rising, f32(FAR_M)) if dz[i] > f32(0) else f32(FAR_M)
        # A gap of 1 stands for "above"; it is replaced at the first step.
        before[i] = t[i]
        gap_before[i] = f32(1)
        gap_after[i] = f32(0)
        hit[i] = f32(0)
    for _ in range(MOST_STEPS):
        if not step_rays(scene, world, origin, rays, t, hit, track, n):
            break
    refine_hits(scene, world, origin, rays, t, hit, track, n)


@kernel(inlined=True, allocates=False)
def step_rays(scene, world, origin, rays, t, hit, track, n):
    """Advance n rays of a march by one step each; returns whether any of them continues.

    There are no branches but selects, so that rays which have arrived cost nothing but their place in the vector.
    """
    dx, dy, dz = rays
    before, gap_before, gap_after, speed, leave = track
    top = top_map(scene, world)
    cone_columns = int32(scene.extents[world, layout.CONE_X])
    cone_at = int32(scene.extents[world, layout.CONE_AT])
    cone = scene.cone
    active = f32(0)
    for i in range(n):
        ti = t[i]
        x, y = within_map(top, origin.x + dx[i] * ti, origin.y + dy[i] * ti)
        z = origin.z + dz[i] * ti
        # As `table_lookup.bilinear`, whose row and column the cone map needs too.
        column = int32(x)
        row = int32(y)
        u = x - f32(column)
        v = y - f32(row)
        a, b, c, d = corner_codes(top, column, row)
        low = a + (b - a) * u
        high = c + (d - c) * u
        gap = z - (top.base + top.step * (low + (high - low) * v))
        cone_index = (row // int32(layout.CONE_CELL)) * cone_columns + column // int32(layout.CONE_CELL)
        block = uint32(cone_at + int32(2) * cone_index)
        # In these units a cone of slope s is left behind at the rate s * speed - dz.
        rate = max(cone[block + uint32(1)] * speed[i] - dz[i], f32(1e-6))
        by_cone = (z - cone[block]) / rate
        by_height = gap * f32(0.7) / max(f32(STEEPEST) * speed[i] - dz[i], f32(0.05))
        least = max(f32(LEAST_STEP_M), f32(LEAST_STEP_SHARE) * ti)
        running = (hit[i] == f32(0)) & (ti < leave[i])
        below = gap <= f32(0)
        met = running & below
        # The last point above is saved before each step: refinement needs both sides of the surface.
        onward = running & (gap > f32(0))
        hit[i] = f32(1) if met else hit[i]
        gap_after[i] = gap if met else gap_after[i]
        before[i] = ti if onward else before[i]
        gap_before[i] = gap if onward else gap_before[i]
        t[i] = ti + max(max(by_cone, by_height), least) if onward else ti
        active += f32(1) if onward else f32(0)
    return active != f32(0)


@kernel(inlined=True, allocates=False)
def refine_hits(scene, world, origin, rays, t, hit, track, n):
    """Move t [n] of the rays that met the surface to where they cross it, between their last two points."""
    dx, dy, dz = rays
    before, gap_before, gap_after, _, leave = track
    top = top_map(scene, world)
    for i in range(n):
        # The secant through the last point above and the first below, and once more from there.
        t0 = before[i]
        t1 = t[i]
        g0 = gap_before[i]
        g1 = gap_after[i]
        tm = t0 + (t1 - t0) * g0 / max(g0 - g1, f32(1e-6))
        gm = origin.z + dz[i] * tm - bilinear(top, origin.x + dx[i] * tm, origin.y + dy[i] * tm)
        t0 = tm if gm > f32(0) else t0
        g0 = gm if gm > f32(0) else g0
        t1 = t1 if gm > f32(0) else tm
        g1 = g1 if gm > f32(0) else gm
        tm = t0 + (t1 - t0) * g0 / max(g0 - g1, f32(1e-6))
        t[i] = tm if hit[i] > f32(0) else min(t1, leave[i])
        # A hit farther than FAR_M counts as a miss, so that the horizon's colour is drawn there.
        hit[i] = f32(0) if t[i] >= f32(FAR_M) else hit[i]


@kernel(disjoint=True, allocates=False)
def touch_surface(scene, world, origin, rays, t, tangents, n):
    """Fill `Tangents` [n] with the planes that touch the surface where each of n rays meets it at t [n]."""
    dx, dy, _ = rays
    slope_x, slope_y, gap = tangents
    top = top_map(scene, world)
    for i in range(n):
        # The plane through the surface at the point, written as a height under the camera.
        height, rise_x, rise_y = sloped(top, origin.x + dx[i] * t[i], origin.y + dy[i] * t[i])
        slope_x[i] = rise_x
        slope_y[i] = rise_y
        gap[i] = origin.z - height + (rise_x * dx[i] + rise_y * dy[i]) * t[i]


@kernel(disjoint=True, allocates=False)
def meet_tangents(tangents, square_t, rays, t, n):
    """Fill t [n] with where the rays of a row meet `Tangents` [n / SQUARE], `SQUARE` neighbours to a plane.

    square_t [n / SQUARE]: t of the ray through the middle of each square.
    """
    dx, dy, dz = rays
    slope_x, slope_y, gap = tangents
    for i in range(n):
        k = uint32(i // SQUARE)
        rate = slope_x[k] * dx[i] + slope_y[k] * dy[i] - dz[i]
        met = gap[k] / max(rate, f32(1e-6))
        t[i] = met if abs(met - square_t[k]) < f32(SETTLE_SHARE) * square_t[k] else square_t[k]


@kernel(disjoint=True, allocates=False)
def water_depths(scene, world, origin, rays, t, depth, n):
    """Fill depth [n] with the depth of the water where each ray is at t [n]; it is not above zero on dry ground."""
    dx, dy, _ = rays
    water = depth_map(scene, world)
    for i in range(n):
        depth[i] = bilinear(water, origin.x + dx[i] * t[i], origin.y + dy[i] * t[i])
