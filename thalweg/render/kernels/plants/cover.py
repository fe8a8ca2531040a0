"""Kernels that draw how much light a plant lets through in a tile of pixels, and its depth, without colours.

Only pixels that are asked for count: all of them for depth and class, those of water for a mask. A pixel belongs to the
plants once they stop at least half of its light, and later plants only stop more. So a tile is closed as soon as each
of its pixels has reached half: what is left of the light is not that of coloured plants, but it is on the same side of
a half.
"""

import numpy as np
from numba import uint32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.plants import reduced_billboard
from thalweg.render.kernels.plants.billboard import (
    SAMPLES,
    meet_billboard,
    mixed_cover,
    nearest_texel,
    sample_ray,
    sharp_cover,
    stopped,
    texel_at,
    texel_cover,
)
from thalweg.render.kernels.table_lookup import channel

f32 = np.float32


@kernel(inlined=True, allocates=False)
def billboard_cover(atlas, board, dx, dy, dz, near, ground, passing, blended):
    """The share of `passing` that a billboard stops at one pixel, and its depth there: as `billboard.billboard_pixel`,
    without colours."""
    t, u, v, inside = meet_billboard(board, dx, dy, dz, near)
    inside = inside & (t < ground)
    k, a, b = texel_at(board, u, v)
    cover = cover_between(atlas, k, board.columns, a, b)
    if blended:
        other = cover_between(atlas, k + board.step * board.rows * board.columns, board.columns, a, b)
        cover = mixed_cover(cover, other, board.blend)
    return stopped(passing, sharp_cover(cover, board.sharp) if inside else f32(0), f32(0)), t


@kernel(inlined=True, allocates=False)
def cover_between(atlas, k, columns, a, b):
    """The coverage, 0..255, between texel k, its right neighbour and the two above them, as of `billboard.filtered`."""
    _, _, _, _, cover = texel_cover(
        a, b, atlas[uint32(k)], atlas[uint32(k + 1)], atlas[uint32(k + columns)], atlas[uint32(k + columns + 1)]
    )
    return cover


@kernel(inlined=True, allocates=False)
def nearest_cover(atlas, board, dx, dy, dz, near):
    """The share of light that a billboard stops by its nearest texel, and its depth: as
    `reduced_billboard.billboard_pixel`, without colours."""
    t, u, v, inside = meet_billboard(board, dx, dy, dz, near)
    texel = atlas[uint32(nearest_texel(board, u, v))]
    return channel(texel, 24) * f32(1 / 255.0) if inside else f32(0), t


@kernel(inlined=True, disjoint=True, allocates=False)
def cover_tile(atlas, board, nearest, camera, left, height, first, blended, tiles):
    """As `tiles.draw_tile`, without radiance; returns how many pixels still have half of their light or more."""
    per_row = row_step(camera)
    still = f32(0)
    for i in range(SAMPLES):
        k = first + uint64(i)
        dx, dy, dz = sample_ray(camera, left, height, per_row, i)
        passing = tiles.light[k]
        part, t = billboard_cover(
            atlas, board, dx, dy, dz, camera.near_m, tiles.depth[k], passing, blended,
        )  # fmt: skip
        rest = passing - part
        tiles.light[k] = rest
        crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
        tiles.plant_depth[k] = t if crossed else tiles.plant_depth[k]
        # A pixel with exactly half of its light still lacks its depth.
        still += f32(1) if (rest >= f32(0.5)) & (tiles.depth[k] > nearest) else f32(0)
    return still


@kernel(inlined=True, disjoint=True, allocates=False)
def cover_tile_by_twos(atlas, board, nearest, camera, left, height, first, scratch, tiles):
    """As `cover_tile`, where a sample stands for two pixels, one below the other; see `reduced_billboard.draw_tile`."""
    part, met = scratch[0], scratch[1]
    per_row = row_step(camera) * f32(reduced_billboard.ROWS)
    for i in range(SAMPLES):
        dx, dy, dz = sample_ray(camera, left, height, per_row, i)
        part[i], met[i] = nearest_cover(atlas, board, dx, dy, dz, camera.near_m)
    still = f32(0)
    for below in range(reduced_billboard.ROWS):
        for i in range(SAMPLES):
            k = first + uint64(below * SAMPLES + i)
            passing = tiles.light[k]
            rest = passing - stopped(passing, part[i] if met[i] < tiles.depth[k] else f32(0), f32(0))
            tiles.light[k] = rest
            crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
            tiles.plant_depth[k] = met[i] if crossed else tiles.plant_depth[k]
            still += f32(1) if (rest >= f32(0.5)) & (tiles.depth[k] > nearest) else f32(0)
    return still
