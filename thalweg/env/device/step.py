"""Step and reset of one environment as one compiled function, without Python per environment.

A loop on the CPU and a thread of a GPU call the same function. Random numbers are counter-based: those of an episode
follow from the environment's seed and the number of the episode alone, whatever the other environments do and wherever
they are computed. They differ from those of NumPy's generators, which `RiverVectorEnv` uses. An environment whose
episode has ended resets in its next step (`AutoresetMode.NEXT_STEP`), so that every step renders N frames.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.counter_random import scene_of, uniform
from thalweg.core.compute.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.initial_poses import CLOCK_RANGE_S, DRAWS, MAX_TRIES, begin_at_pose, try_start
from thalweg.env.task.rules import clear_outcome, step_one

LOOK_COUNTER = DRAWS
"""Counter of the uniform number of an episode that chooses its look; the first DRAWS are those of a start."""
COUNTERS_PER_TRY = DRAWS + 2
"""Counters reserved for each try of a start."""


class ResetArguments(NamedTuple):
    """What the resets of N environments depend on, and the duration of a step."""

    seed: np.ndarray
    """[N] int64."""
    episode: np.ndarray
    """[N] int64: number of episodes started so far."""
    look: np.ndarray
    """[N] int64: index of the current look."""
    looks: int
    """Number of looks."""
    per_episode: int
    """1: each episode has a look of its own; 0: each environment has one."""
    spread: float
    """Radians: maximum angle between the initial heading and the direction of travel."""
    clearance: float
    """Metres."""
    step_s: float


def reset_arguments(
    config: EnvConfig, seed: np.ndarray, episode: np.ndarray, look: np.ndarray, looks: int
) -> ResetArguments:
    """Return the reset arguments under a config; seed, episode, look [N] int64."""
    per_episode = config.randomisation is None or config.randomisation.per == "episode"
    spread, clearance = math.radians(config.start_heading_deg), float(config.start_clearance_m)
    return ResetArguments(seed, episode, look, looks, int(per_episode), spread, clearance, float(config.step_s))


@kernel(fastmath=False, allocates=False)
def reset_one(row, courses, limits, reset, state, draws):
    """Start an episode in environment `row` at a random safe pose; draws [DRAWS] float64 is scratch memory.

    If no try is safe, the camera stays where the last episode ended, and the new episode ends at its first step.
    `thalweg.env.initial_poses.random_start` finds out beforehand whether a world has a safe start at all.
    """
    world = state.world[row]
    seed = reset.seed[row]
    episode = reset.episode[row]
    for attempt in range(MAX_TRIES):
        for k in range(DRAWS):
            draws[k] = uniform(seed, episode, attempt * COUNTERS_PER_TRY + k)
        if try_start(courses, world, limits, reset.spread, reset.clearance, draws, state.pose[row]):
            break
    state.time_s[row] = CLOCK_RANGE_S * draws[5]
    begin_at_pose(row, courses, limits, state, scene_of(seed, episode))
    if reset.per_episode != 0 or episode == 0:
        reset.look[row] = int(uniform(seed, episode, LOOK_COUNTER) * reset.looks)
    reset.episode[row] = episode + 1


@kernel(fastmath=False, allocates=False)
def restart_one(row, courses, limits, reset, state, outcome, ended, draws):
    """Start an episode in environment `row`, whose last one has ended, without reward or cost."""
    reset_one(row, courses, limits, reset, state, draws)
    clear_outcome(outcome, row)
    ended[row] = 0


@kernel(fastmath=False, allocates=False)
def end_step(row, reset, state, outcome, ended):
    """Advance the clock of environment `row` by a step, and note whether its episode has ended."""
    state.time_s[row] += reset.step_s
    ended[row] = 1 if outcome.reason[row] >= 0 else 0


@kernel(fastmath=False, allocates=False)
def advance_one(row, actions, courses, limits, reset, state, outcome, ended, draws):
    """Step environment `row`, or reset it if its last episode has ended; ended [N] uint8.

    actions [N, 4] float64 are unit actions; draws [DRAWS] float64 is scratch memory.
    """
    if ended[row] != 0:
        restart_one(row, courses, limits, reset, state, outcome, ended, draws)
        return
    step_one(row, actions, courses, limits, state, outcome)
    end_step(row, reset, state, outcome, ended)


@kernel(fastmath=False)
def advance_all(actions, courses, limits, reset, state, outcome, ended):
    """Run `advance_one` for all environments, on the CPU."""
    draws = np.empty(DRAWS)
    for row in range(len(ended)):
        advance_one(row, actions, courses, limits, reset, state, outcome, ended, draws)
