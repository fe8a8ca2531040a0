"""Clearance: the distance of a vehicle from the nearest bank, island or stone, and what too little of it costs."""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.task.termination import metres_past_bank

ITERATIONS = 4
"""Steps of the iteration for the nearest point of an ellipse: enough for 1e-6 of its size."""
FAR_M = 20.0
"""A bridge is no nearer than any clearance from this distance of its box on."""


@kernel(fastmath=False, allocates=False)
def distance_outside_ellipse(u, v, a, b):
    """Return the distance in metres of a point from an ellipse with half axes a, b, in its frame; 0 inside.

    The nearest point is approached by replacing the curve with its circle of curvature again and again. Source: Adrian
    Stephens (0xfaded), "Simple Method for Distance to Ellipse", 2017.
    """
    if (u / a) * (u / a) + (v / b) * (v / b) <= 1.0:
        return 0.0
    px = abs(u)
    py = abs(v)
    tx = math.sqrt(0.5)
    ty = tx
    for _ in range(ITERATIONS):
        # Centre of curvature of the curve at (a tx, b ty).
        ex = (a * a - b * b) * tx * tx * tx / a
        ey = (b * b - a * a) * ty * ty * ty / b
        radius = math.hypot(a * tx - ex, b * ty - ey)
        reach = math.hypot(px - ex, py - ey)
        tx = min(max(((px - ex) * radius / reach + ex) / a, 0.0), 1.0)
        ty = min(max(((py - ey) * radius / reach + ey) / b, 0.0), 1.0)
        norm = math.hypot(tx, ty)
        tx /= norm
        ty /= norm
    return math.hypot(px - a * tx, py - b * ty)


@kernel(fastmath=False, allocates=False)
def island_distance(courses, island, x, y):
    """Return the distance in metres of x, y from the island in a row of the course arrays; 0 on it."""
    dx = x - courses.island[island, 0]
    dy = y - courses.island[island, 1]
    # The axes are divided by their half lengths.
    a = 1.0 / math.hypot(courses.island[island, 2], courses.island[island, 3])
    b = 1.0 / math.hypot(courses.island[island, 4], courses.island[island, 5])
    u = (dx * courses.island[island, 2] + dy * courses.island[island, 3]) * a
    v = (dx * courses.island[island, 4] + dy * courses.island[island, 5]) * b
    return distance_outside_ellipse(u, v, a, b)


@kernel(fastmath=False, allocates=False)
def stone_distance(courses, bridge, x, y, z):
    """Return how far in metres x, y, z is outside the face of a bridge's hull, grown by the body, that it is furthest
    outside of; 0 inside. It is at most the distance from the hull, and equal to it before a face."""
    outside = 0.0
    for row in range(courses.first_plane[bridge], courses.first_plane[bridge + 1]):
        plane = courses.plane[row, 0] * x + courses.plane[row, 1] * y + courses.plane[row, 2] * z
        outside = max(outside, plane - courses.plane[row, 3])
    return outside


@kernel(fastmath=False, allocates=False)
def box_gap(courses, bridge, x, y):
    """Return the greater of the distances in metres of x, y along both axes from the box of a bridge; 0 within it."""
    across = max(courses.bridge_box[bridge, 0] - x, x - courses.bridge_box[bridge, 3])
    along = max(courses.bridge_box[bridge, 1] - y, y - courses.bridge_box[bridge, 4])
    return max(across, along, 0.0)


@kernel(fastmath=False, allocates=False)
def clearance(courses, world, projection, pose, most):
    """Return the least distance in metres of a `Pose` from banks, islands and stone, in 0..most.

    Banks and islands are as far as they are in plan, whatever the height; `projection` is that of the pose.
    """
    least = min(max(-metres_past_bank(courses, world, projection), 0.0), most)
    for island in range(courses.first_island[world], courses.first_island[world + 1]):
        reach = least + 1.0 / min(
            math.hypot(courses.island[island, 2], courses.island[island, 3]),
            math.hypot(courses.island[island, 4], courses.island[island, 5]),
        )
        if math.hypot(pose.x - courses.island[island, 0], pose.y - courses.island[island, 1]) < reach:
            least = min(least, island_distance(courses, island, pose.x, pose.y))
    for bridge in range(courses.first_bridge[world], courses.first_bridge[world + 1]):
        if box_gap(courses, bridge, pose.x, pose.y) > FAR_M:
            continue
        least = min(least, stone_distance(courses, bridge, pose.x, pose.y, pose.z))
    return least


@kernel(fastmath=False, allocates=False)
def clearance_cost(courses, world, limits, projection, pose):
    """Return the cost in 0..1 of a step that ended at a `Pose`, whose projection is given."""
    enough = limits.task.clearance
    return 1.0 - clearance(courses, world, projection, pose, enough) / enough
