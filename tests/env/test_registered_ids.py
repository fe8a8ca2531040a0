"""Invariants of every registered id: Gymnasium's checker, seeds, states to the bit, and the three autoreset modes."""

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import registry
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from tests.env.handmade import BlankRenderer, ring
from tests.env.vehicle.basins import basin
from thalweg import BOAT_IDS, LEVEL_IDS, TASK_IDS
from thalweg.world import World

IDS = sorted(name for name in registry if name.startswith("thalweg/"))
STEPS = 60
EPISODE_STEPS = 12
MOVES = np.random.default_rng(7).choice([0, 1, 2], (8, STEPS, 4), p=[0.4, 0.4, 0.2])
"""[N, T, 4] the action of environment n in its t-th step of an episode, those of resets not counted."""


def river(name: str) -> World:
    """A small river by hand: with a bed for boats, a loop for others."""
    return basin(width_m=8.0) if "ASV" in name else ring()


def made(name: str, mode: AutoresetMode, count: int = 4, **options: Any) -> Any:
    """The native vector environment of an id, whose episodes are short."""
    given = {"worlds": river(name), "observation": "privileged", "max_steps": EPISODE_STEPS, **options}
    return gymnasium.make_vec(name, num_envs=count, autoreset_mode=mode, **given).unwrapped


def steps_of(env: Any, taken: np.ndarray, steps: int) -> list[list[tuple]]:
    """Take steps and return, for each environment, what each step of an episode told; steps that only reset are left
    out. Ended episodes are reset where the environment does not do it.

    taken [N]: the number of steps of episodes so far, brought up to now.
    """
    found: list[list[tuple]] = [[] for _ in range(env.num_envs)]
    for _ in range(steps):
        resets = env.episodes.ended.copy()
        rows = np.arange(env.num_envs)
        _, reward, terminated, truncated, info = env.step(MOVES[rows, taken])
        for row in rows[~resets]:
            told = info["pose"][row], info["costs"][row], info["cost"][row], info["done_reason"][row]
            found[row].append((reward[row], terminated[row], truncated[row], *(np.copy(each) for each in told)))
        taken += ~resets
        ended = terminated | truncated
        if env.autoreset_mode is AutoresetMode.DISABLED and ended.any():
            env.reset(options={"reset_mask": ended})
    return found


def same(one: list[tuple], other: list[tuple]) -> bool:
    """Whether two episodes tell the same to the bit."""
    return all(np.array_equal(a, b) for x, y in zip(one, other, strict=True) for a, b in zip(x, y, strict=True))


def test_the_ids_are_those_of_levels_tasks_and_boats():
    assert sorted([*LEVEL_IDS.values(), *TASK_IDS.values(), *BOAT_IDS.values()]) == IDS and len(IDS) == 18


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_checker_passes_without_a_warning(name: str):
    env = gymnasium.make(name, world=river(name), renderer=BlankRenderer(), render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize("name", IDS)
def test_episodes_follow_from_the_seed_whatever_the_number_of_environments(name: str):
    few, many, other = (made(name, AutoresetMode.SAME_STEP, count) for count in (2, 5, 2))
    begins = [env.reset(seed=seed)[0] for env, seed in ((few, 3), (many, 3), (other, 99))]
    assert np.array_equal(begins[0], begins[1][:2]) and not np.array_equal(begins[0], begins[2])
    one, all_five = (steps_of(env, np.zeros(env.num_envs, int), 30) for env in (few, many))
    assert all(same(a, b) for a, b in zip(one, all_five[:2], strict=True))


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
@pytest.mark.parametrize("name", IDS)
def test_a_state_continues_to_the_bit_in_every_mode(name: str, mode: AutoresetMode):
    env, restored = made(name, mode), made(name, mode)
    env.reset(seed=1)
    taken = np.zeros(4, int)
    steps_of(env, taken, 17)
    restored.set_state(env.get_state())
    assert np.array_equal(env.observe(), restored.observe())
    first, again = steps_of(env, taken.copy(), 25), steps_of(restored, taken.copy(), 25)
    assert all(same(a, b) for a, b in zip(first, again, strict=True))
    assert np.array_equal(env.observe(), restored.observe())
    assert sum(step[1] | step[2] for row in first for step in row) >= 4


@pytest.mark.parametrize("name", IDS)
def test_the_three_autoreset_modes_fly_the_same_episodes(name: str):
    flown = []
    for mode in AutoresetMode:
        env = made(name, mode)
        env.reset(seed=5)
        flown.append(steps_of(env, np.zeros(4, int), STEPS))
    for rows in zip(*flown, strict=True):
        shortest = min(len(row) for row in rows)
        assert shortest > STEPS * 3 // 4 and sum(step[1] | step[2] for step in rows[0]) >= 3
        assert same(rows[0][:shortest], rows[1][:shortest]) and same(rows[0][:shortest], rows[2][:shortest])
