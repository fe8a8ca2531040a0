"""What does dry ground look like? Its baked, prefiltered paint, and grain where the camera is near."""

import math

import numpy as np
from numba import int32, uint32

from thalweg.kernel import kernel
from thalweg.render import ripples
from thalweg.render import scene as table
from thalweg.render.approx import log2
from thalweg.render.fetch import clamp, paint_level, tile_level

f32 = np.float32

SHARPEN = 0.5
"""Levels by which textures are taken finer than the footprint asks: the original is as crisp."""
GRAIN_M = 2.3
"""Side of the tile of fine grain."""
PATCH_M = 9.1
"""Side of the same tile laid out again, coarser and turned."""
GRAIN_DEPTH = 0.50
PATCH_DEPTH = 0.30


@kernel(inlined=True)
def grain_at(tile, x_m, y_m, foot):
    """Factor on the ground's radiance at a point in metres, about 1, filtered to a footprint in metres."""
    fine = clamp(log2(foot * f32(ripples.SIZE / GRAIN_M)) - f32(SHARPEN), f32(0), f32(ripples.LEVELS - 1))
    coarse = clamp(log2(foot * f32(ripples.SIZE / PATCH_M)) - f32(SHARPEN), f32(0), f32(ripples.LEVELS - 1))
    _, _, _, a = tile_level(
        tile, x_m * f32(ripples.SIZE / GRAIN_M), y_m * f32(ripples.SIZE / GRAIN_M), int32(fine + f32(0.5))
    )
    _, _, _, b = tile_level(
        tile,
        (f32(0.8) * x_m - f32(0.6) * y_m) * f32(ripples.SIZE / PATCH_M),
        (f32(0.6) * x_m + f32(0.8) * y_m) * f32(ripples.SIZE / PATCH_M),
        int32(coarse + f32(0.5)),
    )
    fine_part = f32(2 * GRAIN_DEPTH / 255.0) * (a - f32(127.5))
    coarse_part = f32(2 * PATCH_DEPTH / 255.0) * (b - f32(127.5))
    return (f32(1) + fine_part) * (f32(1) + coarse_part)


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
        r0, g0, b0, _ = paint_level(scene.paint, begin, wide, high, x[i], y[i], low)
        low += int32(1)
        begin = int32(place[w, uint32(int32(table.PAINT_AT) + low)])
        r1, g1, b1, _ = paint_level(scene.paint, begin, wide, high, x[i], y[i], low)
        r0 += (r1 - r0) * share
        g0 += (g1 - g0) * share
        b0 += (b1 - b0) * share
        grain = grain_at(scene.ripples, x[i] * cell, y[i] * cell, foot) * code
        red[i] = r0 * r0 * grain
        green[i] = g0 * g0 * grain
        blue[i] = b0 * b0 * grain
