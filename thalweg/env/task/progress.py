"""Progress along the course: the projection on the centre line, and the segments that have been visited.

The projection is tracked from step to step by a local search, which never jumps to another arm of a bend. Segment k
lies between samples k and k + 1.
"""

import math
from typing import NamedTuple

from thalweg.core.compute.jit import kernel

WINDOW = 2
"""Segments that are always searched in each direction. On the inside of a corner of the line two neighbours can both be
locally nearest; beyond the window the search continues only while the distance decreases."""

TIE = 1.0e-9
"""Square metres by which a segment must be nearer to be preferred to one closer to the last. On the outside of a corner
both neighbours are equally near, and rounding must not decide which of them counts as visited."""


class Projection(NamedTuple):
    """A point of the centre line, and the distance of the projected point from it."""

    segment: int
    fraction: float
    """Position on the segment in 0..1."""
    distance: float
    """Metres."""


@kernel(fastmath=False, allocates=False)
def sample_rows(courses, world, segment):
    """Return the rows of the two samples at the ends of a segment."""
    first = courses.first_sample[world]
    following = first + segment + 1
    if following == courses.first_sample[world + 1]:
        following = first  # the last segment of a loop ends at its first sample
    return first + segment, following


@kernel(fastmath=False, allocates=False)
def nearest_on_segment(courses, world, segment, x, y):
    """Return (squared distance, fraction) of the point of a segment that is nearest to x, y."""
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


@kernel(fastmath=False, allocates=False)
def segment_at_offset(courses, world, segment, offset):
    """Return the segment `offset` further along the course, or -1 past the end of an open course."""
    count = courses.segments[world]
    shifted = segment + offset
    if courses.closed[world] != 0:
        return shifted % count
    return shifted if 0 <= shifted < count else -1


@kernel(fastmath=False, allocates=False)
def track_projection(courses, world, segment, x, y):
    """Return (offset, `Projection`) of x, y by a local search from `segment`.

    `offset` is the signed number of segments from `segment` to that of the projection.
    """
    best, best_fraction = nearest_on_segment(courses, world, segment, x, y)
    initial = best
    best_offset = 0
    # On a loop neither direction searches more than half of it, so that no segment is reached twice.
    furthest = (courses.segments[world] - 1) // 2 if courses.closed[world] != 0 else courses.segments[world]
    for way in (1, -1):
        previous = initial
        offset = way
        while abs(offset) <= furthest:
            candidate = segment_at_offset(courses, world, segment, offset)
            if candidate < 0:
                break
            squared, fraction = nearest_on_segment(courses, world, candidate, x, y)
            if squared < best - TIE:
                best = squared
                best_fraction = fraction
                best_offset = offset
            if abs(offset) >= WINDOW and squared >= previous:
                break
            previous = squared
            offset += way
    nearest = segment_at_offset(courses, world, segment, best_offset)
    return best_offset, Projection(nearest, best_fraction, math.sqrt(best))


@kernel(fastmath=False, allocates=False)
def projection_at(courses, world, arc):
    """Return the `Projection` of the point of the centre line at an arc length in metres, from 0 to that of the
    course."""
    low = 0
    high = courses.segments[world] - 1
    first = courses.first_sample[world]
    while low < high:
        middle = (low + high + 1) // 2
        if courses.arc[first + middle] <= arc:
            low = middle
        else:
            high = middle - 1
    a, b = sample_rows(courses, world, low)
    end = courses.length[world] if b < a else courses.arc[b]
    fraction = min(max((arc - courses.arc[a]) / (end - courses.arc[a]), 0.0), 1.0)
    return Projection(low, fraction, 0.0)


@kernel(fastmath=False, allocates=False)
def interpolate(courses, world, projection, values):
    """Return a quantity given at the samples, interpolated linearly at a `Projection`."""
    a, b = sample_rows(courses, world, projection.segment)
    return (1.0 - projection.fraction) * values[a] + projection.fraction * values[b]


@kernel(fastmath=False, allocates=False)
def course_direction(courses, world, projection):
    """Return the angle of the course (radians, towards growing arc length) at a `Projection`, from the tangents at both
    ends of the segment."""
    a, b = sample_rows(courses, world, projection.segment)
    fraction = projection.fraction
    x = (1.0 - fraction) * courses.tangent[a, 0] + fraction * courses.tangent[b, 0]
    y = (1.0 - fraction) * courses.tangent[a, 1] + fraction * courses.tangent[b, 1]
    return math.atan2(y, x)


@kernel(fastmath=False, allocates=False)
def visit_segments(courses, world, segment, offset, visited):
    """Set the segments from `segment` to `offset` further in visited [K] uint8; return how many of them are new."""
    way = 1 if offset >= 0 else -1
    new = 0
    for passed in range(abs(offset) + 1):
        index = segment_at_offset(courses, world, segment, way * passed)
        if visited[index] == 0:
            visited[index] = 1
            new += 1
    return new


@kernel(fastmath=False, allocates=False)
def last_segment(courses, world, travel):
    """Return the last segment of an open course in the direction of travel (1 or -1)."""
    return courses.segments[world] - 1 if travel > 0 else 0


@kernel(fastmath=False, allocates=False)
def course_completed(courses, world, segment, travel, visited_count):
    """Return whether the course is completed: all segments of a loop are visited, or an open course's last segment in
    the direction of travel is reached.

    Entering the last segment of an open course is enough. A start in the middle need visit only the segments ahead, and
    the very end cannot be required: the permitted volume ends there, so that a camera near the bank would leave it.
    """
    if courses.closed[world] != 0:
        return visited_count == courses.segments[world]
    return segment == last_segment(courses, world, travel)
