"""The hull of the boat against what it can hit, and the cost of shallow water.

Banks, islands and shoals are one thing: ground that is less than the draught below the water. Rocks, the piers of
bridges, and their arches as far as hull or mast reach up to them, are solid. The sizes are those of
`thalweg.env.config.Limits`, in metres.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.vehicle.footprint import meets_circle, meets_rectangle

CLEAR, SOLID, AGROUND = 0, 1, 2
"""What a hull hits: nothing, something solid, or the ground."""
ALONG, ACROSS = 9, 5
"""Points of the hull under which the depth is measured: of the Otter a quarter of a metre apart, as the maps' nodes."""
WAY_M = 0.6
"""Length of the pieces of a move after each of which the hull is checked; a hull overlaps itself by more than half."""
OFF_MAP_M = -1.0
"""Depth off the map, which ends well behind the banks."""
TOLERANCE_M = 1.0e-9
"""Water that may be missing, so that rounding has no effect."""


@kernel(fastmath=False, allocates=False)
def depth_at(courses, world, x, y):
    """Return the depth of the water at a point in metres, linear between the nodes of the map; negative on land."""
    column = (x - courses.depth_layout[world, 0]) / courses.depth_layout[world, 2]
    row = (y - courses.depth_layout[world, 1]) / courses.depth_layout[world, 2]
    rows = int(courses.depth_layout[world, 3])
    columns = int(courses.depth_layout[world, 4])
    if not (0.0 <= column <= columns - 1.0 and 0.0 <= row <= rows - 1.0):
        return OFF_MAP_M
    left = min(int(column), columns - 2)
    low = min(int(row), rows - 2)
    right_share = column - left
    high_share = row - low
    at = courses.first_depth[world] + low * columns + left
    lower = (1.0 - right_share) * courses.depth[at] + right_share * courses.depth[at + 1]
    upper = (1.0 - right_share) * courses.depth[at + columns] + right_share * courses.depth[at + columns + 1]
    return (1.0 - high_share) * lower + high_share * upper


@kernel(fastmath=False, allocates=False)
def least_depth(courses, world, x, y, yaw, limits):
    """Return the least depth in metres under a hull at x, y with a heading."""
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    least = 1.0e9
    for i in range(ALONG):
        ahead = limits.half_length * (2.0 * i / (ALONG - 1) - 1.0)
        for j in range(ACROSS):
            left = limits.half_beam * (2.0 * j / (ACROSS - 1) - 1.0)
            least = min(least, depth_at(courses, world, x + ahead * cos - left * sin, y + ahead * sin + left * cos))
    return least


@kernel(fastmath=False, allocates=False)
def touches_solid(courses, world, x, y, yaw, limits, clearance):
    """Return whether a hull, grown by a clearance on all sides, touches a rock, a pier or an arch, or the mast an
    arch."""
    half_length = limits.half_length + clearance
    half_beam = limits.half_beam + clearance
    reach = half_length + half_beam
    for rock in range(courses.first_rock[world], courses.first_rock[world + 1]):
        radius = courses.rock[rock, 2]
        centre_x = courses.rock[rock, 0]
        centre_y = courses.rock[rock, 1]
        near = abs(centre_x - x) <= reach + radius and abs(centre_y - y) <= reach + radius
        if near and meets_circle(x, y, yaw, half_length, half_beam, centre_x, centre_y, radius):
            return True
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        dx = x - courses.arch[bridge, 0]
        dy = y - courses.arch[bridge, 1]
        end = courses.arch[bridge, 4]
        half_width = courses.arch[bridge, 5]
        if abs(dx) > end + half_width + reach or abs(dy) > end + half_width + reach:
            continue
        cos = courses.arch[bridge, 2]
        sin = courses.arch[bridge, 3]
        along = dx * cos + dy * sin
        across = dy * cos - dx * sin
        if abs(across) <= half_width + clearance and courses.arch[bridge, 7] - clearance <= abs(along) <= end:
            return True
        pier = 0.5 * (end - courses.arch[bridge, 6])
        middle = end - pier if along > 0.0 else pier - end
        if meets_rectangle(
            x, y, yaw, half_length, half_beam,
            courses.arch[bridge, 0] + middle * cos, courses.arch[bridge, 1] + middle * sin, cos, sin, pier, half_width,
        ):  # fmt: skip
            return True
        # The hull may reach across the middle of the arch to the pier on the other side.
        if meets_rectangle(
            x, y, yaw, half_length, half_beam,
            courses.arch[bridge, 0] - middle * cos, courses.arch[bridge, 1] - middle * sin, cos, sin, pier, half_width,
        ):  # fmt: skip
            return True
    return False


@kernel(fastmath=False, allocates=False)
def first_hit(courses, world, limits, before, after):
    """Return what the hull hits first between two `Pose`s, `CLEAR`, `SOLID` or `AGROUND`; it turns before it moves."""
    dx = after.x - before.x
    dy = after.y - before.y
    pieces = max(1, int(math.ceil(math.hypot(dx, dy) / WAY_M - TOLERANCE_M)))  # noqa: RUF046 - a float on GPUs
    for piece in range(1 if after.yaw == before.yaw else 0, pieces + 1):
        x = before.x + dx * piece / pieces
        y = before.y + dy * piece / pieces
        if touches_solid(courses, world, x, y, after.yaw, limits, 0.0):
            return SOLID
        if least_depth(courses, world, x, y, after.yaw, limits) < limits.draught - TOLERANCE_M:
            return AGROUND
    return CLEAR


@kernel(fastmath=False, allocates=False)
def shallow_cost(courses, world, limits, pose):
    """Return the cost of the water under a `Pose`: `limits.shallow_cost` where it equals the draught, and linearly less
    down to 0 where the margin is left below the keels."""
    spare = least_depth(courses, world, pose.x, pose.y, pose.yaw, limits) - limits.draught
    missing = 1.0 - max(spare, 0.0) / limits.keel_margin
    return limits.shallow_cost * max(missing, 0.0)
