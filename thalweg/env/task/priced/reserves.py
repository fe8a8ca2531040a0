"""Reserves of nesting birds: stretches of the course that must not be overflown low, and the view of nests."""

from thalweg.core.compute.jit import kernel
from thalweg.env.task.termination import TOLERANCE


@kernel(fastmath=False, allocates=False)
def reserve_at(courses, world, arc):
    """Return the first reserve of a world that contains an arc length in metres, or -1."""
    for row in range(courses.first_reserve[world], courses.first_reserve[world + 1]):
        if courses.reserve[row, 0] <= arc <= courses.reserve[row, 1]:
            return row - courses.first_reserve[world]
    return -1


@kernel(fastmath=False, allocates=False)
def reserve_cost(courses, world, limits, arc, height):
    """Return 1.0 for a step that ended in a reserve, at an arc length, too low above the water, else 0.0 (metres)."""
    low = height < limits.task.reserve_height - TOLERANCE
    return 1.0 if low and reserve_at(courses, world, arc) >= 0 else 0.0


@kernel(fastmath=False, allocates=False)
def view_quality(limits, height):
    """Return the share in 0..1 of a nest's pixels that are left at a height in metres above the water.

    The pixels on an object fall with the square of its distance.
    """
    full = limits.task.view_height
    return 1.0 if height <= full else (full / height) * (full / height)
