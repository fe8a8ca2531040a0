"""Lanes: from every point across the river the cheapest way ahead, in steps, by dynamic programming.

With a price of clearance it is counted in the steps that a cost is worth, so that the lane gives way to the bank as far
as that pays. Without one, lanes keep a small margin.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import frame_at, offset_of
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
STEEPEST = 1.0
"""Greatest slope of a lane against the course."""


@kernel(fastmath=False)
def fill_lanes(courses, world, price_steps, clearance_m, pace, plan, row):
    """Fill `reach`, `lane` and `lane_steps` of a flight in a `Plan`; its `height` must be there.

    price_steps: steps that a cost of clearance of 1 is worth, which is one within no distance of a bank and none from
    clearance_m (metres) on; negative for lanes with a margin instead. pace: metres a step.
    """
    start, travel = plan.start_arc[row], plan.travel[row]
    count = plan.reach.shape[1]
    for ahead in range(count - 1, -1, -1):
        centre, _, _, _ = frame_at(courses, world, start, travel, float(ahead))
        width = interpolate(courses, world, centre, courses.width)
        plan.reach[row, ahead] = 0.5 * width - min(MARGIN_M, MARGIN_SHARE * width)
        for point in range(POINTS):
            plan.lane[row, ahead, point] = point
            plan.lane_steps[row, ahead, point] = 0.0
            if ahead < count - 1:
                _fill_point(courses, world, price_steps, clearance_m, pace, plan, row, ahead, point)


@kernel(fastmath=False, allocates=False)
def _fill_point(courses, world, price_steps, clearance_m, pace, plan, row, ahead, point):
    """Fill the entries of a point across, of which those one metre further ahead are filled."""
    x, y = place(courses, world, plan, row, ahead, point)
    best = 1.0e30
    for after in range(POINTS):
        nx, ny = place(courses, world, plan, row, ahead + 1, after)
        length = math.hypot(nx - x, ny - y)
        aside = abs(
            offset_of(plan.reach[row, ahead + 1], after, POINTS) - offset_of(plan.reach[row, ahead], point, POINTS)
        )
        steps = length / pace * (1.0 + _weight(courses, world, price_steps, clearance_m, plan, row, ahead + 1, after))
        steep = aside - length * STEEPEST / math.sqrt(1.0 + STEEPEST * STEEPEST)
        if steep > 0.0:
            steps += LAND * steep
        if island_at(courses, world, 0.5 * (x + nx), 0.5 * (y + ny)) >= 0:
            steps += LAND
        total = steps + plan.lane_steps[row, ahead + 1, after]
        if total < best:
            best = total
            plan.lane[row, ahead, point] = after
            plan.lane_steps[row, ahead, point] = total


@kernel(fastmath=False, allocates=False)
def place(courses, world, plan, row, ahead, point):
    """Return x, y of a point across, so many whole metres ahead."""
    _, x, y, course = frame_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead))
    left = offset_of(plan.reach[row, ahead], point, POINTS)
    return x - left * math.sin(course), y + left * math.cos(course)


@kernel(fastmath=False, allocates=False)
def _weight(courses, world, price_steps, clearance_m, plan, row, ahead, point):
    """Return how much longer a step seems that ends at a point across, for want of clearance."""
    x, y = place(courses, world, plan, row, ahead, point)
    if island_at(courses, world, x, y) >= 0:
        return LAND
    centre, _, _, _ = frame_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead))
    here = Projection(centre.segment, centre.fraction, abs(offset_of(plan.reach[row, ahead], point, POINTS)))
    pose = Pose(x, y, float(plan.height[row, ahead]), 0.0)
    if price_steps < 0.0:
        return KEPT_WEIGHT * (KEPT_M - clearance(courses, world, here, pose, KEPT_M))
    return price_steps * (1.0 - clearance(courses, world, here, pose, clearance_m) / clearance_m)
