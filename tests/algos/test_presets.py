"""Presets of settings, and settings that scale with the number of environments."""

import dataclasses

import pytest

from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.algos.presets import INVERSELY_PROPORTIONAL, PAPER, PER_ENV, PROPORTIONAL, settings_of
from thalweg.core.config import to_plain


@pytest.mark.parametrize("algorithm", PAPER)
def test_the_preset_of_the_study_sets_what_it_says_and_differs_nowhere_else(algorithm: str):
    entry = ALGORITHMS[algorithm]
    default, paper = (to_plain(entry.configure(None, preset)) for preset in ("default", "paper"))
    differing = {key for key in default if default[key] != paper[key]}
    assert default == to_plain(entry.config())
    assert {key: paper[key] for key in PAPER[algorithm]} == dict(PAPER[algorithm])
    assert differing and differing <= set(PAPER[algorithm])


@pytest.mark.parametrize("algorithm", PAPER)
def test_settings_are_set_on_top_of_a_preset(algorithm: str):
    entry = ALGORITHMS[algorithm]
    config, paper = entry.configure({"hidden": [7]}, "paper"), entry.configure(None, "paper")
    assert config == dataclasses.replace(paper, hidden=(7,)) and config != paper


def test_a_complete_config_is_used_unchanged():
    entry = ALGORITHMS["FOCOPS"]
    assert entry.configure(entry.config(passes=3)) == entry.config(passes=3)
    with pytest.raises(AlgorithmError, match="a whole FOCOPSConfig leaves nothing to the preset 'paper'"):
        entry.configure(entry.config(passes=3), "paper")
    with pytest.raises(AlgorithmError, match="a PPOConfig or a mapping is needed, got a FOCOPSConfig"):
        ALGORITHMS["PPO"].configure(entry.config())


def test_the_study_limits_to_25_by_the_mean_of_the_last_fifty_episodes():
    config = ALGORITHMS["FOCOPS"].configure(None, "paper")
    assert (config.cost_limit, config.cost_window, config.multiplier_rule) == (25.0, 50, "adam")
    assert (config.adapter, config.reset_each_update, config.mask) == ("box_literal", True, "batch")


def test_an_unknown_preset_lists_the_known():
    with pytest.raises(AlgorithmError, match="no preset 'study'; there are default, paper"):
        settings_of("PPO", "study")
    with pytest.raises(AlgorithmError, match="no preset 'study'"):
        ALGORITHMS["PPO"].configure({"passes": 3}, "study")


def test_an_algorithm_outside_the_study_has_no_preset_of_it():
    with pytest.raises(AlgorithmError, match=r"DQN is not among the algorithms of the study.*: PPO, PPOLag, FOCOPS"):
        settings_of("DQN", "paper")
    assert settings_of("DQN", "default") == {}


def changes(algorithm: str, num_envs: int, **given: float) -> dict[str, tuple]:
    """Return the settings that differ from the defaults, as (default, scaled)."""
    entry = ALGORITHMS[algorithm]
    usual, wide = to_plain(entry.config()), to_plain(entry.configure(given, num_envs=num_envs))
    return {name: (usual[name], wide[name]) for name in usual if usual[name] != wide[name]}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_up_to_16_environments_nothing_changes(algorithm: str):
    assert changes(algorithm, 1) == changes(algorithm, 16) == {}


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_up_to_64_environments_only_what_counts_episodes_of_each_changes(algorithm: str):
    assert set(changes(algorithm, 64)) == set(PER_ENV) & set(to_plain(ALGORITHMS[algorithm].config()))


def test_a_mean_cost_is_of_two_episodes_of_each_of_many_environments():
    found = {count: ALGORITHMS["CPO"].configure(num_envs=count).cost_episodes for count in (1, 15, 16, 17, 64, 256)}
    assert found == {1: 30, 15: 30, 16: 30, 17: 34, 64: 128, 256: 512}


def test_of_4096_environments_each_takes_as_many_steps_and_a_rollout_has_as_many_gradient_steps():
    assert changes("FOCOPS", 4096) == {
        "steps_per_update": (2048, 131_072),
        "minibatch": (256, 16_384),
        "critic_warmup_steps": (10_000, 2_560_000),
        "cost_episodes": (30, 8192),
    }


def test_a_replay_learns_from_as_many_steps_for_each_that_was_taken():
    found = changes("SACLag", 96)  # half as many again as the defaults are for
    assert found == {
        "steps_per_collection": (64, 96),
        "steps_per_update": (2048, 3072),
        "random_steps": (1000, 1500),
        "critic_warmup_steps": (10_000, 60_000),
        "cost_episodes": (30, 192),
        "minibatch": (128, 192),
        "updates_per_step": (0.25, 0.25 / 1.5),
    }


def test_one_environment_more_changes_little():
    config = ALGORITHMS["FOCOPS"].configure(num_envs=65)
    assert (config.steps_per_update, config.minibatch) == (2080, 260)  # 32 steps of each, as of 64


def test_a_planner_fits_as_often_to_as_many_more_steps():
    found = changes("SafeLOOP", 256)
    assert {name: wide / usual for name, (usual, wide) in found.items()} == dict.fromkeys(PROPORTIONAL, 4.0)


@pytest.mark.parametrize("algorithm", ["PPO", "SACLag"])
def test_each_environment_can_fly_an_episode_of_500_steps_while_critics_warm_up(algorithm: str):
    for count in (1, 16, 17, 20, 64, 65, 256, 1024):
        warmup = ALGORITHMS[algorithm].configure(num_envs=count).critic_warmup_steps
        assert warmup == max(10_000, 625 * count)


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
    config = to_plain(ALGORITHMS[algorithm].config())
    following = (*PROPORTIONAL, *INVERSELY_PROPORTIONAL, *PER_ENV)
    assert set(changes(algorithm, 128)) == {name for name in following if name in config}
