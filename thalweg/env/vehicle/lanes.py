"""Lanes: from which points across a river the boat can go on, up and down the course, and whether it fits the river.

At each sample of the course a hull that is aligned with it is put to `LANE_POINTS` points from bank to bank. A point is
a way through if the hull floats there and reaches such a point at the next sample, aside by no more than `STEEPEST` of
the way: it steps aside by half a metre while it goes forward one. Lanes narrower than a step aside are none, because a
boat that misses one by less could not move into it.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.vehicle.boat import Boat, FitError
from thalweg.env.vehicle.hull import TOLERANCE_M, least_depth, touches_solid
from thalweg.env.vehicle.soundings import LANE_POINTS
from thalweg.world.record import World

STEEPEST = 0.4
"""Metres aside for each metre ahead."""


def lanes_through(courses: Any, limits: Any, boat: Boat, worlds: Sequence[World]) -> np.ndarray:
    """Return [S, 2, LANE_POINTS] uint8: 1 for points from which a way leads on, up and down the course.

    In a river where the boat can keep its margin of water below the keels all along, ways do. Raises `FitError` that
    names the river and the reach for one that it does not fit.
    """
    samples = len(courses.width)
    depth, solid = np.empty((samples, LANE_POINTS)), np.empty((samples, LANE_POINTS), np.uint8)
    sound_lanes(courses, limits, depth, solid)
    through = np.zeros((samples, 2, LANE_POINTS), np.uint8)
    for index, world in enumerate(worlds):
        rows = slice(courses.first_sample[index], courses.first_sample[index + 1])
        free = solid[rows] == 0
        clear = free & (depth[rows] >= limits.draught + limits.keel_margin)
        ways = spread(courses, index, wide_enough(clear, world.river.width_m, limits.lateral_step))
        if not ways[:, 0].any(axis=1).all():
            floating = free & (depth[rows] >= limits.draught)
            floats = wide_enough(floating, world.river.width_m, limits.lateral_step)
            ways = spread(courses, index, floats)
            if not ways[:, 0].any(axis=1).all():
                raise FitError(_where(courses, index, world, boat, floats, depth[rows], free))
        through[rows] = ways
    return through


@kernel(fastmath=False, allocates=False)
def sound_lanes(courses, limits, depth, solid):
    """Fill depth [S, P] float64, the least depth under an aligned hull in metres, and solid [S, P] uint8, 1 where it
    touches something, at P points across each sample of all worlds."""
    points = depth.shape[1]
    for world in range(len(courses.segments)):
        for row in range(courses.first_sample[world], courses.first_sample[world + 1]):
            yaw = math.atan2(courses.tangent[row, 1], courses.tangent[row, 0])
            for point in range(points):
                offset = courses.width[row] * (point / (points - 1) - 0.5)
                x = courses.position[row, 0] - offset * courses.tangent[row, 1]
                y = courses.position[row, 1] + offset * courses.tangent[row, 0]
                depth[row, point] = least_depth(courses, world, x, y, yaw, limits)
                solid[row, point] = 1 if touches_solid(courses, world, x, y, yaw, limits, 0.0) else 0


def wide_enough(free: np.ndarray, width_m: np.ndarray, least_m: float) -> np.ndarray:
    """Return the free points [S, P] uint8 that lie in a row of free ones which is at least `least_m` wide; width_m [S]
    is that of the river, across which the points lie."""
    kept = np.zeros(free.shape, np.uint8)
    _keep_wide(np.uint8(free), np.asarray(width_m, np.float64) / (free.shape[1] - 1), least_m - TOLERANCE_M, kept)
    return kept


@kernel(fastmath=False, allocates=False)
def _keep_wide(free, spacing, least, kept):
    """Set kept [S, P] to 1 in rows of free [S, P] points, `spacing` [S] metres apart, that are at least so wide."""
    samples, points = free.shape
    for sample in range(samples):
        begin = 0
        for point in range(points + 1):
            if point == points or free[sample, point] == 0:
                if point > begin and (point - 1 - begin) * spacing[sample] >= least:
                    for inside in range(begin, point):
                        kept[sample, inside] = 1
                begin = point + 1


def spread(courses: Any, world: int, free: np.ndarray) -> np.ndarray:
    """Return [S, 2, P] uint8: the points of a world, of those that are free [S, P] uint8, from which a way leads on to
    the end of the course, or round a loop for ever, up and down."""
    ways = np.repeat(free[:, None], 2, axis=1)
    _spread(courses, world, ways)
    return ways


@kernel(fastmath=False, allocates=False)
def _spread(courses, world, ways):
    """Remove from ways [S, 2, P] the points without a way on, until nothing changes."""
    first = courses.first_sample[world]
    count, _, points = ways.shape
    closed = courses.closed[world] != 0
    for way in range(2):
        travel = 1 if way == 0 else -1
        changed = True
        while changed:
            changed = False
            for step in range(count):
                sample = count - 1 - step if travel > 0 else step
                following = sample + travel
                if not closed and (following < 0 or following >= count):
                    continue
                following %= count
                row = first + sample
                after = first + following
                length = math.hypot(
                    courses.position[after, 0] - courses.position[row, 0],
                    courses.position[after, 1] - courses.position[row, 1],
                )
                for point in range(points):
                    if ways[sample, way, point] != 0:
                        offset = courses.width[row] * (point / (points - 1) - 0.5)
                        if not _reaches(courses.width[after], ways[following, way], offset, STEEPEST * length):
                            ways[sample, way, point] = 0
                            changed = True


@kernel(fastmath=False, allocates=False)
def _reaches(width, free, offset, aside):
    """Return whether one of the points free [P] across a width lies within `aside` metres of an offset."""
    last = len(free) - 1
    low = max(0, math.ceil(((offset - aside) / width + 0.5) * last - 1.0e-9))
    high = min(last, math.floor(((offset + aside) / width + 0.5) * last + 1.0e-9))
    for point in range(low, high + 1):  # noqa: SIM110 - kernels have no generators
        if free[point] != 0:
            return True
    return False


@kernel(fastmath=False, allocates=False)
def lies_in_lane(courses, row, way, left):
    """Return whether a way leads on from both points next to an offset `left` of the line, at the sample in a row; way
    0 is up the course, 1 down."""
    last = courses.through.shape[2] - 1
    exact = (left / courses.width[row] + 0.5) * last
    if not 0.0 <= exact <= last:
        return False
    point = min(int(exact), last - 1)
    return courses.through[row, way, point] != 0 and courses.through[row, way, point + 1] != 0


def _where(
    courses: Any, index: int, world: World, boat: Boat, floats: np.ndarray, depth: np.ndarray, free: np.ndarray
) -> str:
    """Return the sentence about the first reach of a world where the boat does not fit.

    floats [S, P] uint8, depth [S, P] in metres and free [S, P] bool as in `lanes_through`.
    """
    sample = _furthest(courses, index, floats)
    river = world.river
    if floats[sample].any():
        why = "what is deep and free enough before that and there is no way through"
    elif (free[sample] & (depth[sample] >= boat.draught_m)).any():
        why = "the lane that is deep and free enough is narrower than a step aside"
    elif (depth[sample] >= boat.draught_m).any():
        why = "bridges and rocks leave no passage"
    else:
        why = f"there are at most {max(float(depth[sample].max()), 0.0):.3f} m of water under all of the hull"
    return (
        f"{boat.words} does not fit {world.label}: at arc {river.arc_m[sample]:.0f} m, where the river is"
        f" {river.width_m[sample]:.1f} m wide and {river.depth_m[sample]:.2f} m deep in the middle, {why}"
    )


def _furthest(courses: Any, world: int, floats: np.ndarray) -> int:
    """Return the first sample that no way through free points [S, P] reaches from the beginning of the course."""
    first, count = int(courses.first_sample[world]), len(floats)
    reached = floats[0]
    laps = 3 if courses.closed[world] else 1
    for step in range(1, laps * count):
        sample, before = step % count, (step - 1) % count
        length = np.linalg.norm(courses.position[first + sample] - courses.position[first + before])
        offsets = [
            courses.width[first + each] * (np.linspace(0.0, 1.0, LANE_POINTS) - 0.5) for each in (sample, before)
        ]
        near = np.abs(offsets[0][:, None] - offsets[1]) <= STEEPEST * length
        if not reached.any():
            return (step - 1) % count
        reached = np.uint8((floats[sample] != 0) & (near & (reached != 0)).any(axis=1))
    return (laps * count - 1) % count
