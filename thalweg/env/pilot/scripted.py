"""The scripted pilot, which knows the map: proof that the task can be solved, and a source of films.

At each step it tries every turn, forward and sideways move, simulates a simple control law for a few more steps under
the exact rules, and takes the move that progresses furthest along the course. The law pursues a point ahead on the
planned route (pure pursuit; Coulter, 1992) and never makes a move that breaks a rule. The pilot is deterministic and
keeps no state.
"""

import math

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.pilot.route import Route, plan_route
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.motion import UnitAction, move, wrap_angle
from thalweg.env.task.progress import (
    Projection,
    interpolate,
    last_segment,
    sample_rows,
    segment_at_offset,
    track_projection,
)
from thalweg.env.task.rules import State, pose_of
from thalweg.env.task.termination import metres_past_bank, rule_broken

HORIZON = 7
"""Simulated steps for each candidate move."""
LOOKAHEAD_M = 3.5
"""Distance of the pursued point ahead on the route."""
OFFSET_WEIGHT = 0.4
"""Penalty in segments of progress for each metre off the route at the end of a simulation."""
TURN_WEIGHT = 1.5
"""Penalty in segments of progress for each radian off the pursued point at the end of a simulation."""
BANK_CLEARANCE_M = 0.5
"""Clearance from the bank below which the end of a simulation is penalised."""
BANK_WEIGHT = 4.0
"""Penalty in segments of progress for each metre of missing clearance."""
HOVER_COST = 0.5
"""Penalty in segments of progress for starting with no move: postponing a move must not score as high as making it."""
FAILURE = -1000.0
"""Score of a simulation that breaks a rule; each step before that adds one."""


class ScriptedPilot:
    """The pilot of a batch of courses; `unit_actions` takes the state of any number of episodes on them."""

    def __init__(self, courses: CourseArrays, config: EnvConfig, route: Route | None = None) -> None:
        """`route`: that through the courses, if it was planned before."""
        self.courses = courses
        self.limits = config.limits
        self.route = plan_route(courses, config) if route is None else route

    def unit_actions(self, state: State) -> np.ndarray:
        """Return the pilot's unit actions [N, 4], each -1, 0 or 1: up, turn left, forward, left."""
        chosen = np.zeros((len(state.world), 4), dtype=np.int64)
        _choose_all(self.courses, self.limits, self.route, state, chosen)
        return chosen


@kernel(fastmath=False, allocates=False)
def _choose_all(courses, limits, route, state, chosen):
    """Fill chosen [N, 4] with the best unit action of each environment."""
    for row in range(len(state.world)):
        best = 2.0 * FAILURE
        for turn in (0, 1, -1):
            for forward in (1, 0):
                for left in (0, 1, -1):
                    score, climb = _score(row, (turn, forward, left), courses, limits, route, state)
                    if score > best:
                        best = score
                        chosen[row, 0] = climb
                        chosen[row, 1] = turn
                        chosen[row, 2] = forward
                        chosen[row, 3] = left


@kernel(fastmath=False, allocates=False)
def _score(row, first_move, courses, limits, route, state):
    """Return (score, first climb) of a simulation that starts with a move (turn, forward, left) and then follows the
    law."""
    turn, forward, left = first_move
    world, travel = state.world[row], state.travel[row]
    pose = pose_of(state.pose, row)
    _, projection = track_projection(courses, world, state.segment[row], pose.x, pose.y)
    hovers = turn == 0 and forward == 0 and left == 0
    progress = 0.0
    first_climb = 0
    for step in range(HORIZON):
        climb = _climb(courses, limits, world, projection, route, pose.z)
        if step == 0:
            first_climb = climb
        else:
            turn, forward, left = _pursue(courses, limits, world, projection.segment, travel, route, pose)
        action = UnitAction(1.0 * climb, 1.0 * turn, 1.0 * forward, 1.0 * left)
        broken, after, offset, next_projection = _simulate(courses, limits, world, projection, travel, pose, action)
        if broken >= 0 and step > 0:
            # The law turns on the spot where its move would break a rule.
            action = UnitAction(1.0 * climb, 1.0 * turn, 0.0, 0.0)
            broken, after, offset, next_projection = _simulate(courses, limits, world, projection, travel, pose, action)
        if broken >= 0:
            return FAILURE + step, first_climb
        progress += travel * (offset + next_projection.fraction - projection.fraction)
        pose, projection = after, next_projection
        if courses.closed[world] == 0 and projection.segment == last_segment(courses, world, travel):
            return progress + 2.0 * (HORIZON - step), first_climb
    penalty = _end_penalty(courses, world, projection, travel, route, pose) / (1.0 + state.idle[row])
    return progress - penalty - (HOVER_COST if hovers else 0.0), first_climb


@kernel(fastmath=False, allocates=False)
def _end_penalty(courses, world, projection, travel, route, pose):
    """Return the penalty of a simulation that ends at a `Pose`: off the route, off the pursued point, near a bank."""
    angle, _, _ = _pursued_point(courses, world, projection.segment, travel, route, pose)
    _, nearest = track_projection(courses, world, projection.segment, pose.x, pose.y)
    off_route = math.hypot(
        pose.x - interpolate(courses, world, projection, route.line[:, 0]),
        pose.y - interpolate(courses, world, projection, route.line[:, 1]),
    )
    here = Projection(projection.segment, projection.fraction, nearest.distance)
    too_close = max(metres_past_bank(courses, world, here) + BANK_CLEARANCE_M, 0.0)
    return OFFSET_WEIGHT * off_route + TURN_WEIGHT * abs(wrap_angle(angle - pose.yaw)) + BANK_WEIGHT * too_close


@kernel(fastmath=False, allocates=False)
def _simulate(courses, limits, world, projection, travel, pose, action):
    """Return (code of the broken rule or -1, `Pose` after the action, offset in segments, its `Projection`)."""
    after = move(pose, action, limits)
    offset, next_projection = track_projection(courses, world, projection.segment, after.x, after.y)
    broken = rule_broken(courses, world, limits, pose, after, next_projection, travel)
    return broken, after, offset, next_projection


@kernel(fastmath=False, allocates=False)
def _climb(courses, limits, world, projection, route, z):
    """Return 1, 0 or -1: the vertical step towards the height of the route."""
    missing = interpolate(courses, world, projection, route.height) - z
    if missing > 0.5 * limits.vertical_step:
        return 1
    return -1 if missing < -0.5 * limits.vertical_step else 0


@kernel(fastmath=False, allocates=False)
def _pursued_point(courses, world, segment, travel, route, pose):
    """Return (angle, dx, dy) from a `Pose` to the point of the route that lies ahead in the direction of travel."""
    current = segment
    dx = 0.0
    dy = 0.0
    for _ in range(courses.segments[world]):
        a, b = sample_rows(courses, world, current)
        row = b if travel > 0 else a
        dx = route.line[row, 0] - pose.x
        dy = route.line[row, 1] - pose.y
        following = segment_at_offset(courses, world, current, travel)
        if following < 0 or dx * dx + dy * dy >= LOOKAHEAD_M * LOOKAHEAD_M:
            break
        current = following
    return math.atan2(dy, dx), dx, dy


@kernel(fastmath=False, allocates=False)
def _pursue(courses, limits, world, segment, travel, route, pose):
    """Return (turn, forward, left) of the law: turn to the pursued point, fly when it is in front, sidestep to it."""
    angle, dx, dy = _pursued_point(courses, world, segment, travel, route, pose)
    error = wrap_angle(angle - pose.yaw)
    turn = 0
    if error > 0.5 * limits.yaw_step:
        turn = 1
    elif error < -0.5 * limits.yaw_step:
        turn = -1
    forward = 1 if abs(error) < 1.0 else 0
    # The lateral distance counts from the heading after the turn.
    heading = pose.yaw + turn * limits.yaw_step
    lateral = dy * math.cos(heading) - dx * math.sin(heading)
    left = 0
    if lateral > limits.lateral_step:
        left = 1
    elif lateral < -limits.lateral_step:
        left = -1
    return turn, forward, left
