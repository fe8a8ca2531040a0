"""Views of flights and of starts on many rivers, with what the ideal eye sees there: poses and times, but no frames.

Flights are those of both pilots, with random moves among theirs, so that they lead where policies get that learn: off
the middle of the channel, and across the course. Letters: K views, R rivers, T quantities.
"""

from typing import NamedTuple

import numpy as np

from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.frame_renderer import Views
from thalweg.env.pilot.steady import MOVES
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import from_unit_actions
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.train.imitation.flights import drawn_looks

PILOTS = ("scripted", "steady")
"""Pilots that fly in turn."""
FLIGHT_STEPS, STRIDE = 32, 4
"""Steps of a flight, of which one in `STRIDE` is a view, the start included."""
MOST_NOISE = 0.5
"""Greatest share of random moves; that of each flight is drawn from 0 to this."""
RANDOM_MOVES = from_unit_actions("multidiscrete", MOVES)
"""[M, 4] options of the moves of which random ones are drawn."""
TARGETS = FEATURES
"""Names of the T quantities that are true of a view: those of the ideal eye."""


class KnownViews(NamedTuple):
    """K views of R rivers, in turn, and what is true of them."""

    river: np.ndarray
    """[K] int64, index of the river in the list of rivers."""
    pose: np.ndarray
    """[K, 4] float64."""
    time_s: np.ndarray
    """[K] float64, clock of the water."""
    segment: np.ndarray
    """[K] int64, of the course, and the direction of travel along it; see `thalweg.env.task.rules.State`."""
    travel: np.ndarray
    truths: np.ndarray
    """[K, T] float32, see `TARGETS`."""

    def rows(self, chosen: np.ndarray | slice) -> "KnownViews":
        """Return some of the views."""
        return KnownViews(*(array[chosen] for array in self))


def flight_views(rivers: RiverList, each: int, seed: int) -> KnownViews:
    """Return `each` views of every river, [R each] together, of disturbed flights from random starts."""
    env, generator = _grounds(rivers), np.random.default_rng([seed, 2])
    env.reset(seed=_seeds(seed, len(rivers)))
    notes: list[KnownViews] = []
    for flight in range(-(-each * STRIDE // FLIGHT_STEPS)):
        if flight:
            env.reset()
        noise = generator.uniform(0.0, MOST_NOISE, env.num_envs)
        for step in range(FLIGHT_STEPS):
            if step % STRIDE == 0:
                notes.append(_noted(env))
            actions = env.pilot_actions(PILOTS[flight % len(PILOTS)])
            other = generator.random(env.num_envs) < noise
            chosen = RANDOM_MOVES[generator.integers(len(RANDOM_MOVES), size=env.num_envs)]
            env.step(np.where(other[:, None], chosen, actions))
    env.close()
    return _joined(notes[:each])


def start_views(rivers: RiverList, each: int, seed: int) -> KnownViews:
    """Return `each` views of every river, [R each] together, at random starts."""
    env = _grounds(rivers)
    notes = []
    for number in range(each):
        env.reset(seed=None if number else _seeds(seed, len(rivers)))
        notes.append(_noted(env))
    env.close()
    return _joined(notes)


def draw_views(env: RiverVectorEnv, views: KnownViews, generator: np.random.Generator) -> np.ndarray:
    """Return frames [K, H, W, C] of views, each under a look of its own; `env` draws the rivers of the same list."""
    looks, suns = drawn_looks(env, len(views.river), generator)
    steps, station = np.zeros_like(views.river), np.zeros(len(views.river))  # the paper's task keeps nothing
    course = views.segment, views.travel, steps, steps, station
    drawn = Views(views.pose, views.river, views.time_s, looks, suns, *course)
    return env.draw(views.river, drawn)


def _grounds(rivers: RiverList) -> RiverVectorEnv:
    """Return an environment in each river, which draws nothing."""
    worlds = [rivers.course(index) for index in range(len(rivers))]
    return RiverVectorEnv(worlds, len(worlds), EnvConfig(observation="none"))


def _seeds(seed: int, count: int) -> list[int]:
    """Return a seed for each environment, apart from those of training and of evaluation."""
    return np.random.SeedSequence(seed, spawn_key=(3,)).generate_state(count).astype(np.int64).tolist()


def _noted(env: RiverVectorEnv) -> KnownViews:
    """Return the current state of R environments in R rivers."""
    state = env.state
    place, course = (state.pose.copy(), state.time_s.copy()), (state.segment.copy(), state.travel.copy())
    return KnownViews(np.arange(env.num_envs), *place, *course, env.ideal_eye())


def _joined(notes: list[KnownViews]) -> KnownViews:
    return KnownViews(*(np.concatenate(arrays) for arrays in zip(*notes, strict=True)))
