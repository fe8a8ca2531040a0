"""CUDA kernels of `thalweg.env.device`, of the ideal eyes, of tasks and of proprioception: one thread per environment,
in float64."""

from numba import cuda, float64

from thalweg.env.device.pushed_step import advance_pushed_one
from thalweg.env.device.step import advance_one
from thalweg.env.forces.weather import wind_now
from thalweg.env.initial_poses import DRAWS
from thalweg.env.task.ideal_eye import see_one
from thalweg.env.task.priced.eye import see_in_task as see_one_in_task
from thalweg.env.task.priced.props import props_of
from thalweg.env.task.proprioception import feel_one
from thalweg.env.vehicle.boat_eye import see_boat

THREADS = 64
"""Threads of a block: few, so that a few thousand environments are spread over the whole GPU."""


def advance(actions, courses, limits, reset, state, outcome, ended):
    """As `step.advance_all`, for vehicles that fly."""
    row = cuda.grid(1)
    # The compiler leaves out what only a boat needs, which would take most of the registers.
    if row >= len(ended) or limits.is_boat != 0:
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_one(row, actions, courses, limits, reset, state, outcome, ended, draws)


def advance_boats(actions, courses, limits, reset, state, outcome, ended):
    """As `step.advance_all`, for boats."""
    row = cuda.grid(1)
    if row >= len(ended) or limits.is_boat == 0:
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_one(row, actions, courses, limits, reset, state, outcome, ended, draws)


def advance_pushed(actions, courses, limits, forces, reset, state, force_state, outcome, ended):
    """As `pushed_step.advance_pushed_all`, for vehicles that fly."""
    row = cuda.grid(1)
    if row >= len(ended) or limits.is_boat != 0:
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_pushed_one(row, actions, courses, limits, forces, reset, state, force_state, outcome, ended, draws)


def advance_pushed_boats(actions, courses, limits, forces, reset, state, force_state, outcome, ended):
    """As `pushed_step.advance_pushed_all`, for boats."""
    row = cuda.grid(1)
    if row >= len(ended) or limits.is_boat == 0:
        return
    draws = cuda.local.array(DRAWS, float64)
    advance_pushed_one(row, actions, courses, limits, forces, reset, state, force_state, outcome, ended, draws)


def write_winds(forces, force_state, out):
    """As `thalweg.env.forces.of_many.write_winds`."""
    row = cuda.grid(1)
    if row < len(out):
        out[row, 0], out[row, 1], out[row, 2] = wind_now(row, forces, force_state)


def see(courses, max_height, world, pose, segment, travel, out):
    """As `ideal_eye.see_all`."""
    row = cuda.grid(1)
    if row < len(out):
        see_one(courses, max_height, world[row], pose[row], segment[row], travel[row], out[row])


def see_boats(courses, limits, world, pose, out):
    """As `boat_eye.see_boats`."""
    row = cuda.grid(1)
    if row < len(out):
        see_boat(courses, limits, world[row], pose[row], out[row])


def see_in_task(courses, limits, world, pose, segment, travel, steps, scene, station, out):
    """As `eye.see_all_in_task`."""
    row = cuda.grid(1)
    if row < len(out):
        see_one_in_task(row, courses, limits, world, pose, segment, travel, steps, scene, station, out)


def props(courses, limits, world, pose, steps, scene, station, out):
    """As `props.all_props`."""
    row = cuda.grid(1)
    if row < len(out):
        props_of(row, courses, limits, world, pose, steps, scene, station, out)


def feel(courses, step_s, world, pose, segment, last_pose, last_action, out):
    """As `proprioception.feel_all`."""
    row = cuda.grid(1)
    if row < len(out):
        feel_one(courses, step_s, world[row], pose[row], segment[row], last_pose[row], last_action[row], out[row])
