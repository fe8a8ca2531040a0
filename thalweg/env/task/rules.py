"""One step of the task: motion, progress, reward, cost and termination, for one environment and for many.

The functions take plain arrays and numbers, so that a CUDA kernel can call `step_one` for its own index.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.motion import Pose, UnitAction, move
from thalweg.env.task.progress import course_completed, track_projection, visit_segments
from thalweg.env.task.reward_cost import step_costs, step_reward
from thalweg.env.task.termination import RUNNING, done_reason, rule_broken


class State(NamedTuple):
    """Everything about N episodes that a step reads and changes. K is the largest number of segments."""

    world: np.ndarray
    """[N] int64, index of the world in the course arrays; never changes."""
    pose: np.ndarray
    """[N, 4] float64: x, y, z (metres), yaw (radians)."""
    segment: np.ndarray
    """[N] int64, segment of the projection on the centre line."""
    travel: np.ndarray
    """[N] int64, 1 or -1: the direction of travel along the course."""
    visited: np.ndarray
    """[N, K] uint8, 1 for each visited segment."""
    visited_count: np.ndarray
    """[N] int64."""
    steps: np.ndarray
    """[N] int64, steps of this episode so far."""
    idle: np.ndarray
    """[N] int64, consecutive steps without a new segment."""
    time_s: np.ndarray
    """[N] float64, clock of the water."""


class Outcome(NamedTuple):
    """Result of a step in N environments."""

    reward: np.ndarray
    """[N] float64."""
    costs: np.ndarray
    """[N, 2] float64, tight and loose."""
    reason: np.ndarray
    """[N] int64, code of `DoneReason`."""


def empty_state(world: np.ndarray, courses: CourseArrays) -> State:
    """Return the state of N episodes that have not started, in world [N]."""
    count = len(world)
    zeros = lambda: np.zeros(count, dtype=np.int64)  # noqa: E731
    return State(
        world=np.ascontiguousarray(world, dtype=np.int64),
        pose=np.zeros((count, 4)),
        segment=zeros(),
        travel=np.ones(count, dtype=np.int64),
        visited=np.zeros((count, int(courses.segments.max())), dtype=np.uint8),
        visited_count=zeros(),
        steps=zeros(),
        idle=zeros(),
        time_s=np.zeros(count),
    )


def empty_outcome(count: int) -> Outcome:
    """Return an outcome of N environments without reward or cost, in which every episode is running."""
    return Outcome(np.zeros(count), np.zeros((count, 2)), np.full(count, RUNNING, dtype=np.int64))


@kernel(fastmath=False, allocates=False)
def pose_of(poses, row):
    """Return row `row` of poses [N, 4] as a `Pose`."""
    return Pose(poses[row, 0], poses[row, 1], poses[row, 2], poses[row, 3])


@kernel(fastmath=False, allocates=False)
def action_of(actions, row):
    """Return row `row` of unit actions [N, 4] as a `UnitAction`."""
    return UnitAction(actions[row, 0], actions[row, 1], actions[row, 2], actions[row, 3])


@kernel(fastmath=False, allocates=False)
def clear_outcome(outcome, row):
    """Set the outcome of environment `row` to that of a step in which nothing happened."""
    outcome.reward[row] = 0.0
    outcome.costs[row, 0] = 0.0
    outcome.costs[row, 1] = 0.0
    outcome.reason[row] = RUNNING


@kernel(fastmath=False, allocates=False)
def step_one(row, actions, courses, limits, state, outcome):
    """Step environment `row` by its row of unit actions [N, 4]: change its rows of `state` and `outcome`."""
    after = move(pose_of(state.pose, row), action_of(actions, row), limits)
    arrive_one(row, after, courses, limits, state, outcome)


@kernel(fastmath=False, allocates=False)
def arrive_one(row, after, courses, limits, state, outcome):
    """Step environment `row` by a straight move to the `Pose` after: change its rows of `state` and `outcome`."""
    world = state.world[row]
    before = pose_of(state.pose, row)
    segment_before = state.segment[row]
    offset, projection = track_projection(courses, world, segment_before, after.x, after.y)
    new = visit_segments(courses, world, segment_before, offset, state.visited[row])
    state.pose[row, 0], state.pose[row, 1], state.pose[row, 2], state.pose[row, 3] = after
    state.segment[row] = projection.segment
    state.visited_count[row] += new
    state.steps[row] += 1
    state.idle[row] = 0 if new > 0 else state.idle[row] + 1
    travel = state.travel[row]
    broken = rule_broken(courses, world, limits, before, after, projection, travel)
    completed = course_completed(courses, world, projection.segment, travel, state.visited_count[row])
    reason = done_reason(broken, state.idle[row], state.steps[row], completed, limits, courses.max_steps[world])
    outcome.reward[row] = step_reward(new, courses.segments[world], limits)
    outcome.costs[row, 0], outcome.costs[row, 1] = step_costs(reason, limits)
    outcome.reason[row] = reason


@kernel(fastmath=False, allocates=False)
def step_all(active, actions, courses, limits, state, outcome):
    """Step every active environment; active [N] bool, unit actions [N, 4] float64 with the columns of `UnitAction`."""
    for row in range(len(active)):
        if active[row]:
            step_one(row, actions, courses, limits, state, outcome)
        else:
            clear_outcome(outcome, row)
