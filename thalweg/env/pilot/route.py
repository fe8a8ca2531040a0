"""What does the scripted pilot know of a world? A line to fly, and the lowest and highest safe flight along it.

The line is the shortest way along the course that keeps clear of banks and islands, found by dynamic programming over
places across each sample. Heights are drawn out by cones, so that a climb begins in time before a bridge or a step of
the water level, whichever way one flies.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.task.course_arrays import Courses
from thalweg.env.task.progress import sample_rows
from thalweg.env.task.termination import on_island

PLACES = 25
"""Places across the river among which the line chooses at each sample."""
MARGIN_M = 0.9
"""Distance from banks and islands that the line keeps where the river is wide enough."""
MARGIN_SHARE = 0.25
"""The same as a share of the width, where that is less."""
ROOM_M = 2.0
"""Clearance beyond which more of it is worth nothing."""
ROOM_WEIGHT = 0.05
"""Worth of clearance against length of the way, per metre flown and square metre of missing clearance."""
LAND = 1.0e6
"""Cost of a place on an island; more than any way round."""
CLEAR_M = 0.8
"""Height kept above bridges, the lower limit and below the upper limit."""
CLIMB_SLOPE = 0.4
"""Climb per metre of course that the cones allow: one vertical step in two and a half metres."""
CRUISE_M = 3.5
"""Height that is flown where nothing else asks for more or less."""
FAR = 1.0e9


class Chart(NamedTuple):
    """The pilot's knowledge, one row for each of the S samples of all worlds."""

    line: np.ndarray
    """[S, 2] float64, metres: where to fly."""
    height: np.ndarray
    """[S] float64, metres, z to fly at."""


def drawn(courses: Courses, config: EnvConfig) -> Chart:
    """The chart of some courses."""
    chart = Chart(np.empty_like(courses.position), np.empty_like(courses.level))
    for world in range(len(courses.segments)):
        _draw_line(courses, world, chart.line)
        rows = slice(courses.first_sample[world], courses.first_sample[world + 1])
        lowest, highest = _heights(courses, world, config)
        cruise = courses.level[rows] + min(
            max(CRUISE_M, config.min_height_m), 0.5 * (config.min_height_m + config.max_height_m)
        )
        chart.height[rows] = np.clip(cruise, lowest, np.maximum(lowest, highest))
    return chart


def _draw_line(courses: Courses, world: int, line: np.ndarray) -> None:
    """Fill a world's rows of line [S, 2]."""
    first, end = int(courses.first_sample[world]), int(courses.first_sample[world + 1])
    count = end - first
    laps = 3 if courses.closed[world] else 1
    position, tangent, width = courses.position[first:end], courses.tangent[first:end], courses.width[first:end]
    inner = 0.5 * width - np.minimum(MARGIN_M, MARGIN_SHARE * width)
    offset = np.linspace(-1.0, 1.0, PLACES)[None, :] * inner[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    points = position[:, None, :] + offset[:, :, None] * normal[:, None, :]
    toll = ROOM_WEIGHT * np.maximum(ROOM_M - (0.5 * width[:, None] - np.abs(offset)), 0.0) ** 2
    _toll_of_islands(courses, world, points, toll)
    choice = _shortest(points, toll, laps)
    lap = choice[count : 2 * count] if laps == 3 else choice
    line[first:end] = points[np.arange(count), lap]


@kernel(fastmath=False)
def _toll_of_islands(courses, world, points, toll):
    """Add the cost of islands and their margin to toll [S, PLACES]."""
    for sample in range(points.shape[0]):
        for place in range(points.shape[1]):
            x, y = points[sample, place, 0], points[sample, place, 1]
            if on_island(courses, world, x, y) >= 0:
                toll[sample, place] += LAND
                continue
            nearest = ROOM_M
            for side in range(16):
                angle = np.pi * side / 8.0
                for ring in range(1, 5):
                    reach = 0.25 * ring * ROOM_M
                    if reach < nearest and (
                        on_island(courses, world, x + reach * np.cos(angle), y + reach * np.sin(angle)) >= 0
                    ):
                        nearest = reach
            toll[sample, place] += ROOM_WEIGHT * (ROOM_M - nearest) ** 2
            if nearest < MARGIN_M:
                toll[sample, place] += 1.0


@kernel(fastmath=False)
def _shortest(points, toll, laps):
    """Place [laps * S] at each sample on the cheapest way through points [S, P, 2] with toll [S, P] per sample."""
    count, places = toll.shape
    total = laps * count
    cost = toll[0].copy()
    came = np.zeros((total, places), dtype=np.int64)
    for step in range(1, total):
        here, before = step % count, (step - 1) % count
        following = np.empty(places)
        for place in range(places):
            best = FAR * LAND
            for last in range(places):
                dx = points[here, place, 0] - points[before, last, 0]
                dy = points[here, place, 1] - points[before, last, 1]
                candidate = cost[last] + np.sqrt(dx * dx + dy * dy)
                if candidate < best:
                    best = candidate
                    came[step, place] = last
            following[place] = best + toll[here, place]
        cost = following
    choice = np.empty(total, dtype=np.int64)
    choice[total - 1] = np.argmin(cost)
    for step in range(total - 1, 0, -1):
        choice[step - 1] = came[step, choice[step]]
    return choice


def _heights(courses: Courses, world: int, config: EnvConfig) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest z [S] to fly at each sample of a world."""
    rows = slice(int(courses.first_sample[world]), int(courses.first_sample[world + 1]))
    spare = min(CLEAR_M, 0.25 * (config.max_height_m - config.min_height_m))
    lowest = courses.level[rows] + config.min_height_m + spare
    highest = courses.level[rows] + config.max_height_m - spare
    tops = _bridge_tops(courses, world)
    lowest = np.maximum(lowest, tops + CLEAR_M)
    spacing = courses.length[world] / courses.segments[world]
    closed = bool(courses.closed[world])
    return _cone(lowest, spacing, closed), -_cone(-highest, spacing, closed)


def _cone(lowest: np.ndarray, spacing: float, closed: bool) -> np.ndarray:
    """The least heights [S] that nowhere change faster than the slope and are nowhere below `lowest` [S]."""
    count = len(lowest)
    steps = np.abs(np.arange(count)[:, None] - np.arange(count)[None, :])
    if closed:
        steps = np.minimum(steps, count - steps)
    return (lowest[None, :] - CLIMB_SLOPE * spacing * steps).max(axis=1)


@kernel(fastmath=False)
def _bridge_tops(courses, world):
    """Greatest z [S] of a grown bridge anywhere across the river at each sample, or far below where there is none."""
    first = courses.first_sample[world]
    count = courses.first_sample[world + 1] - first
    tops = np.full(count, -FAR)
    for segment in range(courses.segments[world]):
        a, b = sample_rows(courses, world, segment)
        for part in range(4):
            share = 0.25 * part
            x = (1.0 - share) * courses.position[a, 0] + share * courses.position[b, 0]
            y = (1.0 - share) * courses.position[a, 1] + share * courses.position[b, 1]
            for place in range(9):
                side = 0.5 * courses.width[a] * (place - 4) / 4.0
                top = _top(courses, world, x - side * courses.tangent[a, 1], y + side * courses.tangent[a, 0])
                tops[a - first] = max(tops[a - first], top)
                tops[b - first] = max(tops[b - first], top)
    return tops


@kernel(fastmath=False)
def _top(courses, world, x, y):
    """Greatest z of a grown bridge over x, y, or far below."""
    best = -FAR
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        high = FAR
        low = -FAR
        for row in range(courses.first_plane[bridge], courses.first_plane[bridge + 1]):
            rest = courses.plane[row, 3] - courses.plane[row, 0] * x - courses.plane[row, 1] * y
            nz = courses.plane[row, 2]
            if nz > 1.0e-12:
                high = min(high, rest / nz)
            elif nz < -1.0e-12:
                low = max(low, rest / nz)
            elif rest < 0.0:
                high = -FAR
        if high >= low:
            best = max(best, high)
    return best
