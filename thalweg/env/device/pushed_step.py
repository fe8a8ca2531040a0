"""Step and reset of one environment under wind, current and inertia; see `thalweg.env.device.step`."""

import numpy as np

from thalweg.core.compute.counter_random import hashed
from thalweg.core.compute.jit import kernel
from thalweg.env.device.step import end_step, restart_one
from thalweg.env.forces.step import step_pushed_one
from thalweg.env.forces.weather import begin_weather
from thalweg.env.initial_poses import DRAWS

WEATHER_COUNTER = DRAWS + 1
"""Counter of the random number of an episode that is the key of its weather: none of a start, nor that of its look."""


@kernel(fastmath=False, allocates=False)
def advance_pushed_one(row, actions, courses, limits, forces, reset, state, force_state, outcome, ended, draws):
    """As `thalweg.env.device.step.advance_one`, under wind, current and inertia."""
    if ended[row] != 0:
        # A key is an int64 of any bits but the sign.
        key = np.int64(hashed(reset.seed[row], reset.episode[row], WEATHER_COUNTER) >> np.uint64(1))
        restart_one(row, courses, limits, reset, state, outcome, ended, draws)
        begin_weather(row, key, forces, force_state)
        return
    step_pushed_one(row, actions, courses, limits, forces, state, force_state, outcome)
    end_step(row, reset, state, outcome, ended)


@kernel(fastmath=False)
def advance_pushed_all(actions, courses, limits, forces, reset, state, force_state, outcome, ended):
    """Run `advance_pushed_one` for all environments, on the CPU."""
    draws = np.empty(DRAWS)
    for row in range(len(ended)):
        advance_pushed_one(row, actions, courses, limits, forces, reset, state, force_state, outcome, ended, draws)
