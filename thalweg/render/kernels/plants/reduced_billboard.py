"""Kernels that draw billboards in the reduced quality: from the nearest texel, two rows of pixels at a time."""

import numpy as np
from numba import uint32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.plants.billboard import SAMPLES, meet_billboard, nearest_texel, sample_ray, stopped
from thalweg.render.kernels.table_lookup import channel, clamp

f32 = np.float32

CLOSED = 0.1
"""As `billboard.CLOSED`, but larger: less of what lies behind foliage is drawn."""
SHARPEN = -0.3
"""As `billboard.SHARPEN`, but below zero for coarser texels, from 0.6 to 1.2 pixels high."""
ROWS = 2
"""Rows of a billboard that share their texels."""
SCRATCH_ROWS = 5
"""Rows of scratch that drawing a billboard needs."""


@kernel(inlined=True, allocates=False)
def billboard_pixel(atlas, board, dx, dy, dz, near):
    """As `billboard.billboard_pixel`, from the nearest texel, and before what lies in front or behind is counted.

    Returns red, green, blue, the share of light that it stops, and its depth.
    """
    t, u, v, inside = meet_billboard(board, dx, dy, dz, near)
    texel = atlas[uint32(nearest_texel(board, u, v))]
    cr = channel(texel, 0)
    cg = channel(texel, 8)
    cb = channel(texel, 16)
    sun = clamp(board.sun_low + board.sun_rise * v, f32(0), f32(1))
    cover = channel(texel, 24) * f32(1 / 255.0) if inside else f32(0)
    red = cr * cr * board.tint_r * (board.shade_r + (f32(1) - board.shade_r) * sun) + board.haze_r
    green = cg * cg * board.tint_g * (board.shade_g + (f32(1) - board.shade_g) * sun) + board.haze_g
    blue = cb * cb * board.tint_b * (board.shade_b + (f32(1) - board.shade_b) * sun) + board.haze_b
    return red, green, blue, cover, t


@kernel(inlined=True, disjoint=True, allocates=False)
def draw_tile(atlas, board, nearest, camera, left, height, first, scratch, tiles):
    """As `tiles.draw_tile`, where a sample stands for two pixels, one below the other.

    scratch: [SCRATCH_ROWS, SAMPLES].
    """
    ink_r, ink_g, ink_b, ink, ink_t = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    per_row = row_step(camera) * f32(ROWS)
    for i in range(SAMPLES):
        dx, dy, dz = sample_ray(camera, left, height, per_row, i)
        # Texels are read once into scratch; the two pixels below then differ only in depth and light.
        ink_r[i], ink_g[i], ink_b[i], ink[i], ink_t[i] = billboard_pixel(atlas, board, dx, dy, dz, camera.near_m)
    still = f32(0)
    for below in range(ROWS):
        for i in range(SAMPLES):
            k = first + uint64(below * SAMPLES + i)
            passing = tiles.light[k]
            # Front-to-back compositing (Porter, Duff 1984), for each pixel with its own depth and light. All is loaded
            # before a choice is made: a load within one would break up the vectors.
            cover = ink[i]
            t = ink_t[i]
            red = tiles.red[k]
            green = tiles.green[k]
            blue = tiles.blue[k]
            found = tiles.plant_depth[k]
            behind = tiles.depth[k]
            part = stopped(passing, cover if t < behind else f32(0), f32(CLOSED))
            tiles.red[k] = red + part * ink_r[i]
            tiles.green[k] = green + part * ink_g[i]
            tiles.blue[k] = blue + part * ink_b[i]
            rest = passing - part
            tiles.light[k] = rest
            crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
            tiles.plant_depth[k] = t if crossed else found
            still += rest if behind > nearest else f32(0)
    return still
