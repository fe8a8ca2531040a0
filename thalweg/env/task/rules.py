"""What does one step do? Motion, projection, credit, payment and ending, wired together for one environment and for
many.

Everything here takes plain arrays and numbers, so that a launcher for another device can call `step_one` for its own
index.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import DoneReason
from thalweg.env.task.course_arrays import Courses
from thalweg.env.task.motion import moved
from thalweg.env.task.progress import arrived, credited, followed
from thalweg.env.task.reward_cost import costs, reward
from thalweg.env.task.termination import hazard

IDLE = int(DoneReason.IDLE)
MAX_STEP_REACHED = int(DoneReason.MAX_STEP_REACHED)
SUCCESS = int(DoneReason.SUCCESS)
RUNNING = int(DoneReason.RUNNING)


class State(NamedTuple):
    """Everything about N episodes that a step reads and changes. K is the largest number of segments."""

    world: np.ndarray
    """[N] int64, row of the courses; never changes."""
    pose: np.ndarray
    """[N, 4] float64: x, y, z (metres), yaw (radians)."""
    segment: np.ndarray
    """[N] int64, where the projection on the centre line lies."""
    travel: np.ndarray
    """[N] int64, 1 or -1: the direction of travel along the course."""
    visited: np.ndarray
    """[N, K] uint8, 1 for each visited segment."""
    visited_count: np.ndarray
    """[N] int64."""
    steps: np.ndarray
    """[N] int64, steps of this episode so far."""
    idle: np.ndarray
    """[N] int64, steps in a row without a new segment."""
    time_s: np.ndarray
    """[N] float64, clock of the water."""


class Outcome(NamedTuple):
    """What a step gave to each of N environments."""

    reward: np.ndarray
    """[N] float64."""
    costs: np.ndarray
    """[N, 2] float64, tight and loose."""
    reason: np.ndarray
    """[N] int64, code of `DoneReason`."""


def empty_state(world: np.ndarray, courses: Courses) -> State:
    """The state of N episodes, world [N], none of which has begun."""
    count = len(world)
    whole = lambda: np.zeros(count, dtype=np.int64)  # noqa: E731
    return State(
        world=np.ascontiguousarray(world, dtype=np.int64),
        pose=np.zeros((count, 4)),
        segment=whole(),
        travel=np.ones(count, dtype=np.int64),
        visited=np.zeros((count, int(courses.segments.max())), dtype=np.uint8),
        visited_count=whole(),
        steps=whole(),
        idle=whole(),
        time_s=np.zeros(count),
    )


def empty_outcome(count: int) -> Outcome:
    """An outcome of N steps in which nothing happened."""
    return Outcome(np.zeros(count), np.zeros((count, 2)), np.full(count, RUNNING, dtype=np.int64))


@kernel(fastmath=False)
def ending(danger, idle, steps, done, limits, max_steps):
    """Code of the reason to end, in the order of the codes; `danger` is the code of `hazard`."""
    if danger >= 0:
        return danger
    if idle >= limits.max_idle_steps:
        return IDLE
    if steps >= max_steps:
        return MAX_STEP_REACHED
    return SUCCESS if done else RUNNING


@kernel(fastmath=False)
def step_one(row, up, left, forward, leftward, courses, limits, state, outcome):
    """One step of environment `row`: changes its rows of `state` and `outcome`."""
    world = state.world[row]
    ax, ay, az = state.pose[row, 0], state.pose[row, 1], state.pose[row, 2]
    x, y, z, yaw = moved(ax, ay, az, state.pose[row, 3], up, left, forward, leftward, limits)
    before = state.segment[row]
    shift, segment, fraction, distance = followed(courses, world, before, x, y)
    new = credited(courses, world, before, shift, state.visited[row])
    state.pose[row, 0], state.pose[row, 1], state.pose[row, 2], state.pose[row, 3] = x, y, z, yaw
    state.segment[row] = segment
    state.visited_count[row] += new
    state.steps[row] += 1
    state.idle[row] = 0 if new > 0 else state.idle[row] + 1
    travel = state.travel[row]
    danger = hazard(courses, world, limits, ax, ay, az, x, y, z, yaw, segment, fraction, distance, travel)
    done = arrived(courses, world, segment, travel, state.visited_count[row])
    reason = ending(danger, state.idle[row], state.steps[row], done, limits, courses.max_steps[world])
    outcome.reward[row] = reward(new, courses.segments[world], limits)
    outcome.costs[row, 0], outcome.costs[row, 1] = costs(reason, limits)
    outcome.reason[row] = reason


@kernel(fastmath=False)
def step_all(active, units, courses, limits, state, outcome):
    """One step of every active environment; active [N] bool, units [N, 4] float64: up, turn left, forward, left in
    -1..1."""
    for row in range(len(active)):
        if active[row]:
            step_one(
                row, units[row, 0], units[row, 1], units[row, 2], units[row, 3], courses, limits, state, outcome
            )  # fmt: skip
        else:
            outcome.reward[row] = 0.0
            outcome.costs[row, 0] = 0.0
            outcome.costs[row, 1] = 0.0
            outcome.reason[row] = RUNNING
