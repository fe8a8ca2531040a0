"""Kernels that draw billboards into tiles of 4 x 4 pixels, which are drawn together and closed together.

While plants are drawn, the pixels of a tile lie next to one another in memory, so that all of them are one vector. A
square tile is filled better by a narrow plant than a run of a row is, and is closed sooner. A tile is closed once none
of its pixels lets light through, or each shows ground before the plant: leaving it out changes nothing.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint64

from thalweg.core.compute.jit import kernel
from thalweg.render.bake.impostors import LEVELS
from thalweg.render.bake.outlines import BANDS
from thalweg.render.kernels.camera_rays import image_x, image_y, row_step
from thalweg.render.kernels.plants import reduced_billboard
from thalweg.render.kernels.plants.billboard import CLOSED, SAMPLES, SIDE, billboard_pixel, sample_ray
from thalweg.render.kernels.plants.cover import cover_tile, cover_tile_by_twos
from thalweg.render.kernels.table_lookup import clamp
from thalweg.render.kernels.terrain.primary_hits import MISS

f32 = np.float32

LEAST_AHEAD = 0.05
"""Outlines are only used where rays and billboards lie ahead by more than this, as a share of their distance."""


class Tiles(NamedTuple):
    """`Buffers` of a frame by tiles: flat arrays [T * pixels of a tile], and two numbers a tile [Y, X]."""

    depth: Any
    """float32, depth of what lies behind the plants; 0 beyond the image."""
    red: Any
    """float32, radiance of plants, as the next two."""
    green: Any
    blue: Any
    light: Any
    """float32, share of the light that plants let through."""
    plant_depth: Any
    """float32, see `Buffers.plant_depth`."""
    deepest: Any
    """float32, greatest depth of a tile's pixels, 0 once the tile is closed."""


class TileRows(NamedTuple):
    """Rays of the first and of the last samples in each row of tiles [Y], float32."""

    level_first: Any
    """Length of the level part of a ray in the middle column, per metre along the axis."""
    level_last: Any
    slope_first: Any
    """Rise of that ray over its level part."""
    slope_last: Any


@kernel
def empty_tiles(rows, columns, together):
    """Return new `Tiles` for so many rows and columns of pixels; `together`: rows of pixels that share a sample."""
    high = (rows + SIDE * together - 1) // (SIDE * together)
    wide = (columns + SIDE - 1) // SIDE
    size = high * wide * SAMPLES * together
    # The buffers are a few cache lines apart from whole pages: a processor may take equal offsets within pages for
    # equal addresses.
    apart = size + 80
    block = np.zeros(6 * apart, np.float32)
    buffers = block.reshape(6, apart)
    buffers[4] = f32(1)
    return Tiles(
        block[:size], block[apart : apart + size], block[2 * apart : 2 * apart + size],
        block[3 * apart : 3 * apart + size], block[4 * apart : 4 * apart + size], block[5 * apart : 5 * apart + size],
        np.zeros((high, wide), np.float32),
    )  # fmt: skip


@kernel
def empty_cover(rows, columns, together):
    """Return new `Tiles` as those of `empty_tiles`, but with no radiance."""
    high = (rows + SIDE * together - 1) // (SIDE * together)
    wide = (columns + SIDE - 1) // SIDE
    size = high * wide * SAMPLES * together
    none = np.empty(0, np.float32)
    return Tiles(
        np.zeros(size, np.float32), none, none, none, np.ones(size, np.float32), np.zeros(size, np.float32),
        np.zeros((high, wide), np.float32),
    )  # fmt: skip


@kernel(inlined=True, allocates=False)
def pixel_of(ty, tx, wide, together, row, column):
    """Index in `Tiles` of the pixel `row`, `column` of a tile; `wide`: tiles in a row; `together`: 1 or 2."""
    # With one or two rows together, masks and shifts stand for divisions.
    below = row & (together - 1)
    return uint64(((ty * wide + tx) * together + below) * SAMPLES + (row >> (together - 1)) * SIDE + column)


@kernel(disjoint=True, allocates=False)
def load_depths(depth, width, together, tiles):
    """Fill the depths of `Tiles` from a plane [R, W'], of which `width` columns are in the image."""
    rows = depth.shape[0]
    high, wide = tiles.deepest.shape
    for ty in range(high):
        for row in range(min(SIDE * together, rows - ty * SIDE * together)):
            # Unsigned indices need no test for negative ones, here and below.
            r = uint64(ty * SIDE * together + row)
            for tx in range(wide):
                k = pixel_of(ty, tx, wide, together, row, 0)
                first = uint64(tx * SIDE)
                within = uint64(width) - first
                most = f32(0)
                for column in range(SIDE):
                    c = uint64(column)
                    # W' is a multiple of SIDE, so that the pixel exists even where it is not in the image.
                    value = depth[r, first + c] if c < within else f32(0)
                    tiles.depth[k + c] = value
                    most = max(most, value)
                tiles.deepest[ty, tx] = max(tiles.deepest[ty, tx], most)


@kernel(disjoint=True, allocates=False)
def store_tiles(tiles, together, coloured, buffers):
    """Fill transmittance and depth of plants in `Buffers` [R, W'] from `Tiles`, and with `coloured` their radiance."""
    rows = buffers.depth.shape[0]
    high, wide = tiles.deepest.shape
    for ty in range(high):
        for row in range(min(SIDE * together, rows - ty * SIDE * together)):
            r = uint64(ty * SIDE * together + row)
            for tx in range(wide):
                k = pixel_of(ty, tx, wide, together, row, 0)
                first = uint64(tx * SIDE)
                for column in range(SIDE):
                    c = uint64(column)
                    buffers.transmittance[r, first + c] = tiles.light[k + c]
                    # A depth of 0 stands for no plant.
                    found = tiles.plant_depth[k + c]
                    buffers.plant_depth[r, first + c] = found if found > f32(0) else f32(MISS)
                if not coloured:
                    continue
                for column in range(SIDE):
                    c = uint64(column)
                    buffers.red[r, first + c] = tiles.red[k + c]
                    buffers.green[r, first + c] = tiles.green[k + c]
                    buffers.blue[r, first + c] = tiles.blue[k + c]


@kernel(allocates=False)
def fill_tile_rows(camera, top, together, rows):
    """Fill `TileRows`; row 0 of the first tile is row `top` of the image."""
    for ty in range(len(rows.level_first)):
        first = top + ty * SIDE * together
        sy = image_y(camera, first, together)
        rows.level_first[ty] = level_part(camera, sy)
        rows.slope_first[ty] = (camera.forward_z + sy * camera.up_z) / max(rows.level_first[ty], f32(LEAST_AHEAD))
        sy = image_y(camera, first + (SIDE - 1) * together, together)
        rows.level_last[ty] = level_part(camera, sy)
        rows.slope_last[ty] = (camera.forward_z + sy * camera.up_z) / max(rows.level_last[ty], f32(LEAST_AHEAD))


@kernel(inlined=True, allocates=False)
def level_part(camera, sy):
    """Length of the level part of the ray in the middle column at height sy of the image plane, negative backwards."""
    # The camera does not roll: level and to the right of its sight, a quarter turn left of `right` is ahead.
    x = camera.forward_x + sy * camera.up_x
    y = camera.forward_y + sy * camera.up_y
    return y * camera.right_x - x * camera.right_y


@kernel(inlined=True, allocates=False)
def columns_filled(outlines, board, camera, rows, ty, c0, c1):
    """The columns from, to among c0 to c1 in which a billboard may show anything in a row of tiles.

    Upright lines of a billboard are lines of the image through its vanishing point for downwards. So a line at u lies
    in the column of the image that is `level` times a number which depends on u alone.
    """
    # Sine and cosine of the angle from the middle column's direction to the plant's.
    along = board.sight_y * camera.right_x - board.sight_x * camera.right_y
    across = board.sight_x * camera.right_x + board.sight_y * camera.right_y
    # Half the billboard's width as a share of its distance.
    half = f32(1) / (board.per_half_width * board.distance)
    least = along - half * abs(across)
    most = along + half * abs(across)
    level_0 = rows.level_first[ty]
    level_1 = rows.level_last[ty]
    usable = (least > f32(LEAST_AHEAD)) & (level_0 > f32(LEAST_AHEAD)) & (level_1 > f32(LEAST_AHEAD))
    if usable:
        # Heights at the billboard's two edges; rays of the first samples are the steepest upwards.
        high = rows.slope_first[ty] * board.distance
        low = rows.slope_last[ty] * board.distance
        v1 = (max(high * least, high * most) - board.foot) * board.per_height
        v0 = (min(low * least, low * most) - board.foot) * board.per_height
        # Margins are far above the rounding of single precision: here of a band, below of a column.
        # A neighbouring view has an outline of its own.
        beside = board.outline + board.step * int32(LEVELS)
        b0 = int32(clamp(v0 * f32(BANDS) - f32(0.02), f32(0), f32(BANDS - 1)))
        b1 = int32(clamp(v1 * f32(BANDS) + f32(0.02), f32(0), f32(BANDS - 1)))
        u0 = f32(2)
        u1 = f32(-2)
        for band in range(b0, b1 + 1):
            u0 = min(u0, outlines[board.outline, 2 * band], outlines[beside, 2 * band])
            u1 = max(u1, outlines[board.outline, 2 * band + 1], outlines[beside, 2 * band + 1])
        if u0 > u1:
            return c0, c0
        right = (across - u0 * half * along) / (along + u0 * half * across)
        left = (across - u1 * half * along) / (along + u1 * half * across)
        first = (min(left * level_0, left * level_1) + camera.half_w) / camera.column_step - f32(0.6)
        last = (max(right * level_0, right * level_1) + camera.half_w) / camera.column_step - f32(0.4)
        # Limited before they become integers, which a line far outside the image would overflow.
        c1 = min(int32(clamp(last, f32(-1), f32(c1)) + f32(1)), c1)
        c0 = max(int32(clamp(first, f32(c0), f32(c1))), c0)
    return c0, c1


@kernel(inlined=True, allocates=False)
def first_open_row(deepest, nearest, box):
    """The first row of tiles in a box of tiles in which one shows anything behind `nearest`; its end if none does."""
    x0, x1, y0, y1 = box
    ty = y0
    while ty < y1:
        most = f32(0)
        for tx in range(x0, x1):
            most = max(most, deepest[ty, tx])
        if most >= nearest:
            return ty
        ty += 1
    return y1


@kernel(inlined=True, disjoint=True, allocates=False)
def draw_tile(atlas, board, nearest, camera, left, height, first, blended, tiles):
    """Draw a `Billboard` into the tile whose samples begin at index `first`; returns the light that its pixels let
    through to what is farther.

    left, height: where its first sample is on the image plane; nearest: see `billboard.nearest_depth`;
    blended: see `billboard.billboard_pixel`.
    """
    per_row = row_step(camera)
    still = f32(0)
    for i in range(SAMPLES):
        # An unsigned index needs no test for negative ones, which would break up the vectors.
        k = first + uint64(i)
        dx, dy, dz = sample_ray(camera, left, height, per_row, i)
        passing = tiles.light[k]
        add_r, add_g, add_b, part, t = billboard_pixel(
            atlas, board, dx, dy, dz, camera.near_m, tiles.depth[k], passing, f32(CLOSED), blended,
        )  # fmt: skip
        tiles.red[k] += add_r
        tiles.green[k] += add_g
        tiles.blue[k] += add_b
        rest = passing - part
        tiles.light[k] = rest
        crossed = (passing >= f32(0.5)) & (rest < f32(0.5))
        tiles.plant_depth[k] = t if crossed else tiles.plant_depth[k]
        # Later plants are no nearer: ground before this one hides them too.
        still += rest if tiles.depth[k] > nearest else f32(0)
    return still


@kernel(inlined=True, disjoint=True, allocates=False)
def draw_billboard(scene, board, nearest, camera, box, top, reduced, coloured, scratch, rows, tiles):
    """Draw a `Billboard` into the tiles of its box that are not closed, where its outline says that it shows anything.

    box: the columns from, to and the rows of tiles from, to; row 0 is row `top` of the image; coloured: with radiance;
    scratch: [reduced_billboard.SCRATCH_ROWS, SAMPLES]; rows: `TileRows`.
    """
    c0, c1, y0, y1 = box
    deepest = tiles.deepest
    wide = deepest.shape[1]
    together = reduced_billboard.ROWS if reduced else 1
    for ty in range(y0, y1):
        if first_open_row(deepest, nearest, (c0 // SIDE, (c1 - 1) // SIDE + 1, ty, ty + 1)) > ty:
            continue
        filled_0, filled_1 = columns_filled(scene.outlines, board, camera, rows, ty, c0, c1)
        if filled_0 >= filled_1:
            continue
        height = image_y(camera, top + ty * SIDE * together, together)
        for tx in range(filled_0 // SIDE, (filled_1 - 1) // SIDE + 1):
            # A closed tile has depth 0; one whose ground is nearer than the plant shows none of it.
            if deepest[ty, tx] < nearest:
                continue
            left = image_x(camera, tx * SIDE)
            first = uint64((ty * wide + tx) * SAMPLES * together)
            if coloured and reduced:
                still = reduced_billboard.draw_tile(
                    scene.atlas, board, nearest, camera, left, height, first, scratch, tiles
                )
            elif coloured and board.blend > f32(0):
                # Two loops, each without a choice: most plants are far, and have one view.
                still = draw_tile(scene.atlas, board, nearest, camera, left, height, first, True, tiles)
            elif coloured:
                still = draw_tile(scene.atlas, board, nearest, camera, left, height, first, False, tiles)
            elif reduced:
                still = cover_tile_by_twos(scene.atlas, board, nearest, camera, left, height, first, scratch, tiles)
            elif board.blend > f32(0):
                still = cover_tile(scene.atlas, board, nearest, camera, left, height, first, True, tiles)
            else:
                still = cover_tile(scene.atlas, board, nearest, camera, left, height, first, False, tiles)
            deepest[ty, tx] = deepest[ty, tx] if still > f32(0) else f32(0)
