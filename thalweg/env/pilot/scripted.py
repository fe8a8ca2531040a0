"""How does one who knows the map fly? The scripted pilot: proof that the task can be done, and a source of films.

At each step it tries every turn, forward and sideways move, lets a simple law fly on for a few steps under the exact
rules, and takes the one that comes furthest along the course. The law pursues a point ahead on the charted line
(Coulter, 1992) and never makes a move that breaks a rule. It is deterministic and keeps no state.
"""

import math

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.pilot.route import drawn
from thalweg.env.task.course_arrays import Courses
from thalweg.env.task.motion import moved, wrapped
from thalweg.env.task.progress import between, followed, sample_rows, shifted
from thalweg.env.task.rules import State
from thalweg.env.task.termination import beyond_bank, hazard

HORIZON = 7
"""Steps that are flown in thought for each first move."""
AHEAD_M = 3.5
"""How far ahead on the charted line the pursued point lies."""
STRAY_WEIGHT = 0.4
"""Segments of progress that a metre off the charted line at the end of a flight costs."""
TURN_WEIGHT = 1.5
"""Segments of progress that a radian off the pursued point at the end of a flight costs."""
BANK_M = 0.5
"""Clearance from the bank below which the end of a flight is worth less."""
BANK_WEIGHT = 4.0
HOVER_COST = 0.5
"""Segments of progress that it costs to begin by doing nothing: putting a move off must not look as good as making
it."""
DOOM = -1000.0
"""Worth of a flight that breaks a rule; each step that it lasts makes it better by one."""


class Pilot:
    """The pilot of some courses; call `shares` with the state of any number of episodes over them."""

    def __init__(self, courses: Courses, config: EnvConfig) -> None:
        self.courses = courses
        self.limits = config.limits
        self.chart = drawn(courses, config)

    def shares(self, state: State) -> np.ndarray:
        """What the pilot does now: shares of a step [N, 4], each -1, 0 or 1: up, turn left, forward, left."""
        chosen = np.zeros((len(state.world), 4), dtype=np.int64)
        _choose_all(self.courses, self.limits, self.chart.line, self.chart.height, state, chosen)
        return chosen


@kernel(fastmath=False)
def _choose_all(courses, limits, line, height, state, chosen):
    """Fill chosen [N, 4] with the best move of each environment."""
    for row in range(len(state.world)):
        best = 2.0 * DOOM
        for turn in (0, 1, -1):
            for ahead in (1, 0):
                for aside in (0, 1, -1):
                    worth, climb = _worth(row, turn, ahead, aside, courses, limits, line, height, state)
                    if worth > best:
                        best = worth
                        chosen[row, 0] = climb
                        chosen[row, 1] = turn
                        chosen[row, 2] = ahead
                        chosen[row, 3] = aside


@kernel(fastmath=False)
def _worth(row, turn, ahead, aside, courses, limits, line, height, state):
    """(worth, first climb) of a flight that begins with a move and goes on by the law."""
    world, segment, travel = state.world[row], state.segment[row], state.travel[row]
    x, y, z, yaw = state.pose[row, 0], state.pose[row, 1], state.pose[row, 2], state.pose[row, 3]
    _, segment, fraction, _ = followed(courses, world, segment, x, y)
    waits = turn == 0 and ahead == 0 and aside == 0
    progress = 0.0
    first_climb = 0
    for step in range(HORIZON):
        climb = _climb(courses, limits, world, segment, fraction, height, z)
        if step == 0:
            first_climb = climb
        else:
            turn, ahead, aside = _pursue(courses, limits, world, segment, travel, line, x, y, yaw)
        danger, nx, ny, nz, nyaw, shift, place, part, _ = _tried(
            courses, limits, world, segment, travel, x, y, z, yaw, climb, turn, ahead, aside
        )
        if danger >= 0 and step > 0:
            danger, nx, ny, nz, nyaw, shift, place, part, _ = _tried(
                courses, limits, world, segment, travel, x, y, z, yaw, climb, turn, 0, 0
            )
        if danger >= 0:
            return DOOM + step, first_climb
        progress += travel * (shift + part - fraction)
        x, y, z, yaw, segment, fraction = nx, ny, nz, nyaw, place, part
        if courses.closed[world] == 0 and segment == (courses.segments[world] - 1 if travel > 0 else 0):
            return progress + 2.0 * (HORIZON - step), first_climb
    angle, _, _ = _target(courses, world, segment, travel, line, x, y)
    _, _, _, distance = followed(courses, world, segment, x, y)
    stray = math.hypot(
        x - between(courses, world, segment, fraction, line[:, 0]),
        y - between(courses, world, segment, fraction, line[:, 1]),
    )
    tight = max(beyond_bank(courses, world, segment, fraction, distance) + BANK_M, 0.0)
    untidy = STRAY_WEIGHT * stray + TURN_WEIGHT * abs(wrapped(angle - yaw)) + BANK_WEIGHT * tight
    return progress - untidy / (1.0 + state.idle[row]) - (HOVER_COST if waits else 0.0), first_climb


@kernel(fastmath=False)
def _tried(courses, limits, world, segment, travel, x, y, z, yaw, climb, turn, ahead, aside):
    """(code of the rule broken or -1, pose after the move, segments passed, segment, fraction, distance)."""
    nx, ny, nz, nyaw = moved(x, y, z, yaw, 1.0 * climb, 1.0 * turn, 1.0 * ahead, 1.0 * aside, limits)
    shift, place, part, distance = followed(courses, world, segment, nx, ny)
    danger = hazard(courses, world, limits, x, y, z, nx, ny, nz, nyaw, place, part, distance, travel)
    return danger, nx, ny, nz, nyaw, shift, place, part, distance


@kernel(fastmath=False)
def _climb(courses, limits, world, segment, fraction, height, z):
    """1, 0 or -1: the vertical step towards the charted height."""
    missing = between(courses, world, segment, fraction, height) - z
    if missing > 0.5 * limits.vertical_step:
        return 1
    return -1 if missing < -0.5 * limits.vertical_step else 0


@kernel(fastmath=False)
def _target(courses, world, segment, travel, line, x, y):
    """(angle, dx, dy) towards the point of the charted line that lies ahead of x, y in the direction of travel."""
    place = segment
    dx = 0.0
    dy = 0.0
    for _ in range(courses.segments[world]):
        a, b = sample_rows(courses, world, place)
        row = b if travel > 0 else a
        dx = line[row, 0] - x
        dy = line[row, 1] - y
        following = shifted(courses, world, place, travel)
        if following < 0 or dx * dx + dy * dy >= AHEAD_M * AHEAD_M:
            break
        place = following
    return math.atan2(dy, dx), dx, dy


@kernel(fastmath=False)
def _pursue(courses, limits, world, segment, travel, line, x, y, yaw):
    """(turn, ahead, aside) of the law: turn to the point ahead, go when it is in front, sidestep to where it lies."""
    angle, dx, dy = _target(courses, world, segment, travel, line, x, y)
    error = wrapped(angle - yaw)
    turn = 0
    if error > 0.5 * limits.yaw_step:
        turn = 1
    elif error < -0.5 * limits.yaw_step:
        turn = -1
    ahead = 1 if abs(error) < 1.0 else 0
    heading = yaw + turn * limits.yaw_step
    across = dy * math.cos(heading) - dx * math.sin(heading)
    aside = 0
    if across > limits.lateral_step:
        aside = 1
    elif across < -limits.lateral_step:
        aside = -1
    return turn, ahead, aside
