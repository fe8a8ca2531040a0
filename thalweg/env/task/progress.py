"""Where along the course is the camera, and which segments has it visited?

The projection on the centre line is followed continuously from the last one: a local search that never sees another
arm of a bend. Segment k lies between samples k and k + 1; a place on the line is a segment and a fraction in 0..1.
"""

import math

from thalweg.core.jit import kernel

WINDOW = 2
"""Segments searched each way in any case. On the inside of a corner of the line two neighbours can both be locally
nearest; beyond the window the search goes on only while it comes nearer."""

TIE = 1.0e-9
"""Square metres by which a segment must be nearer to be preferred to one closer to the last. Outside a corner of the
line both its neighbours are equally near, and rounding must not decide which of them is visited."""


@kernel(fastmath=False)
def sample_rows(courses, world, segment):
    """Rows of the two samples at the ends of a segment."""
    first = courses.first_sample[world]
    following = first + segment + 1
    if following == courses.first_sample[world + 1]:
        following = first
    return first + segment, following


@kernel(fastmath=False)
def nearest_on(courses, world, segment, x, y):
    """(squared distance, fraction) of the point of a segment that is nearest to x, y."""
    a, b = sample_rows(courses, world, segment)
    ax = courses.position[a, 0]
    ay = courses.position[a, 1]
    dx = courses.position[b, 0] - ax
    dy = courses.position[b, 1] - ay
    fraction = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)
    fraction = min(max(fraction, 0.0), 1.0)
    ex = x - ax - fraction * dx
    ey = y - ay - fraction * dy
    return ex * ex + ey * ey, fraction


@kernel(fastmath=False)
def shifted(courses, world, segment, shift):
    """The segment `shift` further along the course, or -1 beyond the end of an open one."""
    count = courses.segments[world]
    place = segment + shift
    if courses.closed[world] != 0:
        return place % count
    return place if 0 <= place < count else -1


@kernel(fastmath=False)
def followed(courses, world, segment, x, y):
    """(segments passed, signed; segment; fraction; distance in metres): the projection of x, y, sought from `segment`
    on."""
    best, best_fraction = nearest_on(courses, world, segment, x, y)
    here = best
    best_shift = 0
    furthest = (courses.segments[world] - 1) // 2 if courses.closed[world] != 0 else courses.segments[world]
    for way in (1, -1):
        previous = here
        shift = way
        while abs(shift) <= furthest:
            candidate = shifted(courses, world, segment, shift)
            if candidate < 0:
                break
            squared, fraction = nearest_on(courses, world, candidate, x, y)
            if squared < best - TIE:
                best = squared
                best_fraction = fraction
                best_shift = shift
            if abs(shift) >= WINDOW and squared >= previous:
                break
            previous = squared
            shift += way
    return best_shift, shifted(courses, world, segment, best_shift), best_fraction, math.sqrt(best)


@kernel(fastmath=False)
def between(courses, world, segment, fraction, values):
    """A quantity given at the samples, linear along the segment."""
    a, b = sample_rows(courses, world, segment)
    return (1.0 - fraction) * values[a] + fraction * values[b]


@kernel(fastmath=False)
def direction(courses, world, segment, fraction):
    """Angle of the course (radians, towards growing arc length), from the tangents at both ends of the segment."""
    a, b = sample_rows(courses, world, segment)
    x = (1.0 - fraction) * courses.tangent[a, 0] + fraction * courses.tangent[b, 0]
    y = (1.0 - fraction) * courses.tangent[a, 1] + fraction * courses.tangent[b, 1]
    return math.atan2(y, x)


@kernel(fastmath=False)
def credited(courses, world, segment, shift, visited):
    """How many segments from `segment` to `shift` further are new; marks them in visited [K] uint8."""
    way = 1 if shift >= 0 else -1
    new = 0
    for passed in range(abs(shift) + 1):
        place = shifted(courses, world, segment, way * passed)
        if visited[place] == 0:
            visited[place] = 1
            new += 1
    return new


@kernel(fastmath=False)
def arrived(courses, world, segment, travel, visited_count):
    """Whether the course is done: every segment of a loop visited; on an open course the last one in the direction of
    travel.

    An open course is done on entering its last segment, so that a start in its middle need visit only what lies
    ahead. Its very end could not be asked for: the volume ends there, and one who passes it near a bank is out.
    """
    if courses.closed[world] != 0:
        return visited_count == courses.segments[world]
    return segment == (courses.segments[world] - 1 if travel > 0 else 0)
