"""The oracle's moves: each is tried under the exact rules, flown on by a law, and judged by the tables of a plan.

The law pursues a point of the lane (pure pursuit; Coulter 1992). A move aside in each step is flown with the heading
turned away from it, since forward and sideways together are faster than forward alone.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DoneReason
from thalweg.env.oracle.ahead import interpolated, metres_ahead, metres_to_the_left
from thalweg.env.oracle.climbs import IMPATIENCE, climb_at, height_index
from thalweg.env.oracle.lanes import POINTS
from thalweg.env.oracle.overland import CELL_M
from thalweg.env.pilot.pursuit import sign_beyond
from thalweg.env.task.motion import wrap_angle
from thalweg.env.task.priced.reserves import view_quality
from thalweg.env.task.progress import interpolate, track_projection
from thalweg.env.task.rules import step_one

SUCCESS, IDLE = int(DoneReason.SUCCESS), int(DoneReason.IDLE)
HORIZON = 6
"""Steps of a trial."""
LOOKAHEAD_M = 3.5
"""Distance of the pursued point."""
TURN_STEPS = 1.5
"""Steps that a radian off the pursued point at the end of a trial is worth."""
AHEAD, AHEAD_WITH_CLEARANCE = 1.0, 0.5
"""Radians off the pursued point within which the law flies on; the second where banks have a price."""
WAITING = 0.05
"""Share of a metre's worth that a step takes off there for each step that came to nothing new before it: without it, a
wait that seems good again in each step would never end."""
FAILURE = -1.0e9
"""Value of a trial that ends by a violation; each step before that adds one."""
CRUISE_M = 7.0
"""Height above the water of flights that cross land: above every bridge of the levels."""
SKEW = math.atan(0.5)
"""Radians between the heading and a move forward and sideways, for steps of 1 m and 0.5 m."""


@kernel(fastmath=False, allocates=False)
def copy_row(source, row, target):
    """Copy an episode of one `State` into the only row of another."""
    target.world[0] = source.world[row]
    for column in range(4):
        target.pose[0, column] = source.pose[row, column]
    target.segment[0] = source.segment[row]
    target.travel[0] = source.travel[row]
    for segment in range(source.visited.shape[1]):
        target.visited[0, segment] = source.visited[row, segment]
    target.visited_count[0] = source.visited_count[row]
    target.steps[0] = source.steps[row]
    target.idle[0] = source.idle[row]
    target.time_s[0] = source.time_s[row]
    target.scene[0] = source.scene[row]
    target.station[0] = source.station[row]
    target.way[0] = source.way[row]


@kernel(fastmath=False, allocates=False)
def choose(courses, limits, plan, moves, state, row, ahead, trial, fallback, outcome, action, chosen):
    """Write the best of moves [M, 4] of environment `row` to chosen [N, 4].

    ahead [N]: metres ahead of now. trial and fallback are states, outcome an outcome and action [1, 4] the unit action
    of one environment: scratch memory.
    """
    best = 2.0 * FAILURE
    world = state.world[row]
    _, projection = track_projection(courses, world, state.segment[row], state.pose[row, 0], state.pose[row, 1])
    climb = _climb(courses, limits, plan, row, ahead[row], projection, world, state.pose[row, 2])
    for index in range(len(moves)):
        for branch in range(4):
            action[0, branch] = moves[index, branch]
        copy_row(state, row, trial)
        if limits.task.view_height <= 0.0:
            action[0, 0] = climb
        value = _value(courses, limits, plan, row, ahead[row], trial, fallback, outcome, action)
        if value > best:
            best = value
            chosen[row, 0] = moves[index, 0] if limits.task.view_height > 0.0 else climb
            for branch in range(1, 4):
                chosen[row, branch] = moves[index, branch]


@kernel(fastmath=False, allocates=False)
def _value(courses, limits, plan, row, ahead, trial, fallback, outcome, action):
    """Return the value of flying on from a trial by an action, and then by the law, which moves aside as the action."""
    aside = action[0, 3]
    total = 0.0
    for step in range(HORIZON):
        copy_row(trial, 0, fallback)
        step_one(0, action, courses, limits, trial, outcome)
        if step > 0 and _failed(outcome):
            # The law turns on the spot where its move would break a rule.
            copy_row(fallback, 0, trial)
            action[0, 2] = 0.0
            action[0, 3] = 0.0
            step_one(0, action, courses, limits, trial, outcome)
        if _failed(outcome):
            return FAILURE + step
        for kind in range(outcome.costs.shape[1]):
            total -= plan.price * outcome.costs[0, kind]
        world, x, y = trial.world[0], trial.pose[0, 0], trial.pose[0, 1]
        _, projection = track_projection(courses, world, trial.segment[0], x, y)
        reached = metres_ahead(courses, world, plan.start_arc[row], plan.travel[row], projection, ahead)
        if _counts_rewards(limits):
            # Metres, not segments: a trial must not gain by ending just after one begins.
            quality = 1.0
            if limits.task.view_height > 0.0:
                height = trial.pose[0, 2] - interpolate(courses, world, projection, courses.level)
                quality = view_quality(limits, height)
            total += plan.step_worth * quality * (reached - ahead)
        ahead = reached
        if outcome.reason[0] == SUCCESS:
            return total + plan.step_worth * (HORIZON - step)
        if outcome.reason[0] == IDLE:
            return total - _lost_by_waiting(limits, plan, row, ahead, trial)
        if outcome.reason[0] >= 0:
            break
        if limits.task.view_height > 0.0:
            total -= WAITING * plan.step_worth * trial.idle[0]
        _follow(courses, limits, plan, row, ahead, projection, trial, aside, action)
    error = _pursuit_error(courses, plan, row, ahead, trial, aside)
    return (
        total
        + _outlook(courses, limits, plan, row, ahead, projection, trial)
        - (plan.step_worth * TURN_STEPS * abs(error))
    )


@kernel(fastmath=False, allocates=False)
def _failed(outcome):
    """Return whether the step ended the episode by a violation other than waiting too long, whose cost may be worth
    it."""
    return 0 <= outcome.reason[0] < IDLE or outcome.reason[0] > SUCCESS


@kernel(fastmath=False, allocates=False)
def _lost_by_waiting(limits, plan, row, ahead, trial):
    """Return what an episode that waited too long is worse than one that flies on at no cost, in units of return: what
    was still to be had, and in tables of steps also those that it does not fly."""
    if _counts_rewards(limits):
        return 0.0
    left = trial.way[0] if limits.task.portage != 0 else plan.completed_m[row] - ahead
    return 2.0 * plan.step_worth * max(left, 0.0)


@kernel(fastmath=False, allocates=False)
def _counts_rewards(limits):
    """Return whether the tables hold the return that is still to be had; if not, they hold steps."""
    return limits.task.fast_step > 0.0 or limits.task.view_height > 0.0


@kernel(fastmath=False, allocates=False)
def _outlook(courses, limits, plan, row, ahead, projection, trial):
    """Return what is still to be had after a trial, in units of return."""
    x, y = trial.pose[0, 0], trial.pose[0, 1]
    if limits.task.portage != 0:
        column, line = (x - plan.grid_origin[row, 0]) / CELL_M, (y - plan.grid_origin[row, 1]) / CELL_M
        return -plan.step_worth * interpolated(plan.grid_steps[row], line, column)
    point = _point_across(courses, plan, row, ahead, trial.world[0], x, y)
    steps = interpolated(plan.lane_steps[row], ahead, point)
    if not _counts_rewards(limits):
        return -plan.step_worth * steps
    # What a place across is worse than the best of its sample.
    least = 1.0e30
    sample = min(max(int(ahead), 0), plan.lane_steps.shape[1] - 1)
    for across in range(POINTS):
        least = min(least, plan.lane_steps[row, sample, across])
    rate = 0.0 if sample + 1 >= plan.lane_steps.shape[1] else max(ahead - sample, 0.0)
    excess = max(steps - least + rate, 0.0)
    if limits.task.view_height > 0.0:
        height = trial.pose[0, 2] - interpolate(courses, trial.world[0], projection, courses.level)
        value = interpolated(plan.climb_value[row], ahead, height_index(limits, height))
        # Without a deadline, waiting is worth as much as flying on.
        value -= IMPATIENCE * plan.step_worth * (plan.completed_m[row] - ahead)
    else:
        value = interpolated(plan.speed_value[row], 1.0 * trial.steps[0], ahead)
    # Behind the start there are no tables, and no way that saves cost.
    behind = max(-ahead, 0.0) * (plan.step_worth + plan.price)
    return value - plan.step_worth * excess - behind


@kernel(fastmath=False, allocates=False)
def _point_across(courses, plan, row, ahead, world, x, y):
    """Return the fractional number of the point across that x, y is at."""
    left = metres_to_the_left(courses, world, plan.start_arc[row], plan.travel[row], ahead, x, y)
    reach = plan.reach[row, min(max(int(ahead + 0.5), 0), plan.reach.shape[1] - 1)]
    return min(max(0.5 * (left / reach + 1.0) * (POINTS - 1), 0.0), POINTS - 1.0)


@kernel(fastmath=False, allocates=False)
def _pursued(courses, plan, row, ahead, trial):
    """Return x, y of the point of the cheapest way that lies `LOOKAHEAD_M` away."""
    x, y = trial.pose[0, 0], trial.pose[0, 1]
    if plan.grid_steps.shape[1] > 1:
        return _pursued_cell(plan, row, x, y)
    sample = min(max(int(ahead) + 1, 0), plan.lane.shape[1] - 1)
    point = int(_point_across(courses, plan, row, ahead, trial.world[0], x, y) + 0.5)
    px = plan.place[row, sample, point, 0]
    py = plan.place[row, sample, point, 1]
    while math.hypot(px - x, py - y) < LOOKAHEAD_M and sample < plan.lane.shape[1] - 1:
        point = plan.lane[row, sample, point]
        sample += 1
        px = plan.place[row, sample, point, 0]
        py = plan.place[row, sample, point, 1]
    return px, py


@kernel(fastmath=False, allocates=False)
def _pursued_cell(plan, row, x, y):
    """Return x, y of the first cell of the way to the station that is `LOOKAHEAD_M` away, or of its last one."""
    rows, columns = plan.grid_next.shape[1], plan.grid_next.shape[2]
    column = min(max(int((x - plan.grid_origin[row, 0]) / CELL_M + 0.5), 0), columns - 1)
    line = min(max(int((y - plan.grid_origin[row, 1]) / CELL_M + 0.5), 0), rows - 1)
    cell = line * columns + column
    for _ in range(2 * int(LOOKAHEAD_M / CELL_M)):
        px = plan.grid_origin[row, 0] + CELL_M * (cell % columns)
        py = plan.grid_origin[row, 1] + CELL_M * (cell // columns)
        if math.hypot(px - x, py - y) >= LOOKAHEAD_M:
            break
        cell = plan.grid_next[row, cell // columns, cell % columns]
    return plan.grid_origin[row, 0] + CELL_M * (cell % columns), plan.grid_origin[row, 1] + CELL_M * (cell // columns)


@kernel(fastmath=False, allocates=False)
def _pursuit_error(courses, plan, row, ahead, trial, aside):
    """Return the radians from the heading to the one by which the pursued point is reached, moving aside."""
    px, py = _pursued(courses, plan, row, ahead, trial)
    angle = math.atan2(py - trial.pose[0, 1], px - trial.pose[0, 0])
    return wrap_angle(angle - aside * SKEW - trial.pose[0, 3])


@kernel(fastmath=False, allocates=False)
def _follow(courses, limits, plan, row, ahead, projection, trial, aside, action):
    """Write the unit action of the law to action [1, 4]."""
    error = _pursuit_error(courses, plan, row, ahead, trial, aside)
    action[0, 1] = sign_beyond(error, 0.5 * limits.yaw_step)
    priced = limits.task.clearance > 0.0 and plan.price > 0.0
    near = abs(error) < (AHEAD_WITH_CLEARANCE if priced else AHEAD)
    action[0, 2] = 1.0 if near else 0.0
    action[0, 3] = aside if near else 0.0
    climb = _climb(courses, limits, plan, row, ahead, projection, trial.world[0], trial.pose[0, 2])
    action[0, 0] = sign_beyond(climb, 0.0)
    if abs(climb) > 1.0:
        action[0, 2] = 0.0
        action[0, 3] = 0.0
    if limits.task.fast_step > 0.0 and near:
        steps = min(trial.steps[0], plan.speed.shape[1] - 1)
        if plan.speed[row, steps, min(max(int(ahead + 0.5), 0), plan.speed.shape[2] - 1)] == 2:
            action[0, 2] = -1.0


@kernel(fastmath=False, allocates=False)
def _climb(courses, limits, plan, row, ahead, projection, world, z):
    """Return the vertical unit move of the law at a height z in metres: 1, 0 or -1, or over reserves twice that for one
    on the spot."""
    level = interpolate(courses, world, projection, courses.level)
    if limits.task.view_height > 0.0:
        return 1.0 * climb_at(limits, plan, row, ahead, z - level)
    target = level + CRUISE_M
    if limits.task.portage == 0:
        target = plan.height[row, min(max(int(ahead + 0.5), 0), plan.height.shape[1] - 1)]
    return sign_beyond(target - z, 0.5 * limits.vertical_step)
