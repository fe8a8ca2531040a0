"""Route of the scripted pilot: a line to fly along each course, and the height to fly at.

The line is the shortest path along the course that keeps clear of banks and islands, found by dynamic programming over
points across each sample.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.pilot.heights import UNBOUNDED, plan_heights
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.termination import island_at

POINTS_ACROSS = 25
"""Points across the river among which the line chooses at each sample."""
MARGIN_M = 0.9
"""Distance that the line keeps from banks and islands where the river is wide enough."""
MARGIN_SHARE = 0.25
"""The same as a share of the width, where that is less."""
CLEARANCE_M = 2.0
"""Lateral clearance above which more clearance has no value."""
CLEARANCE_WEIGHT = 0.05
"""Cost in metres of path, for each sample and square metre of missing lateral clearance."""
ISLAND_COST = 1.0e6
"""Cost of a point on an island; more than any way round it."""
CRUISE_M = 3.5
"""Height above the water where no limit requires another."""


class Route(NamedTuple):
    """Routes through a batch of courses, one row for each of the S samples of all worlds."""

    line: np.ndarray
    """[S, 2] float64, metres: x and y to fly at."""
    height: np.ndarray
    """[S] float64, metres: z to fly at."""


def plan_route(courses: CourseArrays, config: EnvConfig) -> Route:
    """Return the routes through a batch of courses."""
    route = Route(np.empty_like(courses.position), plan_heights(courses, config, CRUISE_M)[0])
    for world in range(len(courses.segments)):
        _plan_line(courses, world, route.line)
    return route


def _plan_line(courses: CourseArrays, world: int, line: np.ndarray) -> None:
    """Fill the rows of a world in line [S, 2]."""
    first, end = int(courses.first_sample[world]), int(courses.first_sample[world + 1])
    count = end - first
    # A loop is planned over three laps, of which the middle one is free of end effects.
    laps = 3 if courses.closed[world] else 1
    position, tangent, width = courses.position[first:end], courses.tangent[first:end], courses.width[first:end]
    inner = 0.5 * width - np.minimum(MARGIN_M, MARGIN_SHARE * width)
    offset = np.linspace(-1.0, 1.0, POINTS_ACROSS)[None, :] * inner[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    points = position[:, None, :] + offset[:, :, None] * normal[:, None, :]
    point_cost = CLEARANCE_WEIGHT * np.maximum(CLEARANCE_M - (0.5 * width[:, None] - np.abs(offset)), 0.0) ** 2
    _add_island_cost(courses, world, points, point_cost)
    choice = _cheapest_path(points, point_cost, laps)
    lap = choice[count : 2 * count] if laps == 3 else choice
    line[first:end] = points[np.arange(count), lap]


@kernel(fastmath=False, allocates=False)
def _add_island_cost(courses, world, points, point_cost):
    """Add the cost of islands and their margin to point_cost [S, POINTS_ACROSS]."""
    for sample in range(points.shape[0]):
        for point in range(points.shape[1]):
            x, y = points[sample, point, 0], points[sample, point, 1]
            if island_at(courses, world, x, y) >= 0:
                point_cost[sample, point] += ISLAND_COST
                continue
            # The distance to the nearest island, searched on rings in 16 directions.
            nearest = CLEARANCE_M
            for side in range(16):
                angle = np.pi * side / 8.0
                for ring in range(1, 5):
                    reach = 0.25 * ring * CLEARANCE_M
                    if reach < nearest and (
                        island_at(courses, world, x + reach * np.cos(angle), y + reach * np.sin(angle)) >= 0
                    ):
                        nearest = reach
            point_cost[sample, point] += CLEARANCE_WEIGHT * (CLEARANCE_M - nearest) ** 2
            if nearest < MARGIN_M:
                point_cost[sample, point] += 1.0


@kernel(fastmath=False)
def _cheapest_path(points, point_cost, laps):
    """Return the index [laps * S] of the point at each sample on the cheapest path through points [S, P, 2] with
    point_cost [S, P]."""
    count, across = point_cost.shape
    total = laps * count
    cost = point_cost[0].copy()
    predecessor = np.zeros((total, across), dtype=np.int64)
    for step in range(1, total):
        here, before = step % count, (step - 1) % count
        following = np.empty(across)
        for point in range(across):
            best = UNBOUNDED * ISLAND_COST
            for last in range(across):
                dx = points[here, point, 0] - points[before, last, 0]
                dy = points[here, point, 1] - points[before, last, 1]
                candidate = cost[last] + np.sqrt(dx * dx + dy * dy)
                if candidate < best:
                    best = candidate
                    predecessor[step, point] = last
            following[point] = best + point_cost[here, point]
        cost = following
    choice = np.empty(total, dtype=np.int64)
    choice[total - 1] = np.argmin(cost)
    for step in range(total - 1, 0, -1):
        choice[step - 1] = predecessor[step, choice[step]]
    return choice
