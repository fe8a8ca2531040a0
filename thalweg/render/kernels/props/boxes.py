"""Kernels for rectangles of pixels: which one a box before the camera may touch, and what lies within."""

import numpy as np
from numba import int32

from thalweg.core.compute.jit import kernel
from thalweg.render.kernels.camera_rays import column_of, row_of, row_step
from thalweg.render.kernels.props.turns import turned
from thalweg.render.kernels.table_lookup import clamp

f32 = np.float32


@kernel(inlined=True, allocates=False)
def part_box(camera, turn, half_x, half_y, half_z, px, py, pz):
    """Return the columns from, to and rows from, to of the image that a box may touch, with a pixel around it.

    The box has half sizes in metres after a `Turn`, and its middle at px, py, pz from the camera.
    """
    low_x, high_x, low_y, high_y = f32(1e9), f32(-1e9), f32(1e9), f32(-1e9)
    behind = 0
    for corner in range(8):
        dx, dy, dz = box_corner(turn, half_x, half_y, half_z, corner)
        ahead, sx, sy = seen_at(camera, px + dx, py + dy, pz + dz)
        behind += 1 if ahead < camera.near_m else 0
        low_x, high_x = min(low_x, sx), max(high_x, sx)
        low_y, high_y = min(low_y, sy), max(high_y, sy)
    if behind > 0 and behind < 8:
        low_x, high_x, low_y, high_y = cut_extent(camera, turn, half_x, half_y, half_z, px, py, pz)
    return pixel_box(camera, behind == 8, low_x, high_x, low_y, high_y)


@kernel(inlined=True, allocates=False)
def cut_extent(camera, turn, half_x, half_y, half_z, px, py, pz):
    """Return the least and greatest x and y on the image plane of a box as in `part_box` that the near plane cuts.

    They are those of its corners before the plane, and of the points where its edges meet the plane.
    """
    low_x, high_x, low_y, high_y = f32(1e9), f32(-1e9), f32(1e9), f32(-1e9)
    for corner in range(8):
        dx, dy, dz = box_corner(turn, half_x, half_y, half_z, corner)
        ahead, sx, sy = seen_at(camera, px + dx, py + dy, pz + dz)
        if ahead < camera.near_m:
            continue
        low_x, high_x = min(low_x, sx), max(high_x, sx)
        low_y, high_y = min(low_y, sy), max(high_y, sy)
        for axis in range(3):
            ex, ey, ez = box_corner(turn, half_x, half_y, half_z, corner ^ (1 << axis))
            end, _, _ = seen_at(camera, px + ex, py + ey, pz + ez)
            if end < camera.near_m:
                share = (ahead - camera.near_m) / (ahead - end)
                _, sx, sy = seen_at(
                    camera, px + dx + share * (ex - dx), py + dy + share * (ey - dy), pz + dz + share * (ez - dz)
                )
                low_x, high_x = min(low_x, sx), max(high_x, sx)
                low_y, high_y = min(low_y, sy), max(high_y, sy)
    return low_x, high_x, low_y, high_y


@kernel(inlined=True, allocates=False)
def box_corner(turn, half_x, half_y, half_z, corner):
    """Return a corner, 0 to 7, of a box as in `part_box`, from its middle: each bit of the number is a side of it."""
    u = half_x if corner & 1 else -half_x
    v = half_y if corner & 2 else -half_y
    w = half_z if corner & 4 else -half_z
    return turned(turn, u, v, w)


@kernel(inlined=True, allocates=False)
def seen_at(camera, px, py, pz):
    """Return the depth of a point at px, py, pz metres from the camera, and its position on the image plane."""
    ahead = px * camera.forward_x + py * camera.forward_y + pz * camera.forward_z
    inverse = f32(1) / max(ahead, f32(0.01))
    sx = (px * camera.right_x + py * camera.right_y) * inverse
    sy = (px * camera.up_x + py * camera.up_y + pz * camera.up_z) * inverse
    return ahead, sx, sy


@kernel(inlined=True, allocates=False)
def pixel_box(camera, hidden, low_x, high_x, low_y, high_y):
    """Return the columns from, to and rows from, to around a rectangle of the image plane, with a pixel around it; none
    if hidden."""
    wide, high = f32(camera.width), f32(camera.height)
    per_row = row_step(camera)
    c0, c1, r0, r1 = int32(0), int32(0), int32(0), int32(0)
    if not hidden:
        c0 = int32(clamp((low_x + camera.half_w) / camera.column_step - f32(1), f32(0), wide))
        c1 = int32(clamp((high_x + camera.half_w) / camera.column_step + f32(2), f32(0), wide))
        r0 = int32(clamp((camera.half_h - high_y) / per_row - f32(1), f32(0), high))
        r1 = int32(clamp((camera.half_h - low_y) / per_row + f32(2), f32(0), high))
    return c0, c1, r0, r1


@kernel(inlined=True, allocates=False)
def rows_of_box(box, top, rows):
    """Return the columns from, to of a box [4] and its rows from, to, counted from `top` and within so many rows, and
    the number of pixels."""
    r0 = max(box[2] - int32(top), int32(0))
    r1 = min(box[3] - int32(top), int32(rows))
    return box[0], box[1], r0, r1, max(box[1] - box[0], int32(0)) * max(r1 - r0, int32(0))


@kernel(inlined=True, allocates=False)
def within_box(box, top, place):
    """Return whether a place, whose row is counted from row `top` of the image, is in a rectangle of pixels [4]."""
    r = int32(top) + row_of(place)
    c = column_of(place)
    return (c >= box[0]) & (c < box[1]) & (r >= box[2]) & (r < box[3])
