"""The remembered water: maps of odds around vehicles, filled from the water masks of their cameras.

A map lies in the coordinates of its vehicle's odometry and is never resampled: the vehicle moves through it. It holds
the cells within a window that moves along, stored at their indices modulo its size.

What a mask shows as water is the surface seen at that point. What is not water may be land, or hide the water behind
it, as trees and bridges do. Water seen is therefore believed for long, and land only where no water was ever seen.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel

CELL_M = 0.25
"""Edge of a cell."""
SIZE = 256
"""Cells along each side of a window, a power of two: 64 m."""
RANGE_M = 24.0
"""Greatest distance ahead that is read from a mask."""
FINEST_M = 0.5
"""Greatest length of water that a pixel may cover to be read."""
WATER, DRY = 8, 1
"""Odds that one look adds for water and takes for anything else: a cell that was seen to be water once is dry after nine
looks that show none."""
MOST, LEAST = 24, -4
"""Bounds of the odds."""
BELIEVED = 2 * WATER
"""Odds from which a cell is remembered as water."""
HIDDEN_M = 0.6
"""Metres of remembered water along the sight that are hidden by what is taken for a veil."""
UNREAD, WET, LAND, NEAR, VEIL, UNDECIDED, REVEALING = range(7)
"""What a pixel says: nothing; water; land beyond water; land, without water before it; a veil, which may hide water; not
known yet."""


class WaterMaps(NamedTuple):
    """Maps of N vehicles."""

    odds: np.ndarray
    """[N, SIZE, SIZE] int8: positive for water, negative for dry, 0 for unknown; cell (i, j) of the odometry's plane is
    at its indices modulo SIZE."""
    corner: np.ndarray
    """[N, 2] int64, the first cell of the window along x and y."""
    veiled: np.ndarray
    """[N, SIZE, SIZE] uint8, 1 where a veil, such as a bridge, hid the cell."""


class Optics(NamedTuple):
    """Cameras of N vehicles."""

    pitch: np.ndarray
    """[N] float64, radians down from the horizon."""
    half_width: np.ndarray
    """[N] float64, half the width of the image plane at distance one, and half its height."""
    half_height: np.ndarray


def empty_maps(count: int) -> WaterMaps:
    """Return maps of N vehicles that have seen nothing, each at the origin of its odometry."""
    shape = count, SIZE, SIZE
    return WaterMaps(np.zeros(shape, np.int8), np.full((count, 2), -SIZE // 2, np.int64), np.zeros(shape, np.uint8))


class Camera(NamedTuple):
    """A camera at a pose, for the plane of the water."""

    cos: float
    """Of the heading, and of the pitch."""
    sin: float
    cos_p: float
    sin_p: float
    half_w: float
    """Half the width and height of the image plane at distance one, and the sides of a pixel."""
    half_h: float
    pixel_w: float
    pixel_h: float
    furthest: float
    """Metres ahead that are read."""


@kernel(fastmath=False, allocates=False)
def cell_of(metres):
    """Return the index of the cell that holds a coordinate."""
    return int(math.floor(metres / CELL_M))


@kernel(fastmath=False, allocates=False)
def odds_at(maps, row, x, y):
    """Return the odds of the cell that holds a point of vehicle `row`; 0 outside its window."""
    i = cell_of(x)
    j = cell_of(y)
    u = i - maps.corner[row, 0]
    v = j - maps.corner[row, 1]
    if u < 0 or v < 0 or u >= SIZE or v >= SIZE:
        return 0
    return int(maps.odds[row, i & (SIZE - 1), j & (SIZE - 1)])


@kernel(fastmath=False, allocates=False)
def forget(maps, row):
    """Forget everything about vehicle `row`, which is at the origin of its odometry."""
    maps.odds[row] = 0
    maps.veiled[row] = 0
    maps.corner[row] = -SIZE // 2


@kernel(fastmath=False, allocates=False)
def follow(maps, row, x, y):
    """Move the window of vehicle `row` to have the vehicle in its middle; what leaves it is forgotten."""
    first = cell_of(x) - SIZE // 2, cell_of(y) - SIZE // 2
    shift = first[0] - maps.corner[row, 0]
    for k in range(min(abs(shift), SIZE)):
        # A cell that enters takes the place of the one that leaves at the other side.
        u = (maps.corner[row, 0] + k if shift > 0 else first[0] + k) & (SIZE - 1)
        maps.odds[row, u], maps.veiled[row, u] = 0, 0
    shift = first[1] - maps.corner[row, 1]
    for k in range(min(abs(shift), SIZE)):
        v = (maps.corner[row, 1] + k if shift > 0 else first[1] + k) & (SIZE - 1)
        maps.odds[row, :, v], maps.veiled[row, :, v] = 0, 0
    maps.corner[row, 0], maps.corner[row, 1] = first


@kernel(fastmath=False, allocates=False)
def look(maps, row, pose, optics, mask, seen):
    """Enter a mask [H, W] uint8, seen by vehicle `row` at a `Pose` whose z is its height above the water.

    Each cell of the water's plane takes the pixel that its middle falls on. seen: scratch [H, W] uint8.
    """
    camera = posed(pose, row, optics, mask)
    if camera.furthest <= 0.0:
        return
    for column in range(mask.shape[1]):
        read_column(maps, row, pose, camera, mask, column, seen)
    # What is in view lies in a trapezium, half as wide as this at the vehicle and at the furthest line.
    near = camera.half_w * pose.z * max(camera.sin_p, 0.0)
    far = camera.half_w * (camera.furthest * camera.cos_p + pose.z * camera.sin_p)
    ax, ay = abs(near * camera.sin), abs(near * camera.cos)
    bx, by = abs(far * camera.sin), abs(far * camera.cos)
    x, y = camera.furthest * camera.cos, camera.furthest * camera.sin
    corner = maps.corner[row]
    first = max(cell_of(pose.x + min(-ax, x - bx)), corner[0]), max(cell_of(pose.y + min(-ay, y - by)), corner[1])
    last = cell_of(pose.x + max(ax, x + bx)), cell_of(pose.y + max(ay, y + by))
    for i in range(first[0], min(last[0], corner[0] + SIZE - 1) + 1):
        for j in range(first[1], min(last[1], corner[1] + SIZE - 1) + 1):
            line, column = pixel_of(camera, pose, (i + 0.5) * CELL_M - pose.x, (j + 0.5) * CELL_M - pose.y)
            if 0 <= column < mask.shape[1] and 0 <= line < mask.shape[0]:
                enter(maps, row, i & (SIZE - 1), j & (SIZE - 1), seen[line, column])


@kernel(fastmath=False, allocates=False)
def posed(pose, row, optics, mask):
    """Return the `Camera` of vehicle `row` at a `Pose`."""
    height, width = mask.shape
    cos_p, sin_p = math.cos(optics.pitch[row]), math.sin(optics.pitch[row])
    half_w, half_h = optics.half_width[row], optics.half_height[row]
    pixel_w, pixel_h = 2.0 * half_w / width, 2.0 * half_h / height
    # A pixel covers pixel_h * depth² / z metres of water along the sight: beyond this depth it covers too much.
    deepest = math.sqrt(FINEST_M * max(pose.z, 0.0) / pixel_h)
    furthest = min((deepest - pose.z * sin_p) / max(cos_p, 1e-6), RANGE_M)
    return Camera(math.cos(pose.yaw), math.sin(pose.yaw), cos_p, sin_p, half_w, half_h, pixel_w, pixel_h, furthest)


@kernel(fastmath=False, allocates=False)
def pixel_of(camera, pose, dx, dy):
    """Return line and column of the pixel that sees the point of the water dx, dy metres from a `Pose`, or -1, -1."""
    ahead = dx * camera.cos + dy * camera.sin
    depth = ahead * camera.cos_p + pose.z * camera.sin_p
    if ahead <= 0.0 or ahead > camera.furthest or depth <= 0.0:
        return -1, -1
    right = dx * camera.sin - dy * camera.cos
    column = int(math.floor((right / depth + camera.half_w) / camera.pixel_w))
    up = (ahead * camera.sin_p - pose.z * camera.cos_p) / depth
    return int(math.floor((camera.half_h - up) / camera.pixel_h)), column


@kernel(fastmath=False, allocates=False)
def read_column(maps, row, pose, camera, mask, column, seen):
    """Fill a column of seen [H, W] with what its pixels say about the water's plane, from the nearest to the furthest.

    Something raised, such as a bridge, hides water that was seen before, and hides more of it the nearer it is: where
    what is not water begins with water that is remembered, it is a veil, and says nothing about the ground behind it.
    """
    run = UNREAD
    first = 0
    hidden, revealed = 0.0, 0.0
    met_water = False
    for line in range(mask.shape[0] - 1, -1, -1):
        seen[line, column] = UNREAD
        up = camera.half_h - (line + 0.5) * camera.pixel_h
        fall = camera.sin_p - up * camera.cos_p
        if fall <= 0.0:
            continue
        depth = pose.z / fall
        ahead = depth * (camera.cos_p + up * camera.sin_p)
        if ahead > camera.furthest:
            continue
        right = depth * ((column + 0.5) * camera.pixel_w - camera.half_w)
        x = pose.x + ahead * camera.cos + right * camera.sin
        y = pose.y + ahead * camera.sin - right * camera.cos
        odds = odds_at(maps, row, x, y)
        covered = camera.pixel_h * depth * depth / pose.z
        if mask[line, column] != 0:
            if run == NEAR or run == REVEALING:
                # Water comes out from behind a veil, where land was remembered.
                revealed = revealed + covered if run == REVEALING else covered
                run = REVEALING if odds < 0 else UNREAD
                if run == REVEALING and revealed >= HIDDEN_M:
                    run = UNREAD
                    for earlier in range(first, 0, -1):
                        if seen[earlier, column] != NEAR:
                            break
                        seen[earlier, column] = VEIL
            else:
                run = UNREAD
            met_water = True
            if shows_water(mask, line, column):
                seen[line, column] = WET
            continue
        if run == UNREAD or run == REVEALING:
            run, first, hidden = UNDECIDED, line, 0.0
        if run == UNDECIDED:
            if odds >= BELIEVED:
                hidden += covered
                run = VEIL if hidden >= HIDDEN_M else UNDECIDED
            else:
                run = LAND if met_water else NEAR
            if run != UNDECIDED:
                for earlier in range(first, line, -1):
                    seen[earlier, column] = run
        seen[line, column] = run


@kernel(fastmath=False, allocates=False)
def shows_water(mask, line, column):
    """Return whether the pixels beside and beyond one of water are water too, so that no shore crosses its cell."""
    return (
        mask[max(line - 1, 0), column] != 0
        and mask[line, max(column - 1, 0)] != 0
        and mask[line, min(column + 1, mask.shape[1] - 1)] != 0
    )


@kernel(fastmath=False, allocates=False)
def enter(maps, row, u, v, sight):
    """Enter what is seen of the cell at the indices u, v."""
    odds = int(maps.odds[row, u, v])
    if sight == WET:
        maps.odds[row, u, v] = min(odds + WATER, MOST)
    elif sight == LAND or (sight == NEAR and maps.veiled[row, u, v] == 0):
        maps.odds[row, u, v] = max(odds - DRY, LEAST)
    elif sight == VEIL:
        maps.veiled[row, u, v] = 1
        # What was taken for land behind the veil is taken back.
        maps.odds[row, u, v] = max(odds, 0)


@kernel(fastmath=False, allocates=False)
def stand(maps, row, pose):
    """Enter that vehicle `row` flies over water at a `Pose`: had it left the water, its flight would have ended."""
    enter(maps, row, cell_of(pose.x) & (SIZE - 1), cell_of(pose.y) & (SIZE - 1), WET)
