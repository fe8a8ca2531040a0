"""Ways of the steady pilot: from every point across the course, where to fly next, up and down the course.

They are the shortest ways, missing clearance from banks and islands counted as detours, found by dynamic programming
over points across each sample. A pilot on either side of an island finds its way along that side.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.pilot.heights import plan_heights
from thalweg.env.pilot.points_across import hindrance, offset_of
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.progress import sample_rows, segment_at_offset
from thalweg.env.task.termination import island_at

POINTS_ACROSS = 25
"""Points across the river at each sample."""
MARGIN_M = 0.5
"""Distance of the outer points from the banks where the river is wide enough."""
MARGIN_SHARE = 0.25
"""The same as a share of the width, where that is less."""
CLEARANCE_M = 4.0
"""Lateral clearance above which more clearance has no value."""
CLEARANCE_WEIGHT = 0.3
"""Cost in metres of way, for each sample and square metre of missing clearance."""
RING_M, SIDES = 0.5, 16
"""Rings around a point, and directions, in which islands are searched."""
CRUISE_M = 4.5
"""Height above the water, which clears every bridge of the levels."""
LAND = 1.0e6
"""Cost of a point on an island; more than any way round it."""


class Ways(NamedTuple):
    """Ways through a batch of courses, one row for each of the S samples of all worlds; P points across."""

    reach: np.ndarray
    """[S] float64, metres from the centre line to the outer points; the others divide the distance evenly."""
    onward: np.ndarray
    """[S, 2, P] int64, the point at the next sample to fly to, up and down the course; of an open course's end, any."""
    excess: np.ndarray
    """[S, P] float64, square metres of missing clearance beyond the least across the sample; `LAND` on islands."""
    height: np.ndarray
    """[S] float64, metres: z to fly at."""
    lowest: np.ndarray
    """[S] float64, metres: least z that bridges and the band of heights permit, with clearance."""


def plan_ways(courses: CourseArrays, config: EnvConfig) -> Ways:
    """Return the ways through a batch of courses."""
    samples = len(courses.width)
    reach = 0.5 * courses.width - np.minimum(MARGIN_M, MARGIN_SHARE * courses.width)
    onward = np.zeros((samples, 2, POINTS_ACROSS), np.int64)
    missing = np.empty((samples, POINTS_ACROSS))
    for world in range(len(courses.segments)):
        _fill_missing(courses, world, reach, missing)
        for way in range(2):
            _fill_onward(courses, world, reach, missing, way, onward)
    excess = missing - missing.min(axis=1, keepdims=True)
    return Ways(reach, onward, excess, *plan_heights(courses, config, CRUISE_M))


@kernel(fastmath=False, allocates=False)
def place_of(courses, reach, row, point):
    """Return x, y of a point across the sample in a row."""
    offset = offset_of(reach[row], point, POINTS_ACROSS)
    x = courses.position[row, 0] - offset * courses.tangent[row, 1]
    y = courses.position[row, 1] + offset * courses.tangent[row, 0]
    return x, y


@kernel(fastmath=False, allocates=False)
def _fill_missing(courses, world, reach, missing):
    """Fill the rows of a world in missing [S, P]: square metres of missing clearance, `LAND` on islands."""
    for row in range(courses.first_sample[world], courses.first_sample[world + 1]):
        for point in range(POINTS_ACROSS):
            x, y = place_of(courses, reach, row, point)
            bank = 0.5 * courses.width[row] - abs(offset_of(reach[row], point, POINTS_ACROSS))
            short = max(CLEARANCE_M - bank, 0.0)
            found = short * short
            if island_at(courses, world, x, y) >= 0:
                found += LAND
            else:
                short = CLEARANCE_M - _island_distance(courses, world, x, y)
                found += short * short
            missing[row, point] = found


@kernel(fastmath=False, allocates=False)
def _island_distance(courses, world, x, y):
    """Return the distance of a point from the nearest island in metres, in steps of rings; at most `CLEARANCE_M`."""
    for ring in range(1, int(CLEARANCE_M / RING_M)):
        for side in range(SIDES):
            angle = 2.0 * math.pi * side / SIDES
            reach = ring * RING_M
            if island_at(courses, world, x + reach * math.cos(angle), y + reach * math.sin(angle)) >= 0:
                return reach
    return CLEARANCE_M


@kernel(fastmath=False)
def _fill_onward(courses, world, reach, missing, way, onward):
    """Fill the rows of a world in onward [S, way, P], from the end of the course or over three laps of a loop."""
    travel = 1 if way == 0 else -1
    first = courses.first_sample[world]
    count = courses.first_sample[world + 1] - first
    steps = 3 * count if courses.closed[world] != 0 else count - 1
    cost = missing[first] * 0.0
    best = np.empty(POINTS_ACROSS)
    sample = 0 if courses.closed[world] != 0 or travel < 0 else count - 1
    for _ in range(steps):
        following = first + sample
        sample = (sample - travel) % count
        row = first + sample
        for point in range(POINTS_ACROSS):
            best[point] = 1.0e300
            x, y = place_of(courses, reach, row, point)
            for after in range(POINTS_ACROSS):
                next_x, next_y = place_of(courses, reach, following, after)
                total = cost[after] + math.hypot(next_x - x, next_y - y) + CLEARANCE_WEIGHT * missing[following, after]
                aside = offset_of(reach[following], after, POINTS_ACROSS) - offset_of(reach[row], point, POINTS_ACROSS)
                total += LAND * hindrance(courses, world, x, y, next_x, next_y, aside)
                if total < best[point]:
                    best[point] = total
                    onward[row, way, point] = after
        cost[:] = best


@kernel(fastmath=False, allocates=False)
def nearest_point(ways, row, left):
    """Return the point across the sample in a row that is nearest to an offset and not on an island."""
    exact = 0.5 * (left / ways.reach[row] + 1.0) * (POINTS_ACROSS - 1)
    nearest = min(max(round(exact), 0), POINTS_ACROSS - 1)
    for away in range(POINTS_ACROSS):
        for point in (nearest - away, nearest + away):
            if 0 <= point < POINTS_ACROSS and ways.excess[row, point] < 0.5 * LAND:
                return point
    return nearest


@kernel(fastmath=False, allocates=False)
def missing_clearance(courses, world, projection, ways, left):
    """Return the square metres of missing clearance beyond the least, at an offset to the left of the centre line."""
    a, b = sample_rows(courses, world, projection.segment)
    row = a if projection.fraction < 0.5 else b
    exact = 0.5 * (left / ways.reach[row] + 1.0) * (POINTS_ACROSS - 1)
    exact = min(max(exact, 0.0), POINTS_ACROSS - 1.0)
    point = min(int(exact), POINTS_ACROSS - 2)
    share = exact - point
    lower, upper = min(ways.excess[row, point], WORST), min(ways.excess[row, point + 1], WORST)
    return (1.0 - share) * lower + share * upper


WORST = 2.0 * CLEARANCE_M * CLEARANCE_M
"""Greatest missing clearance: at a bank and an island at once."""


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
    point = nearest_point(ways, row, left)
    dx = 0.0
    dy = 0.0
    for _ in range(courses.segments[world]):
        x, y = place_of(courses, ways.reach, row, point)
        dx = x - pose.x
        dy = y - pose.y
        segment = segment_at_offset(courses, world, segment, travel)
        if segment < 0 or dx * dx + dy * dy >= lookahead * lookahead:
            break
        point = ways.onward[row, way, point]
        a, b = sample_rows(courses, world, segment)
        row = b if travel > 0 else a
    return math.atan2(dy, dx), dx, dy
