"""The remembered water: maps of odds around vehicles, in the coordinates of their odometry.

A map is never resampled: the vehicle moves through it. It holds the cells within a window that moves along, stored at
their indices modulo its size.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel

CELL_M = 0.25
"""Edge of a cell."""
SIZE = 256
"""Cells along each side of a window, a power of two: 64 m."""
WATER, DRY = 8, 1
"""Odds that one look adds for water, and takes for anything else. Something may hide water, but nothing looks like it:
a cell that was seen to be water once is dry after nine looks that show none."""
MOST, LEAST = 24, -4
"""Bounds of the odds."""
GUESS = -2
"""Odds down to which a cell goes that was seen to be dry, but never with water before it, which may be behind something
that has always stood there."""
BELIEVED = 2 * WATER
"""Odds from which a cell is remembered as water."""
UNREAD, WET, LAND, NEAR, VEIL = range(5)
"""What is seen of a cell: nothing; water; land behind water; land with no water before it; something raised, which may
hide water."""


class WaterMaps(NamedTuple):
    """Maps of N vehicles."""

    odds: np.ndarray
    """[N, SIZE, SIZE] int8: positive for water, negative for dry, 0 for unknown; cell (i, j) of the odometry's plane is
    at its indices modulo SIZE."""
    corner: np.ndarray
    """[N, 2] int64, the first cell of the window along x and y."""
    veiled: np.ndarray
    """[N, SIZE, SIZE] uint8, 1 where something raised, such as a bridge, hid the cell."""


def empty_maps(count: int) -> WaterMaps:
    """Return maps of N vehicles that have seen nothing, each at the origin of its odometry."""
    shape = count, SIZE, SIZE
    return WaterMaps(np.zeros(shape, np.int8), np.full((count, 2), -SIZE // 2, np.int64), np.zeros(shape, np.uint8))


@kernel(fastmath=False, allocates=False)
def cell_of(metres):
    """Return the index of the cell that holds a coordinate."""
    return math.floor(metres / CELL_M)


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
def was_veiled(maps, row, x, y):
    """Return whether something raised hid the cell that holds a point of vehicle `row`; False outside its window."""
    i = cell_of(x)
    j = cell_of(y)
    u = i - maps.corner[row, 0]
    v = j - maps.corner[row, 1]
    if u < 0 or v < 0 or u >= SIZE or v >= SIZE:
        return False
    return maps.veiled[row, i & (SIZE - 1), j & (SIZE - 1)] != 0


@kernel(fastmath=False, allocates=False)
def enter(maps, row, i, j, seen):
    """Enter what is seen of a cell of the window."""
    u, v = i & (SIZE - 1), j & (SIZE - 1)
    odds = int(maps.odds[row, u, v])
    if seen == WET:
        maps.odds[row, u, v] = min(odds + WATER, MOST)
    elif seen == LAND:
        maps.odds[row, u, v] = max(odds - DRY, LEAST)
    elif seen == NEAR and maps.veiled[row, u, v] == 0 and odds > GUESS:
        maps.odds[row, u, v] = odds - DRY
    elif seen == VEIL:
        # What was taken for land is taken back.
        maps.odds[row, u, v] = max(odds, 0)
        maps.veiled[row, u, v] = 1


@kernel(fastmath=False, allocates=False)
def enter_own_place(maps, row, x, y):
    """Enter that vehicle `row` flies over water: had it left the water, its flight would have ended."""
    enter(maps, row, cell_of(x), cell_of(y), WET)


@kernel(fastmath=False, allocates=False)
def forget(maps, row):
    """Forget everything about vehicle `row`, which is at the origin of its odometry."""
    maps.odds[row] = 0
    maps.veiled[row] = 0
    maps.corner[row] = -SIZE // 2


@kernel(fastmath=False, allocates=False)
def follow(maps, row, x, y):
    """Move the window of vehicle `row` to have the vehicle in its middle; what leaves it is forgotten."""
    first_x, first_y = cell_of(x) - SIZE // 2, cell_of(y) - SIZE // 2
    # Cells that enter at one side take the places of those that leave at the other.
    shift = first_x - maps.corner[row, 0]
    begin = maps.corner[row, 0] if shift > 0 else first_x
    for k in range(min(abs(shift), SIZE)):
        u = (begin + k) & (SIZE - 1)
        maps.odds[row, u], maps.veiled[row, u] = 0, 0
    shift = first_y - maps.corner[row, 1]
    begin = maps.corner[row, 1] if shift > 0 else first_y
    for k in range(min(abs(shift), SIZE)):
        v = (begin + k) & (SIZE - 1)
        maps.odds[row, :, v], maps.veiled[row, :, v] = 0, 0
    maps.corner[row, 0], maps.corner[row, 1] = first_x, first_y
