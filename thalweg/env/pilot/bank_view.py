"""The greatest height from which the steady pilot sees water before the bank that it faces.

A camera sees no ground nearer than its lowest rays reach. Beside the course and high up it sees the trees behind the
bank, which do not tell the way. The bank is taken as straight; islands, and cameras other than the usual one, are left
out.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.pilot.heights import UNBOUNDED
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import course_direction, interpolate, metres_left
from thalweg.env.task.termination import yaw_deviation

BANK_AHEAD_RAD = math.radians(55.0)
"""A bank is faced from this angle off the direction of travel, and up to this angle off the way back."""
SLOPE = 0.8
"""Height above the water, as a share of the distance to the bank ahead. The lowest rays of the usual camera, 50° below
the horizon, fall by 1.2 m for each metre ahead, so that a third of the water before the bank is in view."""


@kernel(fastmath=False, allocates=False)
def sight_height(courses, world, projection, travel, ways, pose):
    """Return z in metres, the greatest from which a `Pose` sees water before the bank that it faces, but at least
    `ways.lowest`; `UNBOUNDED` if it faces none."""
    deviation = yaw_deviation(courses, world, projection, pose.yaw, travel)
    if deviation < BANK_AHEAD_RAD or deviation > math.pi - BANK_AHEAD_RAD:
        return UNBOUNDED
    across = math.sin(wrap_angle(pose.yaw - course_direction(courses, world, projection)))
    left = metres_left(courses, world, projection, pose.x, pose.y)
    half_width = 0.5 * interpolate(courses, world, projection, courses.width)
    ahead = half_width / abs(across) - left / across
    sees = interpolate(courses, world, projection, courses.level) + SLOPE * ahead
    return max(sees, interpolate(courses, world, projection, ways.lowest))
