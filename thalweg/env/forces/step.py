"""One step of the task under wind, current and inertia, for one environment and for many.

The way of a step is straight: that from where it begins to where it ends, so that the rules are those without forces.
"""

import math

from thalweg.core.compute.jit import kernel
from thalweg.env.forces.weather import advance_gusts, current_at, wind_now
from thalweg.env.physics.inertia import UNLIMITED, follow, follow_plane
from thalweg.env.task.motion import Pose, move, wrap_angle
from thalweg.env.task.progress import track_projection
from thalweg.env.task.rules import action_of, arrive_one, clear_outcome, pose_of


@kernel(fastmath=False, allocates=False)
def move_inertial(row, before, action, limits, forces, push_x, push_y, push_z, velocity):
    """Return the `Pose` after a step from a `Pose` by a `UnitAction` that commands velocities; change velocity [N, 4].

    As in `thalweg.env.task.motion`, the turn comes first, and the commands count in the new heading. push_x, push_y,
    push_z are the wind in m/s that pushes.
    """
    law = forces.inertia
    forward = action.forward
    if forward < 0.0 and limits.allow_backward == 0:
        forward = 0.0
    velocity[row, 3], turn = follow(
        velocity[row, 3], action.turn * law.yaw_rate, law.yaw_time_constant, UNLIMITED, forces.step_s
    )
    yaw = wrap_angle(before.yaw + turn)
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    forward *= law.forward
    left = action.left * law.lateral
    share = law.drag * law.time_constant
    velocity[row, 0], velocity[row, 1], dx, dy = follow_plane(
        velocity[row, 0],
        velocity[row, 1],
        forward * cos - left * sin + share * push_x,
        forward * sin + left * cos + share * push_y,
        law.time_constant,
        law.acceleration,
        forces.step_s,
    )
    climb = action.up * law.vertical + law.drag * law.vertical_time_constant * push_z
    if limits.is_boat != 0:
        climb = 0.0
    velocity[row, 2], dz = follow(
        velocity[row, 2],
        climb,
        law.vertical_time_constant,
        law.vertical_acceleration,
        forces.step_s,
    )
    return Pose(before.x + dx, before.y + dy, before.z + dz, yaw)


@kernel(fastmath=False, allocates=False)
def move_pushed(row, before, action, courses, limits, forces, state, force_state):
    """Return the `Pose` of environment `row` after a step from a `Pose` by a `UnitAction`, under all forces."""
    east, north, up = wind_now(row, forces, force_state)
    if forces.afloat != 0:
        up = 0.0
    if forces.inertial != 0:
        after = move_inertial(row, before, action, limits, forces, east, north, up, force_state.velocity)
    else:
        share = forces.wind.drift_share * forces.step_s
        own = move(before, action, limits)
        after = Pose(own.x + share * east, own.y + share * north, own.z + share * up, own.yaw)
    if forces.afloat == 0:
        return after
    world = state.world[row]
    _, projection = track_projection(courses, world, state.segment[row], before.x, before.y)
    east, north = current_at(courses, world, projection, force_state.current[row])
    return Pose(after.x + forces.step_s * east, after.y + forces.step_s * north, after.z, after.yaw)


@kernel(fastmath=False, allocates=False)
def step_pushed_one(row, actions, courses, limits, forces, state, force_state, outcome):
    """As `thalweg.env.task.rules.step_one`, under wind, current and inertia."""
    before, action = pose_of(state.pose, row), action_of(actions, row)
    after = move_pushed(row, before, action, courses, limits, forces, state, force_state)
    arrive_one(row, action, after, courses, limits, state, outcome)
    advance_gusts(row, state.steps[row], forces, force_state)


@kernel(fastmath=False, allocates=False)
def step_pushed_all(active, actions, courses, limits, forces, state, force_state, outcome):
    """As `thalweg.env.task.rules.step_all`, under wind, current and inertia."""
    for row in range(len(active)):
        if active[row]:
            step_pushed_one(row, actions, courses, limits, forces, state, force_state, outcome)
        else:
            clear_outcome(outcome, row)
