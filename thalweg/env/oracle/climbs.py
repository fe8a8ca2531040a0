"""When to climb over reserves: exact dynamic programming over metres ahead and heights, one metre forward a step."""

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import arc_at, frame_at, interpolated
from thalweg.env.task.priced.reserves import reserve_cost, view_quality
from thalweg.env.task.progress import interpolate

HEIGHT_STEP_M = 0.5
"""Distance between heights of the tables; a vertical step of 1 m is two of them."""
TOO_LOW = -100.0
"""Value of a height at which a bridge or the band of heights is in the way."""


@kernel(fastmath=False, allocates=False)
def height_index(limits, height):
    """Return the fractional index of a height above the water in the tables."""
    return (height - limits.min_height) / HEIGHT_STEP_M


@kernel(fastmath=False, allocates=False)
def fill_climbs(courses, world, limits, lowest, metre_worth, plan, row):
    """Fill `climb_value` and `climb` of a flight in a `Plan`; lowest [G]: metres, least z that bridges permit."""
    start, travel = plan.start_arc[row], plan.travel[row]
    count = plan.climb_value.shape[1]
    for ahead in range(count - 1, -1, -1):
        for index in range(plan.climb_value.shape[2]):
            plan.climb_value[row, ahead, index] = 0.0
            plan.climb[row, ahead, index] = 0
            if ahead < count - 1 and ahead < plan.completed_m[row]:
                _fill_height(courses, world, limits, lowest, metre_worth, plan, row, start, travel, ahead, index)


@kernel(fastmath=False, allocates=False)
def _fill_height(courses, world, limits, lowest, metre_worth, plan, row, start, travel, ahead, index):
    """Fill the entries of a height, of which those one metre further ahead are filled."""
    here, _, _, _ = frame_at(courses, world, start, travel, float(ahead))
    there, _, _, _ = frame_at(courses, world, start, travel, ahead + 1.0)
    level = interpolate(courses, world, there, courses.level)
    drop = interpolate(courses, world, here, courses.level) - level
    arc = arc_at(courses, world, start, travel, ahead + 1.0)
    best = -1.0e30
    for climb in (0, 1, -1):
        height = limits.min_height + HEIGHT_STEP_M * index + climb * limits.vertical_step + drop
        if height < limits.min_height - 1.0e-6 or height > limits.max_height or level + height < lowest[ahead + 1]:
            total = TOO_LOW
        else:
            cost = reserve_cost(courses, world, limits, arc, height)
            later = interpolated(plan.climb_value[row], ahead + 1.0, height_index(limits, height))
            total = metre_worth * view_quality(limits, height) - plan.price * cost + later
        if total > best + 1.0e-9:
            best = total
            plan.climb[row, ahead, index] = climb
    plan.climb_value[row, ahead, index] = best
