"""How does an episode begin, and go on, where there is no Python per environment? One environment's rules as one
function, for a loop on the CPU and for a thread of a GPU.

Random numbers are counted instead of drawn: those of an episode follow from the environment's seed and the episode's
number alone, whatever the other environments do and wherever it is computed. They are not those of NumPy's generators,
which `RiverVectorEnv` uses. An environment whose episode has ended begins another in its next step (Gymnasium calls
that NEXT_STEP), so that every step shows as many frames as there are environments.
"""

import math
from typing import NamedTuple

import numpy as np

from thalweg.core.jit import kernel
from thalweg.env.config import EnvConfig
from thalweg.env.initial_poses import CLOCK_S, DRAWS, TRIES, drawn_start, heading_way, located
from thalweg.env.task.rules import RUNNING, step_one

u64 = np.uint64

FREE = DRAWS
"""Number of an episode's first uniform number that no start uses: it chooses the look."""
ROOM = DRAWS + 2
"""Uniform numbers that each try of a start counts."""


class Begins(NamedTuple):
    """What the beginnings of N episodes depend on, and the time that a step takes."""

    seed: np.ndarray
    """[N] int64."""
    episode: np.ndarray
    """[N] int64: how many episodes have begun."""
    look: np.ndarray
    """[N] int64: which of the looks is drawn."""
    looks: int
    """How many there are."""
    per_episode: int
    """1 where each episode has a look of its own; 0: each environment."""
    spread: float
    """Radians: the largest angle between a start's heading and the direction of travel."""
    clearance: float
    """Metres."""
    step_s: float


def begins_of(config: EnvConfig, seed: np.ndarray, episode: np.ndarray, look: np.ndarray, looks: int) -> Begins:
    """The beginnings of a task; seed, episode, look [N] int64."""
    per_episode = config.randomisation is None or config.randomisation.per == "episode"
    spread, clearance = math.radians(config.start_heading_deg), float(config.start_clearance_m)
    return Begins(seed, episode, look, looks, int(per_episode), spread, clearance, float(config.step_s))


@kernel(fastmath=False)
def mixed(key):
    """A 64-bit hash of a 64-bit key. Source: splitmix64 (Steele, Lea, Flood, "Fast Splittable Pseudorandom Number
    Generators", 2014)."""
    key = u64(key + u64(0x9E3779B97F4A7C15))
    key = u64((key ^ (key >> u64(30))) * u64(0xBF58476D1CE4E5B9))
    key = u64((key ^ (key >> u64(27))) * u64(0x94D049BB133111EB))
    return u64(key ^ (key >> u64(31)))


@kernel(fastmath=False)
def uniform(seed, episode, number):
    """A number in 0..1, 1 excluded, of which each is used once."""
    key = mixed(u64(mixed(u64(mixed(u64(seed)) + u64(episode))) + u64(number)))
    return float(key >> u64(11)) * (1.0 / 9007199254740992.0)


@kernel(fastmath=False)
def begin_one(row, courses, limits, begins, state, draws):
    """Begin an episode in environment `row` at a random safe pose; draws [DRAWS] float64 is scratch.

    Should no try be safe, the camera stays where the last episode ended, and this one ends at its first step;
    `starts.random_start` says beforehand whether a world has a safe start at all.
    """
    world = state.world[row]
    seed = begins.seed[row]
    episode = begins.episode[row]
    for attempt in range(TRIES):
        for k in range(DRAWS):
            draws[k] = uniform(seed, episode, attempt * ROOM + k)
        if drawn_start(courses, world, limits, begins.spread, begins.clearance, draws, state.pose[row]):
            break
    state.time_s[row] = CLOCK_S * draws[5]
    segment, fraction, _ = located(courses, world, state.pose[row, 0], state.pose[row, 1])
    state.segment[row] = segment
    state.travel[row] = heading_way(courses, world, segment, fraction, state.pose[row, 3])
    for place in range(courses.segments[world]):
        state.visited[row, place] = 0
    state.visited_count[row] = 0
    state.steps[row] = 0
    state.idle[row] = 0
    if begins.per_episode != 0 or episode == 0:
        begins.look[row] = int(uniform(seed, episode, FREE) * begins.looks)
    begins.episode[row] = episode + 1


@kernel(fastmath=False)
def advance_one(row, units, courses, limits, begins, state, outcome, ended, draws):
    """One step of environment `row`, or the begin of an episode if its last one has ended; ended [N] uint8.

    units [N, 4] float64: up, turn left, forward, left in -1..1.
    """
    if ended[row] != 0:
        begin_one(row, courses, limits, begins, state, draws)
        outcome.reward[row] = 0.0
        outcome.costs[row, 0] = 0.0
        outcome.costs[row, 1] = 0.0
        outcome.reason[row] = RUNNING
        ended[row] = 0
        return
    step_one(row, units[row, 0], units[row, 1], units[row, 2], units[row, 3], courses, limits, state, outcome)
    state.time_s[row] += begins.step_s
    ended[row] = 1 if outcome.reason[row] >= 0 else 0


@kernel(fastmath=False)
def advance_rows(units, courses, limits, begins, state, outcome, ended):
    """`advance_one` for all environments, on the CPU."""
    draws = np.empty(DRAWS)
    for row in range(len(ended)):
        advance_one(row, units, courses, limits, begins, state, outcome, ended, draws)
