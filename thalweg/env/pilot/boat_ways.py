"""Ways of the boat's pilot: from every point across the course that a way leads on from, where to go next.

They are the shortest ways that keep to the middle of the water the boat can use, found by dynamic programming over the
points of `thalweg.env.vehicle.lanes`.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.progress import sample_rows, segment_at_offset
from thalweg.env.vehicle.lanes import STEEPEST, sound_lanes

CLEARANCE_M = 1.5
"""Lateral distance to points without a way above which more has no value."""
CLEARANCE_WEIGHT = 1.0
"""Cost in metres of way, for each sample and square metre of missing clearance."""
SHALLOW_WEIGHT, FORD_WEIGHT = 20.0, 1.0
"""Penalty in segments of progress for each unit of cost that shallow water takes: more than a step can gain where there
is a way round it, and less where there is none."""
BLOCKED = 1.0e6
"""Cost of a point without a way; more than any way round it."""


class BoatWays(NamedTuple):
    """Ways through a batch of courses, one row for each of the S samples of all worlds; P points across."""

    onward: np.ndarray
    """[S, 2, P] int64, the point at the next sample to go to, up and down the course; of an open course's end, any."""
    missing: np.ndarray
    """[S, 2, P] float64, square metres of missing clearance; `BLOCKED` at points without a way."""
    dread: np.ndarray
    """[S, 2] float64, `SHALLOW_WEIGHT` where a way leads on over deep water, and `FORD_WEIGHT` where none does."""


def plan_boat_ways(courses: CourseArrays, config: EnvConfig) -> BoatWays:
    """Return the ways through a batch of courses."""
    limits, shape = config.limits, courses.through.shape
    depth, solid = np.empty((shape[0], shape[2])), np.empty((shape[0], shape[2]), np.uint8)
    sound_lanes(courses, limits, depth, solid)
    deep = (courses.through != 0) & (depth >= limits.draught + limits.keel_margin)[:, None]
    dread = np.where(deep.any(axis=2), SHALLOW_WEIGHT, FORD_WEIGHT)
    ways = BoatWays(np.zeros(shape, np.int64), np.empty(shape), dread)
    _fill_missing(courses, ways.missing)
    for world in range(len(courses.segments)):
        for way in range(2):
            _fill_onward(courses, world, ways.missing, way, ways.onward)
    return ways


@kernel(fastmath=False, allocates=False)
def offset_of(width, point, points):
    """Return how many metres a point of P lies to the left of the centre line, where the river has a width."""
    return width * (point / (points - 1) - 0.5)


@kernel(fastmath=False, allocates=False)
def place_of(courses, row, point):
    """Return x, y of a point across the sample in a row."""
    offset = offset_of(courses.width[row], point, courses.through.shape[2])
    x = courses.position[row, 0] - offset * courses.tangent[row, 1]
    y = courses.position[row, 1] + offset * courses.tangent[row, 0]
    return x, y


@kernel(fastmath=False, allocates=False)
def _fill_missing(courses, missing):
    """Fill missing [S, 2, P]."""
    samples, _, points = missing.shape
    for row in range(samples):
        for way in range(2):
            for point in range(points):
                # The distance to the nearest point without a way on either side; the banks have none.
                nearest = min(point, points - 1 - point) + 1
                for other in range(points):
                    if courses.through[row, way, other] == 0:
                        nearest = min(nearest, abs(other - point))
                short = max(CLEARANCE_M - nearest * courses.width[row] / (points - 1), 0.0)
                missing[row, way, point] = BLOCKED if nearest == 0 else short * short


@kernel(fastmath=False)
def _fill_onward(courses, world, missing, way, onward):
    """Fill the rows of a world in onward [S, way, P], from the end of the course or over three laps of a loop."""
    travel = 1 if way == 0 else -1
    first = courses.first_sample[world]
    count = courses.first_sample[world + 1] - first
    points = missing.shape[2]
    steps = 3 * count if courses.closed[world] != 0 else count - 1
    cost = np.zeros(points)
    best = np.empty(points)
    sample = 0 if courses.closed[world] != 0 or travel < 0 else count - 1
    for _ in range(steps):
        after = first + sample
        sample = (sample - travel) % count
        row = first + sample
        length = math.hypot(
            courses.position[after, 0] - courses.position[row, 0], courses.position[after, 1] - courses.position[row, 1]
        )
        for point in range(points):
            best[point] = 1.0e300
            x, y = place_of(courses, row, point)
            for following in range(points):
                next_x, next_y = place_of(courses, after, following)
                aside = abs(
                    offset_of(courses.width[after], following, points) - offset_of(courses.width[row], point, points)
                )
                total = cost[following] + math.hypot(next_x - x, next_y - y)
                total += CLEARANCE_WEIGHT * missing[after, way, following]
                if aside > STEEPEST * length:
                    total += BLOCKED * (aside - STEEPEST * length)
                if total < best[point]:
                    best[point] = total
                    onward[row, way, point] = following
        cost[:] = best


@kernel(fastmath=False, allocates=False)
def nearest_point(courses, ways, row, way, left):
    """Return the point with a way across the sample in a row that is nearest to an offset."""
    points = ways.missing.shape[2]
    exact = (left / courses.width[row] + 0.5) * (points - 1)
    nearest = min(max(round(exact), 0), points - 1)
    for away in range(points):
        for point in (nearest - away, nearest + away):
            if 0 <= point < points and ways.missing[row, way, point] < BLOCKED:
                return point
    return nearest


@kernel(fastmath=False, allocates=False)
def missing_clearance(courses, ways, row, way, left):
    """Return the square metres of missing clearance at an offset to the left of the line, at the sample in a row."""
    points = ways.missing.shape[2]
    exact = min(max((left / courses.width[row] + 0.5) * (points - 1), 0.0), points - 1.0)
    point = min(int(exact), points - 2)
    share = exact - point
    worst = 2.0 * CLEARANCE_M * CLEARANCE_M
    lower = min(ways.missing[row, way, point], worst)
    upper = min(ways.missing[row, way, point + 1], worst)
    return (1.0 - share) * lower + share * upper


@kernel(fastmath=False, allocates=False)
def pursued_point(courses, world, projection, travel, ways, left, lookahead, pose):
    """Return (angle, dx, dy) from a `Pose` to the first point of the way from there that is at least `lookahead` metres
    away.

    projection, left: where the pose is along the course, and metres to the left of its line.
    """
    way = 0 if travel > 0 else 1
    segment = projection.segment
    a, b = sample_rows(courses, world, segment)
    row = b if travel > 0 else a
    point = nearest_point(courses, ways, row, way, left)
    dx = 0.0
    dy = 0.0
    for _ in range(courses.segments[world]):
        x, y = place_of(courses, row, point)
        dx = x - pose.x
        dy = y - pose.y
        segment = segment_at_offset(courses, world, segment, travel)
        if segment < 0 or dx * dx + dy * dy >= lookahead * lookahead:
            break
        point = ways.onward[row, way, point]
        a, b = sample_rows(courses, world, segment)
        row = b if travel > 0 else a
    return math.atan2(dy, dx), dx, dy
