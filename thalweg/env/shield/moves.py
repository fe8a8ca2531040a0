"""Judgement of moves: whether a move would leave the remembered water, the band of heights or the way flown."""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.shield.water_map import GUESS, odds_at, was_veiled
from thalweg.env.task.motion import Pose, UnitAction, metres_forward, move, wrap_angle

PERMITTED, LAND, DEAD_END, HEIGHT, TURN = range(5)
"""Why a move is vetoed: it leaves the water, or comes nearer to the shore than the margin; no flight goes on after it;
it leaves the band of heights; it turns away from the way flown."""
VERDICTS = ("permitted", "land", "dead end", "height", "turn")
"""Names of the codes."""
ROPE_M = 3.0
"""The way flown is the direction of a rope of this length that the vehicle tows."""
SIGNS = (0.0, 1.0, -1.0)
ROUND = 8
"""Points of a circle of the margin, or about a descent."""
DECK_M = 1.0
"""Below the floor no vehicle descends within this distance of a cell that something raised hid: it may be over a
bridge."""


class Bounds(NamedTuple):
    """Settings of the shield, and the limits of the task, as the kernels take them: metres and radians."""

    margin: float
    lookahead: int
    unknown_is_water: int
    """1 or 0."""
    patience: int
    lowest: float
    """Heights between which moves may go."""
    highest: float
    floor: float
    """Height below which moves that lead across must climb."""
    max_turn: float


class Vehicles(NamedTuple):
    """Where N vehicles are by their odometry, which begins at each start."""

    pose: np.ndarray
    """[N, 4] float64: x, y in metres, the height above the water, and the heading in radians."""
    tail: np.ndarray
    """[N, 2] float64, the other end of the towed rope."""
    held: np.ndarray
    """[N] int64, moves forward in a row that were not made."""


@kernel(fastmath=False, allocates=False)
def is_closed(maps, row, bounds, guesses, x, y):
    """Return whether the cell at a point is none to fly over; guesses: whether what may be a bridge counts as land."""
    odds = odds_at(maps, row, x, y)
    if odds == 0:
        return bounds.unknown_is_water == 0
    return odds < (0 if guesses else GUESS)


@kernel(fastmath=False, allocates=False)
def closed_around(maps, row, bounds, guesses, x, y):
    """Return how many points of the circle of the margin about a point are closed."""
    count = 0
    for k in range(ROUND):
        angle = 2.0 * math.pi * k / ROUND
        dx, dy = bounds.margin * math.cos(angle), bounds.margin * math.sin(angle)
        if is_closed(maps, row, bounds, guesses, x + dx, y + dy):
            count += 1
    return count


@kernel(fastmath=False, allocates=False)
def leaves_water(maps, row, bounds, guesses, before, after):
    """Return whether a move between two `Pose`s ends over a closed cell, or nearer to one than the margin and than it
    began."""
    if before.x == after.x and before.y == after.y:
        return False
    if is_closed(maps, row, bounds, guesses, after.x, after.y):
        return True
    if bounds.margin <= 0.0:
        return False
    around = closed_around(maps, row, bounds, guesses, after.x, after.y)
    return around > 0 and around > closed_around(maps, row, bounds, guesses, before.x, before.y)


@kernel(fastmath=False, allocates=False)
def flight_goes_on(maps, row, bounds, limits, pose):
    """Return whether the vehicle can fly forward for `lookahead` steps after a `Pose`, and turn or step aside in each.

    What may be a bridge does not count: one shows what it is when the vehicle comes near. All ways are tried, in the
    order of the digits of a number.
    """
    options = 9
    count = options**bounds.lookahead
    way = 0
    while way < count:
        at = pose
        left = way
        block = count
        blocked = False
        for _ in range(bounds.lookahead):
            block //= options
            digit = left // block
            left -= digit * block
            action = UnitAction(0.0, SIGNS[digit % 3], 1.0, SIGNS[digit // 3])
            after = move(at, action, limits)
            if leaves_water(maps, row, bounds, False, at, after):
                blocked = True
                break
            at = after
        if not blocked:
            return True
        # All ways that begin like this one are blocked too.
        way += block - left
    return False


@kernel(fastmath=False, allocates=False)
def may_be_over_bridge(maps, row, pose):
    """Return whether something raised hid a cell that is at a `Pose`, or `DECK_M` from it."""
    if was_veiled(maps, row, pose.x, pose.y):
        return True
    for k in range(ROUND):
        angle = 2.0 * math.pi * k / ROUND
        if was_veiled(maps, row, pose.x + DECK_M * math.cos(angle), pose.y + DECK_M * math.sin(angle)):
            return True
    return False


@kernel(fastmath=False, allocates=False)
def way_flown(vehicles, row):
    """Return whether the towed rope is taut, and its direction in radians."""
    dx = vehicles.pose[row, 0] - vehicles.tail[row, 0]
    dy = vehicles.pose[row, 1] - vehicles.tail[row, 1]
    return math.hypot(dx, dy) >= ROPE_M - 1e-9, math.atan2(dy, dx)


@kernel(fastmath=False, allocates=False)
def judge(maps, vehicles, row, bounds, limits, action):
    """Return the verdict on a `UnitAction` of vehicle `row`: `PERMITTED`, or the first reason for a veto."""
    before = Pose(vehicles.pose[row, 0], vehicles.pose[row, 1], vehicles.pose[row, 2], vehicles.pose[row, 3])
    after = move(before, action, limits)
    guesses = vehicles.held[row] < bounds.patience
    if leaves_water(maps, row, bounds, guesses, before, after):
        return LAND
    if (bounds.lowest > after.z < before.z) or (bounds.highest < after.z > before.z):
        return HEIGHT
    across = before.x != after.x or before.y != after.y
    if bounds.floor > after.z:
        if across and after.z <= before.z:
            return HEIGHT
        if after.z < before.z and may_be_over_bridge(maps, row, after):
            return HEIGHT
    taut, way = way_flown(vehicles, row)
    off = abs(wrap_angle(after.yaw - way))
    if taut and off > bounds.max_turn and off > abs(wrap_angle(before.yaw - way)):
        return TURN
    if bounds.lookahead > 0 and across and not flight_goes_on(maps, row, bounds, limits, after):
        return DEAD_END
    return PERMITTED


@kernel(fastmath=False, allocates=False)
def change_of(vehicles, row, limits, action, other):
    """Return how much two moves of vehicle `row` differ: the distance of the places they lead to in metres, and the
    angle between the headings in radians."""
    before = Pose(vehicles.pose[row, 0], vehicles.pose[row, 1], vehicles.pose[row, 2], vehicles.pose[row, 3])
    a, b = move(before, action, limits), move(before, other, limits)
    return math.sqrt((a.x - b.x) ** 2 + (a.y - b.y) ** 2 + (a.z - b.z) ** 2) + abs(wrap_angle(a.yaw - b.yaw))


@kernel(fastmath=False, allocates=False)
def advance(vehicles, row, limits, proposed, verdict, action):
    """Move vehicle `row` by a `UnitAction` in place of the proposed one, on which the verdict was passed, and the rope
    with it."""
    if metres_forward(action, limits) > 0.0:
        vehicles.held[row] = 0
    elif metres_forward(proposed, limits) > 0.0 and verdict != HEIGHT:
        vehicles.held[row] += 1
    before = Pose(vehicles.pose[row, 0], vehicles.pose[row, 1], vehicles.pose[row, 2], vehicles.pose[row, 3])
    after = move(before, action, limits)
    vehicles.pose[row, 0], vehicles.pose[row, 1], vehicles.pose[row, 2], vehicles.pose[row, 3] = after
    dx, dy = after.x - vehicles.tail[row, 0], after.y - vehicles.tail[row, 1]
    length = math.hypot(dx, dy)
    if length > ROPE_M:
        vehicles.tail[row, 0] = after.x - ROPE_M * dx / length
        vehicles.tail[row, 1] = after.y - ROPE_M * dy / length
