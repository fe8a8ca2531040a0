"""Kernels that draw how much light the plants let through, and their depth, without colours.

Only pixels that are asked for count: all of them for depth and class, those of water for a mask. A pixel belongs to the
plants once they stop more than half of its light, and later plants only stop more. So a block of pixels is closed as
soon as each of them has reached half: what is left of the light is not that of `plants.draw_plants`, but it is on the
same side of a half.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import int32, uint32, uint64

from thalweg.core.jit import kernel
from thalweg.render.kernels.billboard import BLOCK, SHARPEN, make_billboard, nearest_depth, stopped_light, texel_cover
from thalweg.render.kernels.camera_rays import row_step
from thalweg.render.kernels.plants import billboard_box, deepest_ground, frustum_of, visible_plants
from thalweg.render.kernels.shading import reduced_quality
from thalweg.render.kernels.table_lookup import channel, clamp
from thalweg.render.records import layout

f32 = np.float32


class Cover(NamedTuple):
    """What plants are drawn into as coverage: blocks of R rows, and their pixels as flat views [R * W']."""

    deepest: Any
    """[R, W' / BLOCK] float32, the greatest depth of a block's pixels that are asked for, 0 once it is closed."""
    behind: Any
    """float32, depth of what lies behind the plants, 0 at pixels that nobody asks for."""
    light: Any
    """float32, share of the light that the plants let through."""
    plant_depth: Any
    """float32, depth of the plant behind which less than half of the light remains."""
    scratch: Any
    """[2, BLOCK] float32."""


@kernel(inlined=True, allocates=False)
def billboard_cover(atlas, board, dx, dy, dz, near, ground, passing):
    """The share of `passing` that a billboard stops at one pixel, and its depth there: as `billboard.billboard_pixel`,
    without colours."""
    towards = dx * board.sight_x + dy * board.sight_y
    t = board.distance / max(towards, f32(1e-4))
    v = (dz * t - board.foot) * board.per_height
    u = (dy * board.sight_x - dx * board.sight_y) * t * board.per_half_width
    inside = (towards > f32(1e-3)) & (t > near) & (t < ground)
    inside = inside & (v >= f32(0)) & (v < f32(1)) & (abs(u) < f32(1))
    tu = clamp((f32(1) - u) * f32(0.5) * f32(board.columns) - f32(0.5), f32(0), f32(board.columns) - f32(1.001))
    tv = clamp(v * f32(board.rows) - f32(0.5), f32(0), f32(board.rows) - f32(1.001))
    column = int32(tu)
    row = int32(tv)
    a = tu - f32(column)
    b = tv - f32(row)
    k = board.begin + row * board.columns + column
    _, _, _, _, cover = texel_cover(
        a, b, atlas[uint32(k)], atlas[uint32(k + 1)],
        atlas[uint32(k + board.columns)], atlas[uint32(k + board.columns + 1)],
    )  # fmt: skip
    return stopped_light(passing, cover * f32(1 / 255.0)) if inside else f32(0), t


@kernel(inlined=True, allocates=False)
def nearest_cover(atlas, board, dx, dy, dz, near):
    """The share of light that a billboard stops by its nearest texel, and its depth: as
    `reduced_quality.billboard_pixel`, without colours."""
    towards = dx * board.sight_x + dy * board.sight_y
    t = board.distance / max(towards, f32(1e-4))
    v = (dz * t - board.foot) * board.per_height
    u = (dy * board.sight_x - dx * board.sight_y) * t * board.per_half_width
    inside = (towards > f32(1e-3)) & (t > near) & (v >= f32(0)) & (v < f32(1)) & (abs(u) < f32(1))
    column = int32(clamp((f32(1) - u) * f32(0.5) * f32(board.columns), f32(0), f32(board.columns) - f32(1)))
    row = int32(clamp(v * f32(board.rows), f32(0), f32(board.rows) - f32(1)))
    texel = atlas[uint32(board.begin + row * board.columns + column)]
    return channel(texel, 24) * f32(1 / 255.0) if inside else f32(0), t


@kernel(disjoint=True)
def cover_plants(scene, view, top, reduced, behind, light, plant_depth):
    """Reduce light [R, W'] by what the plants in view cover, and set plant_depth [R, W'] where less than half is left.

    behind [R, W']: depth of what lies behind the plants, 0 at pixels that nobody asks for. light begins at 1,
    plant_depth at `MISS`. Rows and W' are as in `plants.draw_plants`.
    """
    camera = view.camera
    rows, columns = behind.shape
    together = reduced_quality.ROWS if reduced else 1
    deepest = np.empty((rows, columns // BLOCK), np.float32)
    deepest_ground(behind, together, deepest)
    high, low, farthest = asked_rows(deepest, together)
    if low <= high:
        return
    first = scene.extents[view.world, layout.PLANT_FROM]
    total = scene.extents[view.world, layout.PLANT_TO] - first
    order = np.empty(total, np.int32)
    distance = np.empty(total, np.float32)
    # As in `draw_plants`: blocks reach beyond the last column.
    wide_half_w = f32(columns) * camera.column_step - camera.half_w
    frustum = frustum_of(max(camera.half_w, wide_half_w), camera.half_h)
    count = visible_plants(scene, view, frustum, order, distance)
    scratch = np.empty((2, BLOCK), np.float32)
    cover = Cover(deepest, behind.ravel(), light.ravel(), plant_depth.ravel(), scratch)
    cover_in_order(scene, view, top, reduced, (high, low), farthest, order[:count], distance, cover)


@kernel(inlined=True, allocates=False)
def asked_rows(deepest, together):
    """The rows from, to of deepest [R, B] with a value above zero, and the greatest value.

    together: rows of a block, whose number is that of its first row.
    """
    rows, blocks = deepest.shape
    high = rows
    low = 0
    farthest = f32(0)
    for r in range(0, rows, together):
        most = f32(0)
        for bx in range(blocks):
            most = max(most, deepest[r, bx])
        if most > f32(0):
            high = min(high, r)
            low = r + together
        farthest = max(farthest, most)
    return int32(high), int32(low), farthest


@kernel(disjoint=True, allocates=False)
def cover_in_order(scene, view, top, reduced, asked, farthest, order, distance, cover):
    """Draw the plants of an order, near to far, into the rows `asked` (from, to) of a `Cover`.

    distance [M]: horizontal metres by plant; farthest: the greatest depth that is asked for.
    """
    camera = view.camera
    first = scene.extents[view.world, layout.PLANT_FROM]
    columns = cover.deepest.shape[1] * BLOCK
    sharpen = f32(reduced_quality.SHARPEN) if reduced else f32(SHARPEN)
    together = reduced_quality.ROWS if reduced else 1
    high, low = asked
    for k in range(len(order)):
        p = first + order[k]
        far = distance[order[k]]
        nearest = nearest_depth(far, camera)
        # All plants that are left stand behind whatever is asked for.
        if nearest > farthest:
            break
        c0, c1, r0, r1 = billboard_box(scene.plants[p], far, camera, columns)
        r0 = max(r0 - int32(top), high)
        r1 = min(r1 - int32(top), low)
        box = c0, c1, r0, r1
        # Most plants hide nothing that is asked for: looking at their blocks is cheaper than preparing a billboard.
        if c0 < c1 and r0 < r1 and shows(cover.deepest, box, nearest, together):
            board = make_billboard(scene, view, p, far, sharpen)
            if reduced:
                cover_billboard_by_twos(scene.atlas, board, nearest, camera, box, top, cover)
            else:
                cover_billboard(scene.atlas, board, nearest, camera, box, top, cover)


@kernel(inlined=True, allocates=False)
def shows(deepest, box, nearest, together):
    """Whether any block of a box is open for a plant whose least depth is `nearest`."""
    c0, c1, r0, r1 = box
    most = f32(0)
    for r in range(r0 // together * together, r1, together):
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            most = max(most, deepest[r, bx])
    return most >= nearest


@kernel(disjoint=True, allocates=False)
def cover_billboard(atlas, board, nearest, camera, box, top, cover):
    """Draw a `Billboard` into the blocks of its box in a `Cover` that are not closed, as `billboard.draw_billboard`."""
    deepest, behind, light, plant_depth, _ = cover
    c0, c1, r0, r1 = box
    columns = deepest.shape[1] * BLOCK
    per_row = row_step(camera)
    for r in range(r0, r1):
        sy = camera.half_h - (f32(top + r) + f32(0.5)) * per_row
        base_x = camera.forward_x + sy * camera.up_x
        base_y = camera.forward_y + sy * camera.up_y
        base_z = camera.forward_z + sy * camera.up_z
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            if deepest[r, bx] < nearest:
                continue
            first = uint64(r * columns + bx * BLOCK)
            left = (f32(bx * BLOCK) + f32(0.5)) * camera.column_step - camera.half_w
            still = f32(0)
            for i in range(BLOCK):
                k = first + uint64(i)
                sx = left + f32(i) * camera.column_step
                passing = light[k]
                part, t = billboard_cover(
                    atlas, board, base_x + sx * camera.right_x, base_y + sx * camera.right_y, base_z,
                    camera.near_m, behind[k], passing,
                )  # fmt: skip
                rest = passing - part
                light[k] = rest
                plant_depth[k] = t if (passing >= f32(0.5)) & (rest < f32(0.5)) else plant_depth[k]
                # A pixel with exactly half of its light still lacks its depth.
                still += f32(1) if (rest >= f32(0.5)) & (behind[k] > nearest) else f32(0)
            deepest[r, bx] = deepest[r, bx] if still > f32(0) else f32(0)


@kernel(disjoint=True, allocates=False)
def cover_billboard_by_twos(atlas, board, nearest, camera, box, top, cover):
    """As `cover_billboard`, two rows at a time, which share their texels; see `reduced_quality.draw_billboard`."""
    deepest, behind, light, plant_depth, scratch = cover
    part, met = scratch[0], scratch[1]
    c0, c1, r0, r1 = box
    columns = deepest.shape[1] * BLOCK
    per_row = row_step(camera)
    for r in range(r0 // reduced_quality.ROWS * reduced_quality.ROWS, r1, reduced_quality.ROWS):
        sy = camera.half_h - (f32(top + r) + f32(0.5 * reduced_quality.ROWS)) * per_row
        base_x = camera.forward_x + sy * camera.up_x
        base_y = camera.forward_y + sy * camera.up_y
        base_z = camera.forward_z + sy * camera.up_z
        for bx in range(c0 // BLOCK, (c1 - 1) // BLOCK + 1):
            if deepest[r, bx] < nearest:
                continue
            left = (f32(bx * BLOCK) + f32(0.5)) * camera.column_step - camera.half_w
            for i in range(BLOCK):
                sx = left + f32(i) * camera.column_step
                # Texels are read once into scratch; the rows below then differ only in depth and light.
                part[i], met[i] = nearest_cover(
                    atlas, board, base_x + sx * camera.right_x, base_y + sx * camera.right_y, base_z, camera.near_m
                )
            still = f32(0)
            for below in range(reduced_quality.ROWS):
                first = uint64((r + below) * columns + bx * BLOCK)
                for i in range(BLOCK):
                    k = first + uint64(i)
                    passing = light[k]
                    rest = passing - (stopped_light(passing, part[i]) if met[i] < behind[k] else f32(0))
                    light[k] = rest
                    plant_depth[k] = met[i] if (passing >= f32(0.5)) & (rest < f32(0.5)) else plant_depth[k]
                    still += f32(1) if (rest >= f32(0.5)) & (behind[k] > nearest) else f32(0)
            deepest[r, bx] = deepest[r, bx] if still > f32(0) else f32(0)
