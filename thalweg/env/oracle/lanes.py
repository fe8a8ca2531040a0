"""Lanes: from every point across the river the cheapest way ahead, in steps, by dynamic programming.

With a price of clearance it is counted in the steps that a cost is worth, so that the lane gives way to the bank as far
as that pays. Without one, lanes keep a small margin.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import frame_at
from thalweg.env.pilot.points_across import hindrance, offset_of
from thalweg.env.task.motion import Pose
from thalweg.env.task.priced.clearance import clearance
from thalweg.env.task.progress import Projection, interpolate
from thalweg.env.task.termination import island_at

POINTS = 25
"""Points across the river."""
MARGIN_M, MARGIN_SHARE = 0.3, 0.25
"""Distance of the outer points from the banks, and the same as a share of the width, where that is less."""
KEPT_M = 0.9
"""Clearance below which a lane without a price makes detours."""
KEPT_WEIGHT = 0.5
"""Steps for each metre of missing clearance and metre of way, without a price."""
LAND = 1.0e4
"""Steps for a metre over an island; more than any way round it."""


@kernel(fastmath=False)
def fill_lanes(courses, world, price_steps, clearance_m, pace, plan, row):
    """Fill `reach`, `place`, `lane` and `lane_steps` of a flight in a `Plan`; its `height` must be there.

    price_steps: steps that a cost of clearance of 1 is worth, which is one within no distance of a bank and none from
    clearance_m (metres) on; negative for lanes with a margin instead. pace: metres a step.
    """
    count = plan.reach.shape[1]
    # How much longer a step seems that ends at each point, at this metre ahead and at the next.
    weight = np.zeros((2, POINTS))
    for ahead in range(count - 1, -1, -1):
        centre, x, y, course = frame_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead))
        width = interpolate(courses, world, centre, courses.width)
        plan.reach[row, ahead] = 0.5 * width - min(MARGIN_M, MARGIN_SHARE * width)
        for point in range(POINTS):
            left = offset_of(plan.reach[row, ahead], point, POINTS)
            plan.place[row, ahead, point, 0] = x - left * math.sin(course)
            plan.place[row, ahead, point, 1] = y + left * math.cos(course)
            plan.lane[row, ahead, point] = point
            plan.lane_steps[row, ahead, point] = 0.0
            if ahead < count - 1:
                _fill_point(courses, world, pace, plan, row, ahead, point, weight[1])
            here = Projection(centre.segment, centre.fraction, abs(left))
            weight[0, point] = _weight(courses, world, price_steps, clearance_m, plan, row, ahead, point, here)
        weight[1] = weight[0]


@kernel(fastmath=False, allocates=False)
def _fill_point(courses, world, pace, plan, row, ahead, point, weight):
    """Fill the entries of a point across, of which those one metre further ahead are filled; weight [P]: how much
    longer steps seem that end there."""
    x = plan.place[row, ahead, point, 0]
    y = plan.place[row, ahead, point, 1]
    offset = offset_of(plan.reach[row, ahead], point, POINTS)
    best = 1.0e30
    for after in range(POINTS):
        nx = plan.place[row, ahead + 1, after, 0]
        ny = plan.place[row, ahead + 1, after, 1]
        steps = math.hypot(nx - x, ny - y) / pace * (1.0 + weight[after])
        aside = offset_of(plan.reach[row, ahead + 1], after, POINTS) - offset
        steps += LAND * hindrance(courses, world, x, y, nx, ny, aside)
        total = steps + plan.lane_steps[row, ahead + 1, after]
        if total < best:
            best = total
            plan.lane[row, ahead, point] = after
            plan.lane_steps[row, ahead, point] = total


@kernel(fastmath=False, allocates=False)
def _weight(courses, world, price_steps, clearance_m, plan, row, ahead, point, here):
    """Return how much longer a step seems that ends at a point across, for want of clearance; here: its
    `Projection`."""
    x = plan.place[row, ahead, point, 0]
    y = plan.place[row, ahead, point, 1]
    if island_at(courses, world, x, y) >= 0:
        return LAND
    pose = Pose(x, y, float(plan.height[row, ahead]), 0.0)
    if price_steps < 0.0:
        return KEPT_WEIGHT * (KEPT_M - clearance(courses, world, here, pose, KEPT_M))
    return price_steps * (1.0 - clearance(courses, world, here, pose, clearance_m) / clearance_m)


@kernel(fastmath=False)
def fill_along(courses, world, clearance_m, plan, row, along):
    """Fill along [G] with the cost in 0..1 of a step that ends on the best lane of a flight in a `Plan`, for want of
    clearance below clearance_m (metres), at each metre ahead."""
    point = int(np.argmin(plan.lane_steps[row, 0]))
    for ahead in range(len(along)):
        centre, _, _, _ = frame_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead))
        here = Projection(centre.segment, centre.fraction, abs(offset_of(plan.reach[row, ahead], point, POINTS)))
        place = plan.place[row, ahead, point]
        pose = Pose(place[0], place[1], float(plan.height[row, ahead]), 0.0)
        along[ahead] = 1.0 - clearance(courses, world, here, pose, clearance_m) / clearance_m
        point = plan.lane[row, ahead, point]
