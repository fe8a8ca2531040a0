"""Sight: what the pixels of a water mask say about the plane of the water, entered into a map.

A pixel of water is the surface at the point where its ray meets the plane. One of anything else is land there, or
something raised before it, such as a tree or a bridge, which may hide water. Parallax tells them apart: what is raised
hides water that was seen before, or uncovers water where land was taken to be.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.shield.water_map import (
    BELIEVED,
    CELL_M,
    LAND,
    NEAR,
    SIZE,
    UNREAD,
    VEIL,
    WET,
    cell_of,
    enter,
    odds_at,
)

RANGE_M = 24.0
"""Greatest distance ahead that is read."""
COARSEST_M = 0.5
"""Greatest length of water that a pixel that is read may cover."""
PARALLAX_M = 0.6
"""Metres along the sight that must be hidden, or uncovered, for something to count as raised."""


class Optics(NamedTuple):
    """Cameras of N vehicles."""

    pitch: np.ndarray
    """[N] float64, radians down from the horizon."""
    half_width: np.ndarray
    """[N] float64, half the width of the image plane at distance one."""
    half_height: np.ndarray
    """[N] float64, half its height."""


class Camera(NamedTuple):
    """A camera over the plane of the water."""

    x: float
    """Metres, by odometry, as the next."""
    y: float
    height: float
    """Metres above the water."""
    cos: float
    """Cosine of the heading."""
    sin: float
    cos_p: float
    """Cosine of the pitch."""
    sin_p: float
    half_w: float
    """Half the width of the image plane at distance one."""
    half_h: float
    pixel_w: float
    """Width of a pixel on the image plane."""
    pixel_h: float
    furthest: float
    """Metres ahead that are read; none if it is not positive."""


class Ground(NamedTuple):
    """Where the ray of a pixel meets the plane of the water."""

    x: float
    y: float
    covered: float
    """Metres of the plane along the sight that the pixel covers."""


@kernel(fastmath=False, allocates=False)
def camera_at(pose, optics, row, height_px, width_px):
    """Return the `Camera` of vehicle `row` at a `Pose` whose z is its height above the water."""
    cos_p, sin_p = math.cos(optics.pitch[row]), math.sin(optics.pitch[row])
    half_w, half_h = optics.half_width[row], optics.half_height[row]
    pixel_h = 2.0 * half_h / height_px
    # A pixel covers pixel_h * depth² / height metres: beyond this depth it covers too much.
    deepest = math.sqrt(COARSEST_M * max(pose.z, 0.0) / pixel_h)
    furthest = min((deepest - pose.z * sin_p) / max(cos_p, 1e-6), RANGE_M)
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    pixel_w = 2.0 * half_w / width_px
    return Camera(
        pose.x, pose.y, pose.z, cos, sin, cos_p, sin_p, half_w, half_h, pixel_w, pixel_h, furthest
    )  # fmt: skip


@kernel(fastmath=False, allocates=False)
def pixel_of(camera, x, y):
    """Return line and column of the pixel that sees a point of the water, which may lie beside the image, or -1, -1 for
    one that is not read."""
    dx, dy = x - camera.x, y - camera.y
    ahead = dx * camera.cos + dy * camera.sin
    depth = ahead * camera.cos_p + camera.height * camera.sin_p
    if ahead <= 0.0 or ahead > camera.furthest or depth <= 0.0:
        return -1, -1
    right = dx * camera.sin - dy * camera.cos
    up = (ahead * camera.sin_p - camera.height * camera.cos_p) / depth
    return (
        math.floor((camera.half_h - up) / camera.pixel_h),
        math.floor((right / depth + camera.half_w) / camera.pixel_w),
    )


@kernel(fastmath=False, allocates=False)
def ground_of(camera, line, column):
    """Return the `Ground` of a pixel below the horizon."""
    up = camera.half_h - (line + 0.5) * camera.pixel_h
    depth = camera.height / (camera.sin_p - up * camera.cos_p)
    ahead = depth * (camera.cos_p + up * camera.sin_p)
    right = depth * ((column + 0.5) * camera.pixel_w - camera.half_w)
    return Ground(
        camera.x + ahead * camera.cos + right * camera.sin,
        camera.y + ahead * camera.sin - right * camera.cos,
        camera.pixel_h * depth * depth / camera.height,
    )


@kernel(fastmath=False, allocates=False)
def top_line(camera):
    """Return the first line whose middle is read; the lines below it are read too."""
    depth = camera.furthest * camera.cos_p + camera.height * camera.sin_p
    up = (camera.furthest * camera.sin_p - camera.height * camera.cos_p) / depth
    return max(math.ceil((camera.half_h - up) / camera.pixel_h - 0.5), 0)


@kernel(fastmath=False, allocates=False)
def read_column(maps, row, camera, top, mask, column, seen):
    """Fill a column of seen [H, W], from line `top` down, with what its pixels say about the ground.

    Runs of pixels that are not water are judged as one, from the nearest to the furthest.
    """
    met_water = False
    line = mask.shape[0] - 1
    while line >= top:
        if mask[line, column] != 0:
            met_water = True
            seen[line, column] = WET if shows_water(mask, line, column) else UNREAD
            line -= 1
            continue
        end = line
        while end >= top and mask[end, column] == 0:
            end -= 1
        kind = LAND if met_water else NEAR
        raised = hides_water(maps, row, camera, column, line, end)
        if raised or (kind == NEAR and uncovers_water(maps, row, camera, top, mask, column, end)):
            kind = VEIL
        while line > end:
            seen[line, column] = kind
            line -= 1


@kernel(fastmath=False, allocates=False)
def shows_water(mask, line, column):
    """Return whether the pixels beside and beyond one of water are water too, so that no shore crosses its cell."""
    return (
        mask[max(line - 1, 0), column] != 0
        and mask[line, max(column - 1, 0)] != 0
        and mask[line, min(column + 1, mask.shape[1] - 1)] != 0
    )


@kernel(fastmath=False, allocates=False)
def hides_water(maps, row, camera, column, first, end):
    """Return whether a run of no water, from line `first` up to `end`, begins where water is remembered."""
    hidden = 0.0
    for line in range(first, end, -1):
        ground = ground_of(camera, line, column)
        if odds_at(maps, row, ground.x, ground.y) < BELIEVED:
            return False
        hidden += ground.covered
        if hidden >= PARALLAX_M:
            return True
    return False


@kernel(fastmath=False, allocates=False)
def uncovers_water(maps, row, camera, top, mask, column, end):
    """Return whether the water that is seen from line `end` up lies where land was taken to be."""
    uncovered = 0.0
    for line in range(end, top - 1, -1):
        ground = ground_of(camera, line, column)
        if mask[line, column] == 0 or odds_at(maps, row, ground.x, ground.y) >= 0:
            return False
        uncovered += ground.covered
        if uncovered >= PARALLAX_M:
            return True
    return False


@kernel(fastmath=False, allocates=False)
def cells_in_view(maps, row, camera):
    """Return the first and the last cell, each along x and y, of a box about the ground in view, within the window."""
    # That ground is a trapezium: half as wide as this at the vehicle and at the furthest line.
    near = camera.half_w * camera.height * max(camera.sin_p, 0.0)
    far = camera.half_w * (camera.furthest * camera.cos_p + camera.height * camera.sin_p)
    x, y = camera.furthest * camera.cos, camera.furthest * camera.sin
    near_x, near_y = near * abs(camera.sin), near * abs(camera.cos)
    far_x, far_y = far * abs(camera.sin), far * abs(camera.cos)
    corner_x, corner_y = maps.corner[row, 0], maps.corner[row, 1]
    first = (
        max(cell_of(camera.x + min(-near_x, x - far_x)), corner_x),
        max(cell_of(camera.y + min(-near_y, y - far_y)), corner_y),
    )
    last = (
        min(cell_of(camera.x + max(near_x, x + far_x)), corner_x + SIZE - 1),
        min(cell_of(camera.y + max(near_y, y + far_y)), corner_y + SIZE - 1),
    )
    return first, last


@kernel(fastmath=False, allocates=False)
def look(maps, row, pose, optics, mask, seen):
    """Enter a mask [H, W] uint8 that vehicle `row` sees at a `Pose` whose z is its height above the water.

    Each cell takes what the pixel says that its middle falls on. seen: scratch [H, W] uint8.
    """
    height, width = mask.shape
    camera = camera_at(pose, optics, row, height, width)
    if camera.furthest <= 0.0:
        return
    top = top_line(camera)
    for column in range(width):
        read_column(maps, row, camera, top, mask, column, seen)
    first, last = cells_in_view(maps, row, camera)
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            line, column = pixel_of(camera, (i + 0.5) * CELL_M, (j + 0.5) * CELL_M)
            if top <= line < height and 0 <= column < width:
                enter(maps, row, i, j, seen[line, column])
