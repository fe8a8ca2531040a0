"""Water and land: whether a point lies over land, and which part of the course is nearest to any point."""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.progress import Projection, nearest_on_segment, track_projection
from thalweg.env.task.termination import TOLERANCE, island_at, metres_past_bank


@kernel(fastmath=False, allocates=False)
def is_ashore(courses, world, projection, x, y):
    """Return whether a point is past a bank, or on an island; `projection` is that of the point."""
    return metres_past_bank(courses, world, projection) > TOLERANCE or island_at(courses, world, x, y) >= 0


@kernel(fastmath=False, allocates=False)
def project_anywhere(courses, world, x, y):
    """Return the `Projection` of any point, searched along the whole course.

    Where two arms lie side by side, the one between whose banks the point lies deepest counts.
    """
    deepest = 1.0e300
    segment = 0
    for candidate in range(courses.segments[world]):
        squared, fraction = nearest_on_segment(courses, world, candidate, x, y)
        depth = metres_past_bank(courses, world, Projection(candidate, fraction, math.sqrt(squared)))
        if depth < deepest:
            deepest = depth
            segment = candidate
    _, projection = track_projection(courses, world, segment, x, y)
    return projection
