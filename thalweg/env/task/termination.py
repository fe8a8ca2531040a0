"""Where may the camera be? Above the water between the banks, off the islands, within the height band, clear of
bridges.

The centre of the camera decides, but for bridges, which the whole body must not touch.
"""

import math

from thalweg.core.jit import kernel
from thalweg.env.config import DoneReason
from thalweg.env.task.motion import wrapped
from thalweg.env.task.progress import between, direction

RUNNING = int(DoneReason.RUNNING)
COLLISION = int(DoneReason.COLLISION)
OUT_OF_VOLUME_HORIZONTAL = int(DoneReason.OUT_OF_VOLUME_HORIZONTAL)
OUT_OF_VOLUME_VERTICAL = int(DoneReason.OUT_OF_VOLUME_VERTICAL)
YAW_OVER_DEVIATION = int(DoneReason.YAW_OVER_DEVIATION)

EDGE = 1.0e-9
"""Metres or radians by which a limit may be passed: nine turns of 10 degrees are 90, whatever their sum rounds to."""


@kernel(fastmath=False)
def hits_bridge(courses, world, ax, ay, az, bx, by, bz):
    """The first bridge of a world that the body touches on the straight way from a to b, or -1.

    The way is clipped against the planes of each grown hull (Cyrus and Beck, 1978), so that nothing is tunnelled
    through.
    """
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        if max(ax, bx) < courses.bridge_box[bridge, 0] or min(ax, bx) > courses.bridge_box[bridge, 3]:
            continue
        if max(ay, by) < courses.bridge_box[bridge, 1] or min(ay, by) > courses.bridge_box[bridge, 4]:
            continue
        if max(az, bz) < courses.bridge_box[bridge, 2] or min(az, bz) > courses.bridge_box[bridge, 5]:
            continue
        enters = 0.0
        leaves = 1.0
        for row in range(courses.first_plane[bridge], courses.first_plane[bridge + 1]):
            nx = courses.plane[row, 0]
            ny = courses.plane[row, 1]
            nz = courses.plane[row, 2]
            start = nx * ax + ny * ay + nz * az - courses.plane[row, 3]
            end = nx * bx + ny * by + nz * bz - courses.plane[row, 3]
            if start > 0.0 and end > 0.0:
                leaves = -1.0
                break
            if start > 0.0:
                enters = max(enters, start / (start - end))
            elif end > 0.0:
                leaves = min(leaves, start / (start - end))
        if enters <= leaves:
            return bridge - courses.first_bridge[world]
    return -1


@kernel(fastmath=False)
def on_island(courses, world, x, y):
    """The first island of a world that lies under x, y, or -1."""
    for island in range(courses.first_island[world], courses.first_island[world + 1]):
        dx = x - courses.island[island, 0]
        dy = y - courses.island[island, 1]
        u = dx * courses.island[island, 2] + dy * courses.island[island, 3]
        v = dx * courses.island[island, 4] + dy * courses.island[island, 5]
        if u * u + v * v <= 1.0:
            return island - courses.first_island[world]
    return -1


@kernel(fastmath=False)
def beyond_bank(courses, world, segment, fraction, distance):
    """Metres by which a point is beyond the bank, negative over the water; `distance` from the centre line in
    metres."""
    return distance - 0.5 * between(courses, world, segment, fraction, courses.width)


@kernel(fastmath=False)
def deviation(courses, world, segment, fraction, yaw, travel):
    """Angle in 0..pi between the heading and the direction of travel (`travel` 1 or -1 along the course)."""
    course = direction(courses, world, segment, fraction)
    if travel < 0:
        course += math.pi
    return abs(wrapped(yaw - course))


@kernel(fastmath=False)
def hazard(courses, world, limits, ax, ay, az, x, y, z, yaw, segment, fraction, distance, travel):
    """Code of `DoneReason` for the first rule broken by a move from a to the pose at x, y, z, yaw; -1 for none."""
    if hits_bridge(courses, world, ax, ay, az, x, y, z) >= 0:
        return COLLISION
    if beyond_bank(courses, world, segment, fraction, distance) > EDGE or on_island(courses, world, x, y) >= 0:
        return OUT_OF_VOLUME_HORIZONTAL
    height = z - between(courses, world, segment, fraction, courses.level)
    if height < limits.min_height - EDGE or height > limits.max_height + EDGE:
        return OUT_OF_VOLUME_VERTICAL
    if deviation(courses, world, segment, fraction, yaw, travel) > limits.max_yaw_deviation + EDGE:
        return YAW_OVER_DEVIATION
    return RUNNING
