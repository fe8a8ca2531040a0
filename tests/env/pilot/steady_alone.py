"""The steady pilot's worths by the slow way: each move is flown alone, in plain Python, under the exact rules."""

import math

import numpy as np

from thalweg.env import RiverVectorEnv
from thalweg.env.moves import MOVES
from thalweg.env.pilot import steady
from thalweg.env.pilot.bank_view import sight_height
from thalweg.env.pilot.ways import missing_clearance, plan_ways, pursued_point
from thalweg.env.task.motion import Pose, UnitAction, move, wrap_angle
from thalweg.env.task.progress import interpolate, last_segment, metres_left, track_projection
from thalweg.env.task.termination import rule_broken


def worths_alone(env: RiverVectorEnv) -> np.ndarray:
    """The worths [N, M] of all moves in the current state of an environment whose rivers do not change."""
    ways = plan_ways(env.courses, env.config)
    rows = range(env.num_envs)
    return np.array([[_worth(env, ways, row, first_move.tolist()) for first_move in MOVES] for row in rows])


def _worth(env, ways, row, first_move):
    courses, limits, state = env.courses, env.config.limits, env.state
    world, travel = int(state.world[row]), int(state.travel[row])
    pose = Pose(*state.pose[row].tolist())
    _, projection = track_projection(courses, world, int(state.segment[row]), pose.x, pose.y)
    sight = sight_height(courses, world, projection, travel, ways, pose)
    worth = 0.0 if any(first_move) else -steady.HOVER_COST
    if first_move != [-1, 0, 0, 0] and pose.z - sight > 0.5 * limits.vertical_step:
        worth -= steady.BLIND_COST
    action = UnitAction(*map(float, first_move))
    for step in range(steady.HORIZON):
        for tried in (action, UnitAction(action.up, action.turn, 0.0, 0.0)):
            after = move(pose, tried, limits)
            offset, reached = track_projection(courses, world, projection.segment, after.x, after.y)
            broken = rule_broken(courses, world, limits, pose, after, reached, travel) >= 0
            if step == 0 or not broken:
                break
        if broken:
            return steady.FAILURE + step
        worth += travel * (offset + reached.fraction - projection.fraction)
        worth -= steady.EFFORT * (abs(tried.up) + abs(tried.turn) + abs(tried.left))
        pose, projection = after, reached
        if not courses.closed[world] and projection.segment == last_segment(courses, world, travel):
            return worth + 2.0 * (steady.HORIZON - step)
        left = metres_left(courses, world, projection, pose.x, pose.y)
        angle, dx, dy = pursued_point(courses, world, projection, travel, ways, left, steady.LOOKAHEAD_M, pose)
        error = wrap_angle(angle - pose.yaw)
        sight = sight_height(courses, world, projection, travel, ways, pose)
        missing = min(interpolate(courses, world, projection, ways.height), sight) - pose.z
        worth -= (
            steady.CLEARANCE_WEIGHT * missing_clearance(courses, world, projection, ways, left)
            + steady.HEIGHT_WEIGHT * abs(missing)
            + steady.TURN_WEIGHT * abs(error)
        ) / (1.0 + state.idle[row])
        if pose.z - sight > 0.5 * limits.vertical_step:
            action = UnitAction(-1.0, 0.0, 0.0, 0.0)
            continue
        turn = _sign(error, 0.5 * limits.yaw_step)
        heading = pose.yaw + turn * limits.yaw_step
        lateral = dy * math.cos(heading) - dx * math.sin(heading)
        forward = 1.0 if abs(error) < 1.0 else 0.0
        action = UnitAction(
            _sign(missing, 0.5 * limits.vertical_step), turn, forward, _sign(lateral, limits.lateral_step)
        )
    return worth


def _sign(value, least):
    return math.copysign(1.0, value) if abs(value) > least else 0.0
