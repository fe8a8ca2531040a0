"""Metres ahead: places along the course counted from a start in the direction of travel, over the join of a loop."""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.ideal_eye import arc_length
from thalweg.env.task.progress import course_direction, interpolate, projection_at

MARGIN_M = 30.0
"""Metres that are planned beyond the completion of a loop, where a search may end."""


@kernel(fastmath=False, allocates=False)
def arc_at(courses, world, start_arc, travel, ahead):
    """Return metres along the course of a place so many metres ahead of a start, clipped to an open course."""
    arc = start_arc + travel * ahead
    length = courses.length[world]
    if courses.closed[world] != 0:
        return arc % length
    return min(max(arc, 0.0), length)


@kernel(fastmath=False, allocates=False)
def metres_ahead(courses, world, start_arc, travel, projection, near):
    """Return how many metres ahead of a start a `Projection` is; of the laps of a loop, the one nearest to `near`."""
    ahead = travel * (arc_length(courses, world, projection) - start_arc)
    if courses.closed[world] == 0:
        return ahead
    length = courses.length[world]
    return ahead + length * math.floor((near - ahead) / length + 0.5)


@kernel(fastmath=False, allocates=False)
def frame_at(courses, world, start_arc, travel, ahead):
    """Return (projection, x, y, direction of travel in radians) of the centre line so many metres ahead of a start."""
    centre = projection_at(courses, world, arc_at(courses, world, start_arc, travel, ahead))
    x = interpolate(courses, world, centre, courses.position[:, 0])
    y = interpolate(courses, world, centre, courses.position[:, 1])
    course = course_direction(courses, world, centre)
    return centre, x, y, course if travel > 0 else course + math.pi


@kernel(fastmath=False, allocates=False)
def metres_to_the_left(courses, world, start_arc, travel, ahead, x, y):
    """Return how many metres to the left of the centre line a point is, seen in the direction of travel."""
    _, cx, cy, course = frame_at(courses, world, start_arc, travel, ahead)
    return (y - cy) * math.cos(course) - (x - cx) * math.sin(course)


@kernel(fastmath=False, allocates=False)
def interpolated(table, first, second):
    """Return a table [A, B] at two coordinates, interpolated linearly and clipped to its edges."""
    a = min(max(first, 0.0), table.shape[0] - 1.0)
    b = min(max(second, 0.0), table.shape[1] - 1.0)
    i = min(int(a), max(table.shape[0] - 2, 0))
    j = min(int(b), max(table.shape[1] - 2, 0))
    i1 = min(i + 1, table.shape[0] - 1)
    j1 = min(j + 1, table.shape[1] - 1)
    u = a - i
    v = b - j
    lower = (1.0 - v) * table[i, j] + v * table[i, j1]
    upper = (1.0 - v) * table[i1, j] + v * table[i1, j1]
    return (1.0 - u) * lower + u * upper
