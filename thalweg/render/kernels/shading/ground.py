"""What does dry ground look like? Its baked, prefiltered paint, and grain where the camera is near."""

import math

import numpy as np
from numba import int32, uint32

from thalweg.core.jit import kernel
from thalweg.render.bake import ripples
from thalweg.render.kernels.fast_math import log2
from thalweg.render.kernels.table_lookup import clamp, paint_level, tile_level
from thalweg.render.records import scene as table

f32 = np.float32

SHARPEN = 0.5
"""Levels by which textures are taken finer than the footprint asks: the original is as crisp."""
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


@kernel(inlined=True)
def tile_grain(tile, x_m, y_m, foot, side_m):
    """Grain of unit deviation about 0 at a point in metres, filtered to a footprint; the tile is side_m wide."""
    level = clamp(log2(foot * f32(ripples.SIZE) / side_m) - f32(SHARPEN), f32(0), f32(ripples.LEVELS - 1))
    scale = f32(ripples.SIZE) / side_m
    _, _, _, grain = tile_level(tile, x_m * scale, y_m * scale, int32(level + f32(0.5)))
    return (grain - f32(127.5)) * f32(1 / (255.0 * ripples.GRAIN_SPREAD))


@kernel(disjoint=True)
def shade_ground(scene, w, x, y, dz, far, pixel, red, green, blue, n):
    """Radiance [n] of ground pixels at node coordinates x, y; dz: rise of the unit direction of sight; far: metres."""
    cell = f32(1) / scene.number[w, table.INV_CELL]
    inv_cell = scene.number[w, table.INV_CELL]
    wide = int32(scene.place[w, table.PAINT_X])
    high = int32(scene.place[w, table.PAINT_Y])
    place = scene.place
    code = f32(table.PAINT_RANGE / 255.0**2)
    for i in range(n):
        foot = far[i] * pixel / math.sqrt(max(-dz[i], f32(0.06)))
        level = clamp(log2(foot * inv_cell) - f32(SHARPEN), f32(0), f32(table.PAINT_LEVELS - 1.01))
        low = int32(level)
        share = level - f32(low)
        begin = int32(place[w, uint32(int32(table.PAINT_AT) + low)])
        r0, g0, b0, s0 = paint_level(scene.paint, begin, wide, high, x[i], y[i], low)
        low += int32(1)
        begin = int32(place[w, uint32(int32(table.PAINT_AT) + low)])
        r1, g1, b1, s1 = paint_level(scene.paint, begin, wide, high, x[i], y[i], low)
        r0 += (r1 - r0) * share
        g0 += (g1 - g0) * share
        b0 += (b1 - b0) * share
        sun = clamp((s0 + (s1 - s0) * share) * f32(1 / 255.0), f32(0), f32(1))
        mx = x[i] * cell
        my = y[i] * cell
        fine = tile_grain(scene.ripples, mx, my, foot, f32(GRAIN_M))
        patch = tile_grain(
            scene.ripples, f32(0.8) * mx - f32(0.6) * my, f32(0.6) * mx + f32(0.8) * my, foot, f32(PATCH_M)
        )
        # Leaves cut their shade finer than the baked map can: half shade breaks into flecks.
        flecks = clamp(sun + f32(DAPPLE * 4) * sun * (f32(1) - sun) * patch, f32(0), f32(1))
        grain = max((f32(1) + f32(GRAIN_DEPTH) * fine) * (f32(1) + f32(PATCH_DEPTH) * patch), f32(0.2)) * code
        grain *= (f32(SKY_SHARE) + flecks) / (f32(SKY_SHARE) + sun)
        red[i] = r0 * r0 * grain
        green[i] = g0 * g0 * grain
        blue[i] = b0 * b0 * grain
