"""Seeds of the environments of a run."""

import gymnasium as gym
import numpy as np
import pytest

from tests.train.toys import Walk
from thalweg.algos.common.state import CPU
from thalweg.train.rollouts.collector import HostCollector, env_seeds
from thalweg.train.rollouts.env_stepper import EnvStepper


def test_two_runs_share_no_environment():
    seeds = [seed for run in range(20) for seed in env_seeds(run, 0, 16)]
    assert len(set(seeds)) == 20 * 16


def test_episodes_after_an_interruption_are_not_those_of_the_beginning():
    assert not set(env_seeds(0, 0, 16)) & set(env_seeds(0, 1000, 16))


def test_an_environment_keeps_its_seed_whatever_their_number():
    assert env_seeds(3, 0, 16)[:4] == env_seeds(3, 0, 4)


def test_a_run_starts_with_a_list_of_seeds():
    asked = []

    class Asked(Walk):
        def reset(self, *, seed=None, options=None):
            asked.append(seed)
            return super().reset(seed=seed, options=options)

    env = Asked(4)
    HostCollector(env, EnvStepper(env), CPU, threads=1).reset(5)
    assert asked == [env_seeds(5, 0, 4)]
    assert all(type(seed) is int and 0 <= seed < 2**31 for seed in asked[0])
    assert np.unique(asked[0]).size == 4


def test_an_environment_that_takes_one_seed_gets_the_first():
    asked = []

    class One(Walk):
        def reset(self, *, seed=None, options=None):
            if not isinstance(seed, int):
                raise gym.error.Error("Seed must be a python integer")
            asked.append(seed)
            return super().reset(seed=seed, options=options)

    EnvStepper(One(4)).reset([7, 8, 9, 10])
    assert asked == [7]


def test_another_error_of_a_reset_is_not_taken_for_that():
    class Broken(Walk):
        def reset(self, *, seed=None, options=None):
            raise gym.error.Error("no licence")

    with pytest.raises(gym.error.Error, match="no licence"):
        EnvStepper(Broken(4)).reset([7, 8, 9, 10])
