"""The steady pilot, a teacher: its moves can be read off the frames that it flies through.

It cruises at one height, in the middle of the channel, and looks where it flies, so that the banks it keeps off are in
view. Where it faces a bank, it first descends until water is in view, and only then turns: from high up, a camera sees
nothing but the trees behind it, which do not tell the way. Each of its moves is judged: `worths` tries all of them,
flies on by a simple law under the exact rules, and adds up progress and what is not steady. The law pursues a point
ahead on the route. The pilot is deterministic and keeps no state.
"""

import math
from functools import partial

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.env.config import EnvConfig
from thalweg.env.moves import MOVES
from thalweg.env.pilot.bank_view import sight_height
from thalweg.env.pilot.ways import Ways, missing_clearance, plan_ways, pursued_point
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.motion import UnitAction, move, wrap_angle
from thalweg.env.task.progress import (
    interpolate,
    last_segment,
    metres_left,
    track_projection,
)
from thalweg.env.task.rules import State, pose_of
from thalweg.env.task.termination import rule_broken

HORIZON = 8
"""Simulated steps for each move."""
LOOKAHEAD_M = 4.0
"""Distance of the pursued point ahead."""
HEIGHT_WEIGHT = 0.3
"""Penalty in segments of progress for each metre off the height to fly at, and step."""
CLEARANCE_WEIGHT = 0.1
"""The same for each square metre of missing clearance beyond the least."""
TURN_WEIGHT = 2.0
"""The same for each radian off the pursued point."""
EFFORT = 0.05
"""The same for each branch that acts without being needed: a turn, a climb, a step aside."""
HOVER_COST = 0.5
"""The same for a first move that is none: postponing a move must not be worth as much as making it."""
BLIND_COST = 50.0
"""The same, once, for a first move other than straight down where a bank is faced and no water is in view; more than a
turn can gain. As a regret it counts as much as a fatal move, see `worst_regret` of imitations."""
FAILURE = -1000.0
"""Worth of a move that breaks a rule itself; each step that is flown before a rule is broken adds one."""


class SteadyPilot:
    """The steady pilot of a batch of courses; its methods take the state of any number of episodes on them."""

    def __init__(self, courses: CourseArrays, config: EnvConfig, ways: Ways | None = None) -> None:
        """`ways`: those through the courses, if they were planned before."""
        self.courses = courses
        self.limits = config.limits
        self.route = plan_ways(courses, config) if ways is None else ways

    def worths(self, state: State) -> np.ndarray:
        """Return the worths [N, M] float64 of all `MOVES`, in segments of progress less what is not steady; below
        FAILURE + HORIZON for moves after which a rule is broken."""
        found = np.empty((len(state.world), len(MOVES)))
        fill = partial(_fill_worths, self.courses, self.limits, self.route, MOVES, state, found)
        run_in_threads(len(found), fill)
        return found

    def unit_actions(self, state: State) -> np.ndarray:
        """Return the pilot's unit actions [N, 4], each -1, 0 or 1: the moves of the greatest worth."""
        return MOVES[self.worths(state).argmax(axis=1)]


@kernel(fastmath=False, allocates=False)
def _fill_worths(courses, limits, ways, moves, state, worths, first, last):
    """Fill the rows `first` to `last` of worths [N, M]."""
    for row in range(first, last):
        for index in range(len(moves)):
            worths[row, index] = _worth(row, moves[index], courses, limits, ways, state)


@kernel(fastmath=False, allocates=False)
def _worth(row, first_move, courses, limits, ways, state):
    """Return the worth of a simulation that starts with a move [4] and then follows the law."""
    world, travel = state.world[row], state.travel[row]
    pose = pose_of(state.pose, row)
    _, projection = track_projection(courses, world, state.segment[row], pose.x, pose.y)
    vertical = first_move[1] == 0 and first_move[2] == 0 and first_move[3] == 0
    worth = -HOVER_COST if vertical and first_move[0] == 0 else 0.0
    descends = vertical and first_move[0] < 0
    if not descends and _is_blind(pose, sight_height(courses, world, projection, travel, ways, pose), limits):
        worth -= BLIND_COST
    patience = 1.0 / (1.0 + state.idle[row])
    action = UnitAction(1.0 * first_move[0], 1.0 * first_move[1], 1.0 * first_move[2], 1.0 * first_move[3])
    for step in range(HORIZON):
        after = move(pose, action, limits)
        offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
        broken = rule_broken(courses, world, limits, pose, after, reached, travel)
        if broken >= 0 and step > 0:
            # The law turns on the spot where its move would break a rule.
            action = UnitAction(action.up, action.turn, 0.0, 0.0)
            after = move(pose, action, limits)
            offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
            broken = rule_broken(courses, world, limits, pose, after, reached, travel)
        if broken >= 0:
            return FAILURE + step
        worth += travel * (offset + reached.fraction - projection.fraction)
        worth -= EFFORT * (abs(action.up) + abs(action.turn) + abs(action.left))
        pose, projection = after, reached
        if courses.closed[world] == 0 and projection.segment == last_segment(courses, world, travel):
            return worth + 2.0 * (HORIZON - step)
        left = metres_left(courses, world, projection, pose.x, pose.y)
        angle, dx, dy = pursued_point(courses, world, projection, travel, ways, left, LOOKAHEAD_M, pose)
        error = wrap_angle(angle - pose.yaw)
        sight = sight_height(courses, world, projection, travel, ways, pose)
        missing = min(interpolate(courses, world, projection, ways.height), sight) - pose.z
        worth -= patience * (
            CLEARANCE_WEIGHT * missing_clearance(courses, world, projection, ways, left)
            + HEIGHT_WEIGHT * abs(missing)
            + TURN_WEIGHT * abs(error)
        )
        if _is_blind(pose, sight, limits):
            action = UnitAction(-1.0, 0.0, 0.0, 0.0)
        else:
            action = _law(limits, pose, error, dx, dy, missing)
    return worth


@kernel(fastmath=False, allocates=False)
def _is_blind(pose, sight, limits):
    """Return whether a `Pose` is more than half a vertical step above its `sight_height`, in metres."""
    return pose.z - sight > 0.5 * limits.vertical_step


@kernel(fastmath=False, allocates=False)
def _law(limits, pose, error, dx, dy, missing):
    """Return the `UnitAction` of the law: to the height to fly at, to the pursued point, forward when it is in front,
    and aside to it.

    error: radians to turn to the pursued point, which lies dx, dy metres away; missing: metres to climb.
    """
    turn = _sign_beyond(error, 0.5 * limits.yaw_step)
    # The lateral distance counts from the heading after the turn.
    heading = pose.yaw + turn * limits.yaw_step
    lateral = dy * math.cos(heading) - dx * math.sin(heading)
    return UnitAction(
        _sign_beyond(missing, 0.5 * limits.vertical_step),
        turn,
        1.0 if abs(error) < 1.0 else 0.0,
        _sign_beyond(lateral, limits.lateral_step),
    )


@kernel(fastmath=False, allocates=False)
def _sign_beyond(value, least):
    """Return the sign of a value, 0.0 within the least that counts."""
    if value > least:
        return 1.0
    return -1.0 if value < -least else 0.0
