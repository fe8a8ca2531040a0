"""Termination: the permitted volume above the water, collisions with bridges, and the limit of the heading.

The volume lies between the banks, off the islands, and within the height band. The centre of the camera must stay in
it; bridges must not be touched by any part of the body. A boat has no volume but the water: its hull must float, and
touch nothing solid.
"""

import math
from typing import Any

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DoneReason, Limits
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.progress import course_direction, interpolate
from thalweg.env.vehicle.hull import AGROUND, SOLID, first_hit

RUNNING = int(DoneReason.RUNNING)
COLLISION = int(DoneReason.COLLISION)
OUT_OF_VOLUME_HORIZONTAL = int(DoneReason.OUT_OF_VOLUME_HORIZONTAL)
OUT_OF_VOLUME_VERTICAL = int(DoneReason.OUT_OF_VOLUME_VERTICAL)
YAW_OVER_DEVIATION = int(DoneReason.YAW_OVER_DEVIATION)
IDLE = int(DoneReason.IDLE)
MAX_STEP_REACHED = int(DoneReason.MAX_STEP_REACHED)
SUCCESS = int(DoneReason.SUCCESS)

TOLERANCE = 1.0e-9
"""Metres or radians by which a limit may be exceeded: nine turns of 10 degrees are 90, however their sum rounds."""


@kernel(fastmath=False, allocates=False)
def first_bridge_hit(courses, world, ax, ay, az, bx, by, bz):
    """Return the first bridge of a world that the body touches on the straight way from a to b, or -1.

    The way is clipped against the planes of each grown hull (Cyrus and Beck, 1978), so that a long step cannot pass
    through a bridge unnoticed.
    """
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        # The boxes of way and bridge must overlap.
        if max(ax, bx) < courses.bridge_box[bridge, 0] or min(ax, bx) > courses.bridge_box[bridge, 3]:
            continue
        if max(ay, by) < courses.bridge_box[bridge, 1] or min(ay, by) > courses.bridge_box[bridge, 4]:
            continue
        if max(az, bz) < courses.bridge_box[bridge, 2] or min(az, bz) > courses.bridge_box[bridge, 5]:
            continue
        # Shares of the way at which it enters and leaves the hull.
        enters = 0.0
        leaves = 1.0
        for row in range(courses.first_plane[bridge], courses.first_plane[bridge + 1]):
            nx = courses.plane[row, 0]
            ny = courses.plane[row, 1]
            nz = courses.plane[row, 2]
            start = nx * ax + ny * ay + nz * az - courses.plane[row, 3]
            end = nx * bx + ny * by + nz * bz - courses.plane[row, 3]
            if start > 0.0 and end > 0.0:
                leaves = -1.0  # the whole way is outside this plane
                break
            if start > 0.0:
                enters = max(enters, start / (start - end))
            elif end > 0.0:
                leaves = min(leaves, start / (start - end))
        if enters <= leaves:
            return bridge - courses.first_bridge[world]
    return -1


@kernel(fastmath=False, allocates=False)
def island_at(courses, world, x, y):
    """Return the first island of a world that contains x, y, or -1."""
    for island in range(courses.first_island[world], courses.first_island[world + 1]):
        dx = x - courses.island[island, 0]
        dy = y - courses.island[island, 1]
        u = dx * courses.island[island, 2] + dy * courses.island[island, 3]
        v = dx * courses.island[island, 4] + dy * courses.island[island, 5]
        if u * u + v * v <= 1.0:
            return island - courses.first_island[world]
    return -1


@kernel(fastmath=False, allocates=False)
def metres_past_bank(courses, world, projection):
    """Return the distance of a projected point from the bank in metres: positive on land, negative over the water."""
    return projection.distance - 0.5 * interpolate(courses, world, projection, courses.width)


@kernel(fastmath=False, allocates=False)
def yaw_deviation(courses, world, projection, yaw, travel):
    """Return the angle in 0..pi between the heading and the direction of travel (`travel` 1 or -1 along the course)."""
    course = course_direction(courses, world, projection)
    if travel < 0:
        course += math.pi
    return abs(wrap_angle(yaw - course))


@kernel(fastmath=False, allocates=False)
def rule_broken(courses, world, limits, before, after, projection, travel):
    """Return the code of `DoneReason` of the first rule that a straight move between two `Pose`s breaks, or -1.

    `projection` is that of the second pose.
    """
    if limits.is_boat != 0:
        hit = first_hit(courses, world, limits, before, after)
        if hit == SOLID:
            return COLLISION
        if hit == AGROUND or metres_past_bank(courses, world, projection) > TOLERANCE:
            return OUT_OF_VOLUME_HORIZONTAL
        return _heading_broken(courses, world, limits, after, projection, travel)
    if first_bridge_hit(courses, world, before.x, before.y, before.z, after.x, after.y, after.z) >= 0:
        return COLLISION
    if is_off_channel(courses, world, projection, after.x, after.y):
        return OUT_OF_VOLUME_HORIZONTAL
    if is_off_band(courses, world, limits, projection, after.z):
        return OUT_OF_VOLUME_VERTICAL
    return _heading_broken(courses, world, limits, after, projection, travel)


@kernel(fastmath=False, allocates=False)
def is_off_channel(courses, world, projection, x, y):
    """Return whether a point lies beyond a bank or on an island."""
    return metres_past_bank(courses, world, projection) > TOLERANCE or island_at(courses, world, x, y) >= 0


@kernel(fastmath=False, allocates=False)
def is_off_band(courses, world, limits, projection, z):
    """Return whether a height z is outside the band of heights above the water."""
    height = z - interpolate(courses, world, projection, courses.level)
    return height < limits.min_height - TOLERANCE or height > limits.max_height + TOLERANCE


@kernel(fastmath=False, allocates=False)
def faces_backwards(courses, world, limits, projection, yaw, travel):
    """Return whether a heading is too far off the direction of travel."""
    return yaw_deviation(courses, world, projection, yaw, travel) > limits.max_yaw_deviation + TOLERANCE


@kernel(fastmath=False, allocates=False)
def _heading_broken(courses, world, limits, pose, projection, travel):
    """Return the code of `DoneReason` of a heading too far off the direction of travel, or -1."""
    return YAW_OVER_DEVIATION if faces_backwards(courses, world, limits, projection, pose.yaw, travel) else RUNNING


@kernel(fastmath=False, allocates=False)
def rule_broken_over_land(courses, world, limits, before, after, projection):
    """Return as `rule_broken` for a task in which land may be crossed, where a move has ended over land.

    The stone of bridges is solid there too, and the band of heights counts from the water at `projection`, the point of
    the course that is nearest to the second pose.
    """
    if first_bridge_hit(courses, world, before.x, before.y, before.z, after.x, after.y, after.z) >= 0:
        return COLLISION
    return OUT_OF_VOLUME_VERTICAL if is_off_band(courses, world, limits, projection, after.z) else RUNNING


@kernel(fastmath=False, allocates=False)
def done_reason(broken, idle, steps, completed, limits, max_steps):
    """Return the code of `DoneReason` of a step, checked in the order of the codes; `broken` is from `rule_broken`."""
    if broken >= 0:
        return broken
    if idle >= limits.max_idle_steps:
        return IDLE
    if steps >= max_steps:
        return MAX_STEP_REACHED
    return SUCCESS if completed else RUNNING


def terminated_and_truncated(reason: Any, limits: Limits) -> tuple[Any, Any]:
    """Return (terminated, truncated), both [N] bool, of codes of `DoneReason` [N], an array or a tensor.

    Only the step limit of the paper's task truncates. The deadline of another task belongs to that task, which shows
    the time that is left: nothing can be earned or cost after it (Pardo et al., "Time Limits in Reinforcement
    Learning", 2018, section 3).
    """
    truncated = (reason == MAX_STEP_REACHED) & (limits.task.deadline == 0)
    return (reason >= 0) & ~truncated, truncated
