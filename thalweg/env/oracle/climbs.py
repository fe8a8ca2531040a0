"""Plans of climbs over reserves: exact dynamic programming over metres ahead and heights, of steps that fly on by one
metre and of steps on the spot."""

from thalweg.core.compute.jit import kernel
from thalweg.env.oracle.ahead import arc_at, frame_at, interpolated
from thalweg.env.task.priced.reserves import reserve_cost, view_quality
from thalweg.env.task.progress import interpolate

HEIGHT_STEP_M = 0.5
"""Distance between heights of the tables; a vertical step of 1 m is two of them."""
CLIMB_SHARE = 0.8
"""Share of a vertical step up that is planned for each metre: steps aside take a flight further than a metre."""
IMPATIENCE = 0.3
"""Share of a metre's worth that a step on the spot takes off: there is no deadline, but waiting must not seem as good
as flying on."""
NO_WAY = -1.0e4
"""Value of a height from which nothing leads over a bridge within the band of heights."""
ON_THE_SPOT = 2
"""Vertical move of a step that does not fly on, up; down if negative."""


@kernel(fastmath=False, allocates=False)
def height_index(limits, height):
    """Return the fractional index of a height above the water in the tables."""
    return (height - limits.min_height) / HEIGHT_STEP_M


@kernel(fastmath=False, allocates=False)
def climb_at(limits, plan, row, ahead, height):
    """Return the vertical move of a flight in a `Plan` at a height above the water: 1, 0, -1, or `ON_THE_SPOT`.

    It is the highest of those of the metres ahead on both sides, for climbs also of the heights on both sides, and for
    descents of the height below: a climb must not begin too late, and a descent not too early.
    """
    metres, heights = plan.climb.shape[1:]
    first = min(max(int(ahead), 0), metres - 1)
    second = min(first + 1, metres - 1)
    index = min(max(height_index(limits, height), 0.0), heights - 1.0)
    below = int(index)
    above = min(below + 1, heights - 1) if index > below else below
    climb = max(plan.climb[row, first, above], plan.climb[row, second, above])
    return max(climb if climb > 0 else -ON_THE_SPOT, plan.climb[row, first, below], plan.climb[row, second, below])


@kernel(fastmath=False, allocates=False)
def fill_climbs(courses, world, limits, metre_worth, plan, row):
    """Fill `climb_value` and `climb` of a flight in a `Plan`; its `lowest` must be there."""
    count, heights = plan.climb_value.shape[1:]
    for ahead in range(count - 1, -1, -1):
        last = ahead == count - 1 or ahead >= plan.completed_m[row]
        for index in range(heights):
            plan.climb_value[row, ahead, index] = 0.0
            plan.climb[row, ahead, index] = 0
            if not last:
                _fly_on(courses, world, limits, metre_worth, plan, row, ahead, index)
        # A way up may lead over many heights: from above for climbs, from below for descents.
        for index in range(heights - 1, -1, -1):
            if not last:
                _stay(courses, world, limits, metre_worth, plan, row, ahead, index, 1)
        for index in range(heights):
            if not last:
                _stay(courses, world, limits, metre_worth, plan, row, ahead, index, -1)


@kernel(fastmath=False, allocates=False)
def _fly_on(courses, world, limits, metre_worth, plan, row, ahead, index):
    """Fill the entries of a height by the best move that flies on, of which those one metre further ahead are
    filled."""
    here, _, _, _ = frame_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead))
    there, _, _, _ = frame_at(courses, world, plan.start_arc[row], plan.travel[row], ahead + 1.0)
    level = interpolate(courses, world, there, courses.level)
    drop = interpolate(courses, world, here, courses.level) - level
    arc = arc_at(courses, world, plan.start_arc[row], plan.travel[row], ahead + 1.0)
    best = NO_WAY
    for climb in (0, 1, -1):
        rise = climb * limits.vertical_step * (CLIMB_SHARE if climb > 0 else 1.0)
        height = limits.min_height + HEIGHT_STEP_M * index + rise + drop
        too_low = height < limits.min_height - 1.0e-6 or level + height < plan.lowest[row, ahead + 1]
        if too_low or height > limits.max_height:
            continue
        cost = reserve_cost(courses, world, limits, arc, height)
        later = interpolated(plan.climb_value[row], ahead + 1.0, height_index(limits, height))
        total = metre_worth * view_quality(limits, height) - plan.price * cost + later
        if total > best + 1.0e-9:
            best = total
            plan.climb[row, ahead, index] = climb
    plan.climb_value[row, ahead, index] = best


@kernel(fastmath=False, allocates=False)
def _stay(courses, world, limits, metre_worth, plan, row, ahead, index, way):
    """Replace the entries of a height where a step on the spot, up or down (way 1 or -1), is better.

    Without it a height that is too low for a bridge would be worth nothing, interpolation would make those just above
    look bad, and flights would wait before each bridge.
    """
    reached = index + way * int(limits.vertical_step / HEIGHT_STEP_M + 0.5)
    if not 0 <= reached < plan.climb_value.shape[2]:
        return
    height = limits.min_height + HEIGHT_STEP_M * reached
    cost = reserve_cost(
        courses, world, limits, arc_at(courses, world, plan.start_arc[row], plan.travel[row], float(ahead)), height
    )
    total = plan.climb_value[row, ahead, reached] - IMPATIENCE * metre_worth - plan.price * cost
    if total > plan.climb_value[row, ahead, index] + 1.0e-6:
        plan.climb_value[row, ahead, index] = total
        plan.climb[row, ahead, index] = way * ON_THE_SPOT
