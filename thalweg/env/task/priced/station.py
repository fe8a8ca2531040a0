"""The gauge station that `Portage` leads to: where it is, and how far it is along the course.

On a loop the station lies half a course from the start, and its distance is that of the shorter way round. So it is
continuous, and falls by the arc that a portage skips. On an open course the station lies near the end.
"""

from thalweg.core.compute.jit import kernel
from thalweg.env.task.ideal_eye import arc_length

REACHED_M = 3.0
"""Metres along the course within which the station is reached, over water; more than a step can pass."""
END_GAP_M = 2.0
"""Distance of the station from the end of an open course."""


@kernel(fastmath=False, allocates=False)
def station_of(courses, world, projection, travel):
    """Return metres along the course of the station of an episode that starts at a `Projection`; travel: 1 or -1."""
    length = courses.length[world]
    if courses.closed[world] != 0:
        return (arc_length(courses, world, projection) + 0.5 * length) % length
    return length - END_GAP_M if travel > 0 else END_GAP_M


@kernel(fastmath=False, allocates=False)
def way_to(courses, world, arc, station):
    """Return (metres, direction along the course, 1 or -1) of the way to the station; arc, station: metres along the
    course."""
    ahead = station - arc
    if courses.closed[world] != 0:
        length = courses.length[world]
        ahead = (ahead + 0.5 * length) % length - 0.5 * length
    return (ahead, 1) if ahead >= 0.0 else (-ahead, -1)


def greatest_ways(courses, world):
    """Return the metres along the course that are paid in full; of one world, or [N] of as many.

    On a loop they are half of it, the distance of its station. On an open course they are all of it, and its station is
    at most that less `END_GAP_M` away, so that no flight there earns the full reward.
    """
    return courses.length[world] * (1.0 - 0.5 * courses.closed[world])


greatest_way = kernel(fastmath=False, allocates=False)(greatest_ways)
"""The same of one world, for kernels."""
