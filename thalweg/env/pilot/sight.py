"""From where the steady pilot sees water before the bank that it faces.

A camera sees no ground nearer than its lowest rays reach. Beside the course and high up it sees the trees behind the
bank, which do not tell the way.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.pilot.heights import UNBOUNDED
from thalweg.env.pilot.ways import metres_left
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import course_direction, interpolate
from thalweg.env.task.termination import yaw_deviation

ASIDE_RAD = math.radians(55.0)
"""A bank is faced from this angle off the direction of travel."""
SLOPE = 0.8
"""Height above the water, as a share of the distance to the bank ahead. The lowest rays of the camera fall by 1.2 m for
each metre ahead, so that some of the water before the bank is in view."""


@kernel(fastmath=False, allocates=False)
def sight_height(courses, world, projection, travel, ways, pose):
    """Return the greatest z from which water is in view at a `Pose`, as far as `ways` permit it; `UNBOUNDED` if no bank
    is faced."""
    if yaw_deviation(courses, world, projection, pose.yaw, travel) < ASIDE_RAD:
        return UNBOUNDED
    across = math.sin(wrap_angle(pose.yaw - course_direction(courses, world, projection)))
    left = metres_left(courses, world, projection, pose.x, pose.y)
    half_width = 0.5 * interpolate(courses, world, projection, courses.width)
    ahead = half_width / abs(across) - left / across
    sees = interpolate(courses, world, projection, courses.level) + SLOPE * ahead
    return max(sees, interpolate(courses, world, projection, ways.lowest))
