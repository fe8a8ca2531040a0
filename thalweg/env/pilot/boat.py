"""The scripted pilot of the boat, which knows the map: proof that its rivers can be run, and a source of films.

It keeps to the middle of the water that carries it. At each step it tries every turn, forward and sideways move, goes
on by a simple law under the exact rules, and takes the move whose progress, less what shallow water costs and what is
not steady, is the greatest. The law pursues a point ahead on the way (pure pursuit; Coulter, 1992). The pilot is
deterministic and keeps no state.
"""

import itertools

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.pilot.boat_ways import BoatWays, missing_clearance, plan_boat_ways, pursued_point
from thalweg.env.pilot.pursuit import pursue
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.motion import UnitAction, move, wrap_angle
from thalweg.env.task.progress import last_segment, metres_left, sample_rows, track_projection
from thalweg.env.task.rules import State, pose_of
from thalweg.env.task.termination import rule_broken
from thalweg.env.vehicle.hull import shallow_cost

MOVES = np.array([(0, *move) for move in itertools.product((0, 1, -1), (1, 0), (0, 1, -1))], dtype=np.int64)
"""[M, 4] all moves of a boat that have an effect, as unit actions: up (never), turn left, forward, left."""
HORIZON = 8
"""Simulated steps for each move."""
LOOKAHEAD_M = 3.0
"""Distance of the pursued point ahead."""
CLEARANCE_WEIGHT = 0.4
"""Penalty in segments of progress for each square metre of missing clearance, and step."""
TURN_WEIGHT = 1.0
"""The same for each radian off the pursued point."""
EFFORT = 0.05
"""The same for each turn and each step aside."""
HOVER_COST = 0.5
"""The same for a first move that is none: postponing a move must not be worth as much as making it."""
FAILURE = -1000.0
"""Worth of a move that breaks a rule itself; each step before a rule is broken adds one."""


class BoatPilot:
    """The pilot of a batch of courses; `unit_actions` takes the state of any number of episodes on them."""

    def __init__(self, courses: CourseArrays, config: EnvConfig, ways: BoatWays | None = None) -> None:
        """`ways`: those through the courses, if they were planned before."""
        self.courses = courses
        self.limits = config.limits
        self.route = plan_boat_ways(courses, config) if ways is None else ways

    def unit_actions(self, state: State) -> np.ndarray:
        """Return the pilot's unit actions [N, 4], each -1, 0 or 1: up, turn left, forward, left."""
        worths = np.empty((len(state.world), len(MOVES)))
        _fill_worths(self.courses, self.limits, self.route, MOVES, state, worths)
        return MOVES[worths.argmax(axis=1)]


@kernel(fastmath=False, allocates=False)
def _fill_worths(courses, limits, ways, moves, state, worths):
    """Fill worths [N, M]."""
    for row in range(len(state.world)):
        for index in range(len(moves)):
            worths[row, index] = _worth(row, moves[index], courses, limits, ways, state)


@kernel(fastmath=False, allocates=False)
def _worth(row, first_move, courses, limits, ways, state):
    """Return the worth of a simulation that starts with a move [4] and then follows the law."""
    world, travel = state.world[row], state.travel[row]
    pose = pose_of(state.pose, row)
    _, projection = track_projection(courses, world, state.segment[row], pose.x, pose.y)
    worth = 0.0
    if first_move[1] == 0 and first_move[2] == 0 and first_move[3] == 0:
        worth = -HOVER_COST
    patience = 1.0 / (1.0 + state.idle[row])
    way = 0 if travel > 0 else 1
    action = UnitAction(0.0, 1.0 * first_move[1], 1.0 * first_move[2], 1.0 * first_move[3])
    for step in range(HORIZON):
        after = move(pose, action, limits)
        offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
        broken = rule_broken(courses, world, limits, pose, after, reached, travel)
        if broken >= 0 and step > 0:
            # The law turns on the spot where its move would break a rule.
            action = UnitAction(0.0, action.turn, 0.0, 0.0)
            after = move(pose, action, limits)
            offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
            broken = rule_broken(courses, world, limits, pose, after, reached, travel)
        if broken >= 0:
            return FAILURE + step
        worth += travel * (offset + reached.fraction - projection.fraction)
        worth -= EFFORT * (abs(action.turn) + abs(action.left))
        pose, projection = after, reached
        a, b = sample_rows(courses, world, projection.segment)
        here = a if projection.fraction < 0.5 else b
        worth -= ways.dread[here, way] * shallow_cost(courses, world, limits, after)
        if courses.closed[world] == 0 and projection.segment == last_segment(courses, world, travel):
            return worth + 2.0 * (HORIZON - step)
        left = metres_left(courses, world, projection, pose.x, pose.y)
        angle, dx, dy = pursued_point(courses, world, projection, travel, ways, left, LOOKAHEAD_M, pose)
        error = wrap_angle(angle - pose.yaw)
        worth -= patience * (
            CLEARANCE_WEIGHT * missing_clearance(courses, ways, here, way, left) + TURN_WEIGHT * abs(error)
        )
        action = pursue(limits, pose.yaw, error, dx, dy)
    return worth
