"""Points across the river, between which ways are planned, and what stands in the way from one to another.

Ways themselves are planned where they are flown: the steady pilot's over the samples of a course, for any flight; the
oracle's over the metres ahead of one, with the steps that a cost is worth.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.termination import island_at

STEEPEST = 1.0
"""Greatest slope of a way against the course."""


@kernel(fastmath=False, allocates=False)
def offset_of(reach, point, points):
    """Return how many metres one of some points across lies to the left of the centre line, the outer ones by
    `reach`; the others divide the distance evenly."""
    return reach * (2.0 * point / (points - 1) - 1.0)


@kernel(fastmath=False, allocates=False)
def hindrance(courses, world, x, y, next_x, next_y, aside):
    """Return what stands in the way between points of two neighbouring rows: 1 for an island, and the metres by which
    the way is too steep; 0 is a free way.

    aside: metres to the left by which the offset from the centre line grows.
    """
    length = math.hypot(next_x - x, next_y - y)
    found = max(abs(aside) - length * STEEPEST / math.sqrt(1.0 + STEEPEST * STEEPEST), 0.0)
    if island_at(courses, world, 0.5 * (x + next_x), 0.5 * (y + next_y)) >= 0:
        found += 1.0
    return found
