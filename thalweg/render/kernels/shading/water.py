"""Shading kernels for water: its bed through absorbing water, sky and woods mirrored in ripples, and the sun's glitter.

`shade_water` shades a list of water pixels in three passes: ripples, what is mirrored, what lies below. The formulas
and their sources are in `thalweg.render.kernels.shading.water_optics`.

* Ripples: two layers of one prefiltered tile drifting apart (`thalweg.render.bake.ripples`).
* The mirrored image: `thalweg.render.kernels.shading.mirror`.

Absent on purpose: waves that move the surface, and foam.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples
from thalweg.render.kernels.fast_math import log2
from thalweg.render.kernels.shading.clouds import MIRROR_SOFTNESS, add_clouds, cloud_layer
from thalweg.render.kernels.shading.ground import tile_grain
from thalweg.render.kernels.shading.mirror import Mirrored, mirror_canopy
from thalweg.render.kernels.shading.water_optics import (
    GLITTER_TINT,
    INDEX,
    ROUGHNESS,
    footprint,
    from_below,
    glints,
    mirrored_ray,
    mirrored_share,
    refracted_slant,
)
from thalweg.render.kernels.table_lookup import bilinear, clamp, depth_map, paint_level, sky_at, tile_level
from thalweg.render.records import layout
from thalweg.render.records.appearance import (
    ABSORB_B,
    ABSORB_G,
    ABSORB_R,
    DRIFT_A_X,
    DRIFT_A_Y,
    DRIFT_B_X,
    DRIFT_B_Y,
    RIPPLE,
    SCATTER_B,
    SCATTER_G,
    SCATTER_R,
)

f32 = np.float32

TILE_A_M = 7.3
TILE_B_M = 2.9
"""Sides of the tiles of the two layers of ripples."""
BED_M = 4.6
"""Side of the tile of stones on the bed."""
BED_DEPTH = 0.16
"""Contrast of the stones' brightness."""
BED_ROUGH = 0.22
"""Share by which stones and holes change the depth."""
SILT = 0.14
"""Contrast of the clouds of silt that scatter the light of deep water."""


class Surface(NamedTuple):
    """The rippled surface at n pixels, arrays [n] float32."""

    slope_x: Any
    slope_y: Any
    spread: Any
    """Mean square slope of the ripples too small to be seen."""
    facing: Any
    """Cosine between the line of sight and the surface's normal."""
    mirror_x: Any
    """Unit direction of the mirrored ray, as the next two."""
    mirror_y: Any
    mirror_z: Any


class WaterScratch(NamedTuple):
    """Scratch of `shade_water`."""

    surface: Any
    mirrored: Any


@kernel(inlined=True)
def empty_scratch(n):
    """Return a `WaterScratch` for up to n pixels."""
    rows = np.empty((11, n), np.float32)
    return WaterScratch(
        Surface(rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], rows[6]),
        Mirrored(rows[7], rows[8], rows[9], rows[10]),
    )


@kernel(inlined=True, allocates=False)
def ripple_layer(tile, x, y, level):
    """Return slopes and lost mean square slope of a layer at tile coordinates, filtered to a (fractional) level."""
    level = clamp(level, f32(0), f32(ripples.LEVELS - 1.01))
    low = int32(level)
    share = level - f32(low)
    a_x, a_y, a_lost, _ = tile_level(tile, x, y, low)
    b_x, b_y, b_lost, _ = tile_level(tile, x, y, low + int32(1))
    # Bytes stand for slopes of either sign around 127.5; what filtering took from the slopes is kept as roughness.
    half = f32(127.5)
    scale = f32(ripples.SLOPE_RANGE / 127.5)
    slope_x = (a_x + (b_x - a_x) * share - half) * scale
    slope_y = (a_y + (b_y - a_y) * share - half) * scale
    return slope_x, slope_y, (a_lost + (b_lost - a_lost) * share) * f32(ripples.VARIANCE_RANGE / 255.0)


@kernel(allocates=False)
def shade_water(scene, view, points, pixel, work, out, n):
    """Fill `Radiance` [n] with that of the water at `HitPoints`.

    pixel: height of a pixel at distance one; work: a `WaterScratch`.
    """
    ripple_surface(scene, view, points, pixel, work.surface, n)
    # `out` is free until the last pass.
    mirror_canopy(scene, view, points, pixel, work.surface, work.mirrored, out, n)
    compose(scene, view, points, pixel, work.surface, work.mirrored, out, n)


@kernel(disjoint=True, allocates=False)
def ripple_surface(scene, view, points, pixel, surface, n):
    """Fill the `Surface` [n] of the water at `HitPoints`."""
    x, y, _, dx, dy, dz, distance = points
    slope_x, slope_y, spread, facing, rx, ry, rz = surface
    time = view.time
    cell = f32(1) / scene.constants[view.world, layout.INV_CELL]
    tile = scene.ripples
    amplitude = view.look[RIPPLE]
    drift_ax = view.look[DRIFT_A_X] * time
    drift_ay = view.look[DRIFT_A_Y] * time
    drift_bx = view.look[DRIFT_B_X] * time
    drift_by = view.look[DRIFT_B_Y] * time
    for i in range(n):
        # Ripples are filtered to the pixel, and what the filter removes is returned as roughness: no shimmer far away.
        foot = footprint(distance[i], pixel, dz[i])
        mx = x[i] * cell
        my = y[i] * cell
        ax, ay, a_lost = ripple_layer(
            tile,
            (mx + drift_ax) * f32(ripples.SIZE / TILE_A_M),
            (my + drift_ay) * f32(ripples.SIZE / TILE_A_M),
            log2(foot * f32(ripples.SIZE / TILE_A_M)),
        )
        # The second layer is turned by about 53 degrees, so that the tiles do not repeat together.
        bx, by, b_lost = ripple_layer(
            tile,
            (f32(0.6) * mx + f32(0.8) * my + drift_bx) * f32(ripples.SIZE / TILE_B_M),
            (f32(0.6) * my - f32(0.8) * mx + drift_by) * f32(ripples.SIZE / TILE_B_M),
            log2(foot * f32(ripples.SIZE / TILE_B_M)),
        )
        # The tile's slopes are turned back with the layer.
        lean_x = amplitude * (ax + f32(0.6) * bx - f32(0.8) * by)
        lean_y = amplitude * (ay + f32(0.8) * bx + f32(0.6) * by)
        slope_x[i] = lean_x
        slope_y[i] = lean_y
        spread[i] = amplitude * amplitude * (a_lost + b_lost) + f32(ROUGHNESS)
        facing[i], rx[i], ry[i], rz[i] = mirrored_ray(dx[i], dy[i], dz[i], lean_x, lean_y)


@kernel(inlined=True, allocates=False)
def bed_paint(scene, world, x, y, foot):
    """Return the bed's paint at node coordinates: red, green, blue codes, share of sun, and the stones' deviation.

    foot: side of a pixel there in metres. Codes are 0..255; the deviation has unit spread.
    """
    extents = scene.extents
    inv_cell = scene.constants[world, layout.INV_CELL]
    cell = f32(1) / inv_cell
    columns = int32(extents[world, layout.PAINT_X])
    rows = int32(extents[world, layout.PAINT_Y])
    # One level below the last, because two neighbouring levels are read.
    level = clamp(log2(foot * inv_cell), f32(0), f32(layout.PAINT_LEVELS - 1.01))
    low = int32(level)
    share = level - f32(low)
    begin = int32(extents[world, uint32(int32(layout.PAINT_AT) + low)])
    r0, g0, b0, s0 = paint_level(scene.paint, begin, columns, rows, x, y, low)
    low += int32(1)
    begin = int32(extents[world, uint32(int32(layout.PAINT_AT) + low)])
    r1, g1, b1, s1 = paint_level(scene.paint, begin, columns, rows, x, y, low)
    # Pebbles and holes too small for the map of depths, most of all where it is shallow.
    pebbles = tile_grain(scene.ripples, x * cell, y * cell, foot, f32(BED_M))
    bright = max(f32(1) + f32(BED_DEPTH) * pebbles, f32(0.2))
    red = (r0 + (r1 - r0) * share) * bright
    green = (g0 + (g1 - g0) * share) * bright
    blue = (b0 + (b1 - b0) * share) * bright
    return red, green, blue, (s0 + (s1 - s0) * share) * f32(1 / 255.0), pebbles


@kernel(disjoint=True, allocates=False)
def compose(scene, view, points, pixel, surface, mirrored, out, n):
    """Fill `Radiance` [n]: the bed through the water, by Fresnel the mirrored canopy and sky, and the sun's glitter."""
    x, y, _, dx, dy, dz, distance = points
    slope_x, slope_y, spread, facing, rx, ry, rz = surface
    passing, up_r, up_g, up_b = mirrored
    red, green, blue = out
    look = view.look
    number = scene.constants
    w = view.world
    depths = depth_map(scene, w)
    inv_cell = number[w, layout.INV_CELL]
    sky_begin = int32(scene.extents[w, layout.SKY_AT])
    sun = number[w, layout.SUN_X], number[w, layout.SUN_Y], number[w, layout.SUN_Z]
    sun_path = refracted_slant(sun[2])
    layer = cloud_layer(scene, view, f32(MIRROR_SOFTNESS))
    for i in range(n):
        mirror = mirrored_share(facing[i], spread[i])

        # The bed, where the refracted ray meets it. A slope bends the ray by a quarter of itself (1 - 1 / INDEX).
        depth = max(bilinear(depths, x[i], y[i]), f32(0))
        hx = dx[i] * f32(1 / INDEX) + slope_x[i] * f32(0.25)
        hy = dy[i] * f32(1 / INDEX) + slope_y[i] * f32(0.25)
        path = depth / math.sqrt(max(f32(1) - hx * hx - hy * hy, f32(0.1)))
        foot = footprint(distance[i], pixel, dz[i])
        bed_r, bed_g, bed_b, sunlit, pebbles = bed_paint(
            scene, w, x[i] + hx * path * inv_cell, y[i] + hy * path * inv_cell, foot
        )
        # Sunlight has come down through the water before it goes up again.
        path = (path + depth * sun_path) * max(f32(1) + f32(BED_ROUGH) * pebbles, f32(0))
        silt = max(f32(1) + f32(SILT) * pebbles, f32(0))
        under_r = from_below(bed_r, path, look[ABSORB_R], look[SCATTER_R] * silt, sunlit)
        under_g = from_below(bed_g, path, look[ABSORB_G], look[SCATTER_G] * silt, sunlit)
        under_b = from_below(bed_b, path, look[ABSORB_B], look[SCATTER_B] * silt, sunlit)
        # The bed's share of the sun stands for the surface's; where a canopy is mirrored, the sun is hidden too.
        glitter = glints(sun, dx[i], dy[i], dz[i], slope_x[i], slope_y[i], spread[i], sunlit * passing[i])
        # Canopies were met before the sky, so the sky is seen by the share of light that passed them.
        sky_r, sky_g, sky_b = sky_at(scene.sky, sky_begin, rx[i], ry[i], rz[i])
        sky_r, sky_g, sky_b = add_clouds(scene.clouds, layer, rx[i], ry[i], rz[i], sky_r, sky_g, sky_b)
        over_r = (up_r[i] + sky_r * passing[i]) * mirror
        over_g = (up_g[i] + sky_g * passing[i]) * mirror
        over_b = (up_b[i] + sky_b * passing[i]) * mirror
        red[i] = under_r * (f32(1) - mirror) + over_r + glitter * f32(GLITTER_TINT[0])
        green[i] = under_g * (f32(1) - mirror) + over_g + glitter * f32(GLITTER_TINT[1])
        blue[i] = under_b * (f32(1) - mirror) + over_b + glitter * f32(GLITTER_TINT[2])
