"""Heights to fly at along a course: one cruise height above the water, and what bridges and limits require.

Limits are extended by cones along the course, so that a climb starts in time before a bridge or a step of the water
level, in either direction of travel.
"""

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.progress import sample_rows

VERTICAL_CLEARANCE_M = 0.8
"""Distance kept above bridges and the lower limit, and below the upper limit."""
CLIMB_SLOPE = 0.4
"""Slope of the cones: one vertical step of 1 m in two and a half metres of course."""
UNBOUNDED = 1.0e9


def plan_heights(courses: CourseArrays, config: EnvConfig, cruise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return z [S] to fly at, and the least z [S] that bridges and the band of heights permit, in metres.

    They are those of each sample of all worlds; `cruise_m`: height above the water where no limit requires another.
    """
    heights, least = np.empty_like(courses.level), np.empty_like(courses.level)
    for world in range(len(courses.segments)):
        rows = slice(courses.first_sample[world], courses.first_sample[world + 1])
        lowest, highest = _height_limits(courses, world, config)
        cruise = courses.level[rows] + min(
            max(cruise_m, config.min_height_m), 0.5 * (config.min_height_m + config.max_height_m)
        )
        heights[rows] = np.clip(cruise, lowest, np.maximum(lowest, highest))
        least[rows] = lowest
    return heights, least


def _height_limits(courses: CourseArrays, world: int, config: EnvConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest z [S] to fly at, at each sample of a world."""
    rows = slice(int(courses.first_sample[world]), int(courses.first_sample[world + 1]))
    spare = min(VERTICAL_CLEARANCE_M, 0.25 * (config.max_height_m - config.min_height_m))
    lowest = courses.level[rows] + config.min_height_m + spare
    highest = courses.level[rows] + config.max_height_m - spare
    tops = _bridge_tops(courses, world)
    lowest = np.maximum(lowest, tops + VERTICAL_CLEARANCE_M)
    spacing = courses.length[world] / courses.segments[world]
    closed = bool(courses.closed[world])
    return _cone(lowest, spacing, closed), -_cone(-highest, spacing, closed)


def _cone(lowest: np.ndarray, spacing: float, closed: bool) -> np.ndarray:
    """Return the least heights [S] that never change faster than the slope and are nowhere below `lowest` [S]."""
    count = len(lowest)
    steps = np.abs(np.arange(count)[:, None] - np.arange(count)[None, :])
    if closed:
        steps = np.minimum(steps, count - steps)
    return (lowest[None, :] - CLIMB_SLOPE * spacing * steps).max(axis=1)


@kernel(fastmath=False)
def _bridge_tops(courses, world):
    """Return the greatest z [S] of a grown bridge anywhere across the river at each sample; -UNBOUNDED without one."""
    first = courses.first_sample[world]
    count = courses.first_sample[world + 1] - first
    tops = np.full(count, -UNBOUNDED)
    for segment in range(courses.segments[world]):
        a, b = sample_rows(courses, world, segment)
        for quarter in range(4):
            share = 0.25 * quarter
            x = (1.0 - share) * courses.position[a, 0] + share * courses.position[b, 0]
            y = (1.0 - share) * courses.position[a, 1] + share * courses.position[b, 1]
            for point in range(9):
                side = 0.5 * courses.width[a] * (point - 4) / 4.0
                top = _bridge_top(courses, world, x - side * courses.tangent[a, 1], y + side * courses.tangent[a, 0])
                tops[a - first] = max(tops[a - first], top)
                tops[b - first] = max(tops[b - first], top)
    return tops


@kernel(fastmath=False, allocates=False)
def _bridge_top(courses, world, x, y):
    """Return the greatest z of a grown bridge over x, y; -UNBOUNDED without one."""
    best = -UNBOUNDED
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        # Each plane bounds the vertical line over x, y from above, from below, or excludes it.
        high = UNBOUNDED
        low = -UNBOUNDED
        for row in range(courses.first_plane[bridge], courses.first_plane[bridge + 1]):
            rest = courses.plane[row, 3] - courses.plane[row, 0] * x - courses.plane[row, 1] * y
            nz = courses.plane[row, 2]
            if nz > 1.0e-12:
                high = min(high, rest / nz)
            elif nz < -1.0e-12:
                low = max(low, rest / nz)
            elif rest < 0.0:
                high = -UNBOUNDED
        if high >= low:
            best = max(best, high)
    return best
