"""Shading kernel for dry ground: its baked, prefiltered paint, and grain where the camera is near."""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.compute.jit import kernel
from thalweg.render.bake import ripples
from thalweg.render.kernels.fast_math import log2
from thalweg.render.kernels.table_lookup import clamp, paint_level, tile_level
from thalweg.render.records import layout

f32 = np.float32

SHARPEN = 0.5
"""Levels by which textures are sampled finer than the footprint asks for: the original's frames are as crisp."""
GRAIN_M = 2.3
"""Side of the tile of fine grain."""
PATCH_M = 9.1
"""Side of the same tile laid out again, coarser and turned."""
GRAIN_DEPTH = 0.20
PATCH_DEPTH = 0.12
"""Contrast of the fine grain and of the coarse: its standard deviation as a share of the radiance."""
DAPPLE = 0.45
"""How far flecks of light reach into half shade, as a share of the sun."""
SKY_SHARE = 0.09
"""What the sky adds to the ground's light beside the full sun."""


@kernel(inlined=True, allocates=False)
def tile_grain(tile, x_m, y_m, footprint, side_m):
    """Return the grain of unit deviation about 0 at a point in metres, filtered to a footprint; the tile is side_m
    wide.
    """
    level = clamp(log2(footprint * f32(ripples.SIZE) / side_m) - f32(SHARPEN), f32(0), f32(ripples.LEVELS - 1))
    scale = f32(ripples.SIZE) / side_m
    # The nearest level is enough here: a step in the contrast of grain does not show.
    _, _, _, grain = tile_level(tile, x_m * scale, y_m * scale, int32(level + f32(0.5)))
    return (grain - f32(127.5)) * f32(1 / (255.0 * ripples.GRAIN_SPREAD))


@kernel(disjoint=True, allocates=False)
def shade_ground(scene, view, points, pixel, out, n):
    """Fill `Radiance` [n] with that of the ground at `HitPoints`; pixel: height of a pixel at distance one."""
    x, y, _, _, _, dz, distance = points
    red, green, blue = out
    inv_cell = scene.constants[view.world, layout.INV_CELL]
    cell = f32(1) / inv_cell
    columns = int32(scene.extents[view.world, layout.PAINT_X])
    rows = int32(scene.extents[view.world, layout.PAINT_Y])
    extents = scene.extents
    # Paint is square-root coded, so that the code's square times this is radiance.
    code = f32(layout.PAINT_RANGE / 255.0**2)
    for i in range(n):
        # A pixel's footprint is stretched along the ray; the geometric mean of its sides chooses the level.
        footprint = distance[i] * pixel / math.sqrt(max(-dz[i], f32(0.06)))
        level = clamp(log2(footprint * inv_cell) - f32(SHARPEN), f32(0), f32(layout.PAINT_LEVELS - 1.01))
        # Between two mip levels (Williams, "Pyramidal Parametrics", 1983).
        low = int32(level)
        share = level - f32(low)
        begin = int32(extents[view.world, uint32(int32(layout.PAINT_AT) + low)])
        r0, g0, b0, s0 = paint_level(scene.paint, begin, columns, rows, x[i], y[i], low)
        low += int32(1)
        begin = int32(extents[view.world, uint32(int32(layout.PAINT_AT) + low)])
        r1, g1, b1, s1 = paint_level(scene.paint, begin, columns, rows, x[i], y[i], low)
        r0 += (r1 - r0) * share
        g0 += (g1 - g0) * share
        b0 += (b1 - b0) * share
        sun = clamp((s0 + (s1 - s0) * share) * f32(1 / 255.0), f32(0), f32(1))
        mx = x[i] * cell
        my = y[i] * cell
        fine = tile_grain(scene.ripples, mx, my, footprint, f32(GRAIN_M))
        # Turned by about 37 degrees, so that the two layers do not repeat together.
        patch = tile_grain(
            scene.ripples, f32(0.8) * mx - f32(0.6) * my, f32(0.6) * mx + f32(0.8) * my, footprint, f32(PATCH_M)
        )
        # Leaves cut their shade finer than the baked map can: half shade breaks into flecks.
        flecks = clamp(sun + f32(DAPPLE * 4) * sun * (f32(1) - sun) * patch, f32(0), f32(1))
        grain = max((f32(1) + f32(GRAIN_DEPTH) * fine) * (f32(1) + f32(PATCH_DEPTH) * patch), f32(0.2)) * code
        grain *= (f32(SKY_SHARE) + flecks) / (f32(SKY_SHARE) + sun)
        red[i] = r0 * r0 * grain
        green[i] = g0 * g0 * grain
        blue[i] = b0 * b0 * grain
