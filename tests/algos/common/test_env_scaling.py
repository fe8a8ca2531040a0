"""Settings follow the number of environments: as many steps of each between two updates, as many gradient steps."""

import pytest

from thalweg.algos import ALGORITHMS
from thalweg.algos.common.env_scaling import GROWING, SHRINKING
from thalweg.algos.common.settings import as_data


def changes(algorithm: str, num_envs: int, **given: float) -> dict[str, tuple]:
    """What differs from the defaults: before, after."""
    entry = ALGORITHMS[algorithm]
    usual, wide = as_data(entry.config()), as_data(entry.configure(given, num_envs=num_envs))
    return {name: (usual[name], wide[name]) for name in usual if usual[name] != wide[name]}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_up_to_64_environments_nothing_changes(algorithm: str):
    assert changes(algorithm, 1) == changes(algorithm, 64) == {}


def test_of_4096_environments_each_takes_as_many_steps_and_a_rollout_has_as_many_gradient_steps():
    assert changes("FOCOPS", 4096) == {"steps_per_update": (2048, 131_072), "minibatch": (256, 16_384)}


def test_a_replay_learns_from_as_many_steps_for_each_that_was_taken():
    found = changes("SACLag", 96)  # half as many again as the defaults are for
    assert found == {
        "steps_per_collection": (64, 96),
        "steps_per_update": (2048, 3072),
        "random_steps": (1000, 1500),
        "minibatch": (256, 384),
        "updates_per_step": (0.25, 0.25 / 1.5),
    }


def test_one_environment_more_changes_little():
    config = ALGORITHMS["FOCOPS"].configure(num_envs=65)
    assert (config.steps_per_update, config.minibatch) == (2080, 260)  # 32 steps of each, as of 64


def test_a_planner_fits_as_often_to_as_many_more_steps():
    found = changes("SafeLOOP", 256)
    assert {name: wide / usual for name, (usual, wide) in found.items()} == dict.fromkeys(GROWING, 4.0)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_what_is_given_stays_and_the_study_ran_what_it_ran(algorithm: str):
    entry = ALGORITHMS[algorithm]
    assert entry.configure({"minibatch": 17}, num_envs=4096).minibatch == 17
    whole = entry.config()
    assert entry.configure(whole, num_envs=4096) == whole
    if algorithm not in ("CPO", "CUP"):
        assert entry.configure(None, "paper", 4096) == entry.configure(None, "paper")


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_all_that_can_follow_does(algorithm: str):
    config = as_data(ALGORITHMS[algorithm].config())
    assert set(changes(algorithm, 128)) == {name for name in (*GROWING, *SHRINKING) if name in config}
