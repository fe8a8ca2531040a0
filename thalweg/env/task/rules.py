"""One step of the task: motion, progress, reward, cost and termination, for one environment and for many.

The functions take plain arrays and numbers, so that a CUDA kernel can call `step_one` for its own index.
"""

from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.env.config import DoneReason
from thalweg.env.task.ashore import is_ashore, project_anywhere
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.ideal_eye import arc_length
from thalweg.env.task.motion import Pose, UnitAction, move
from thalweg.env.task.priced.clearance import clearance_cost
from thalweg.env.task.priced.reserves import reserve_cost, view_quality
from thalweg.env.task.priced.station import REACHED_M, greatest_way, station_of, way_to
from thalweg.env.task.priced.swimmers import passing_cost
from thalweg.env.task.progress import course_completed, interpolate, track_projection, visit_segments
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD, step_costs, step_reward
from thalweg.env.task.termination import RUNNING, done_reason, rule_broken, rule_broken_over_land
from thalweg.env.vehicle.hull import shallow_cost

COST_INCURRED = int(DoneReason.COST_INCURRED)
TASK_STATE = ("scene", "station", "way")
"""Fields of `State` that only tasks beside the paper's read and change."""


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
    scene: np.ndarray
    """[N] int64, the seed of everything that moves in the episode."""
    station: np.ndarray
    """[N] float64, metres along the course of the gauge station."""
    way: np.ndarray
    """[N] float64, metres along the course to the station."""


class Outcome(NamedTuple):
    """Result of a step in N environments."""

    reward: np.ndarray
    """[N] float64."""
    costs: np.ndarray
    """[N, K] float64, with the columns `EnvConfig.cost_kinds`: tight, loose, the kind of the task if it has one, and
    last that of shallow water for a boat."""
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
        scene=zeros(),
        station=np.zeros(count),
        way=np.zeros(count),
    )


def empty_outcome(count: int, kinds: int = 2) -> Outcome:
    """Return an outcome of N environments without reward or cost of K kinds, in which every episode is running."""
    return Outcome(np.zeros(count), np.zeros((count, kinds)), np.full(count, RUNNING, dtype=np.int64))


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
    for kind in range(outcome.costs.shape[1]):
        outcome.costs[row, kind] = 0.0
    outcome.reason[row] = RUNNING


@kernel(fastmath=False, allocates=False)
def begin_task(row, courses, limits, state, projection, scene):
    """Set what the task keeps of an episode of environment `row` that starts at a `Projection`; scene: its seed."""
    world = state.world[row]
    state.scene[row] = scene if courses.swimmers[world] > 0 else 0
    state.station[row] = 0.0
    state.way[row] = 0.0
    if limits.task.portage != 0:
        state.station[row] = station_of(courses, world, projection, state.travel[row])
        state.way[row], _ = way_to(courses, world, arc_length(courses, world, projection), state.station[row])


@kernel(fastmath=False, allocates=False)
def afloat(courses, world, limits, projection, pose):
    """Return a `Pose` with a boat's camera at its height above the water; that of another vehicle unchanged."""
    if limits.is_boat == 0:
        return pose
    level = interpolate(courses, world, projection, courses.level)
    return Pose(pose.x, pose.y, level + limits.camera_height, pose.yaw)


@kernel(fastmath=False, allocates=False)
def step_one(row, actions, courses, limits, state, outcome):
    """Step environment `row` by its row of unit actions [N, 4]: change its rows of `state` and `outcome`."""
    action = action_of(actions, row)
    after = move(pose_of(state.pose, row), action, limits)
    arrive_one(row, action, after, courses, limits, state, outcome)


@kernel(fastmath=False, allocates=False)
def arrive_one(row, action, after, courses, limits, state, outcome):
    """Step environment `row` by a straight move, of a `UnitAction`, to the `Pose` after: change its rows of `state` and
    `outcome`."""
    world = state.world[row]
    before = pose_of(state.pose, row)
    segment_before = state.segment[row]
    offset, projection = track_projection(courses, world, segment_before, after.x, after.y)
    over_land = False
    if limits.task.portage != 0 and is_ashore(courses, world, projection, after.x, after.y):
        # The water that is nearest may be that of another arm: nothing between is visited.
        projection = project_anywhere(courses, world, after.x, after.y)
        over_land = is_ashore(courses, world, projection, after.x, after.y)
        segment_before, offset = projection.segment, 0
        _, state.travel[row] = way_to(courses, world, arc_length(courses, world, projection), state.station[row])
    after = afloat(courses, world, limits, projection, after)
    new = 0 if over_land else visit_segments(courses, world, segment_before, offset, state.visited[row])
    state.pose[row, 0], state.pose[row, 1], state.pose[row, 2], state.pose[row, 3] = after
    state.segment[row] = projection.segment
    state.visited_count[row] += new
    state.steps[row] += 1
    if not over_land:
        state.idle[row] = 0 if new > 0 else state.idle[row] + 1
    travel = state.travel[row]
    if over_land:
        broken = rule_broken_over_land(courses, world, limits, before, after, projection)
    else:
        broken = rule_broken(courses, world, limits, before, after, projection, travel)
    if limits.task.portage != 0:
        outcome.reward[row], completed = approach_station(row, courses, state, projection, over_land)
    else:
        completed = course_completed(courses, world, projection.segment, travel, state.visited_count[row])
        outcome.reward[row] = step_reward(new, courses.segments[world], limits)
        if limits.task.view_height > 0.0:
            outcome.reward[row] *= view_quality(limits, height_above(courses, world, projection, after))
    reason = done_reason(broken, state.idle[row], state.steps[row], completed, limits, courses.max_steps[world])
    outcome.costs[row, 0], outcome.costs[row, 1] = step_costs(reason, limits)
    if outcome.costs.shape[1] > 2:
        own = task_cost(row, courses, limits, state, projection, action, after, over_land)
        outcome.costs[row, 2] = own
        if reason == RUNNING and own > 0.0 and limits.task.hard != 0:
            reason = COST_INCURRED
    if limits.is_boat != 0:
        # Aground or against something, the boat pays for that alone.
        stranded = outcome.costs[row, 0] > 0.0
        outcome.costs[row, outcome.costs.shape[1] - 1] = (
            0.0 if stranded else shallow_cost(courses, world, limits, after)
        )
    outcome.reason[row] = reason


@kernel(fastmath=False, allocates=False)
def height_above(courses, world, projection, pose):
    """Return the height of a `Pose` in metres above the water at its `Projection`."""
    return pose.z - interpolate(courses, world, projection, courses.level)


@kernel(fastmath=False, allocates=False)
def approach_station(row, courses, state, projection, over_land):
    """Return (reward, whether the station is reached) of a move of environment `row` to a `Projection`; `state.way`
    becomes the distance that is left. Moving away takes back what was paid."""
    world = state.world[row]
    before = state.way[row]
    left, _ = way_to(courses, world, arc_length(courses, world, projection), state.station[row])
    reached = left <= REACHED_M and not over_land
    state.way[row] = 0.0 if reached else left
    return FULL_COURSE_REWARD * (before - state.way[row]) / greatest_way(courses, world), reached


@kernel(fastmath=False, allocates=False)
def task_cost(row, courses, limits, state, projection, action, after, over_land):
    """Return the cost of the task's own kind of a step of environment `row` by a `UnitAction` to the `Pose` `after`."""
    world = state.world[row]
    cost = 1.0 if over_land else 0.0
    if limits.task.passing_distance > 0.0:
        cost += passing_cost(courses, world, limits, state.scene[row], state.steps[row], action, after)
    if limits.task.reserve_height > 0.0:
        arc = arc_length(courses, world, projection)
        cost += reserve_cost(courses, world, limits, arc, height_above(courses, world, projection, after))
    if limits.task.clearance > 0.0:
        cost += clearance_cost(courses, world, limits, projection, after)
    return cost


@kernel(fastmath=False, allocates=False)
def step_all(active, actions, courses, limits, state, outcome):
    """Step every active environment; active [N] bool, unit actions [N, 4] float64 with the columns of `UnitAction`."""
    for row in range(len(active)):
        if active[row]:
            step_one(row, actions, courses, limits, state, outcome)
        else:
            clear_outcome(outcome, row)
