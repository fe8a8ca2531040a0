"""Presets: they set what exists, and all that differs."""

import dataclasses

import pytest

from thalweg.algos import ALGORITHMS, AlgorithmError
from thalweg.algos.common.settings import as_data
from thalweg.algos.presets import PAPER, settings_of


@pytest.mark.parametrize("algorithm", PAPER)
def test_the_preset_of_the_study_sets_what_it_says_and_differs_nowhere_else(algorithm: str):
    entry = ALGORITHMS[algorithm]
    default, paper = (as_data(entry.configure(None, preset)) for preset in ("default", "paper"))
    differing = {key for key in default if default[key] != paper[key]}
    assert default == as_data(entry.config())
    assert {key: paper[key] for key in PAPER[algorithm]} == dict(PAPER[algorithm])
    assert differing and differing <= set(PAPER[algorithm])


@pytest.mark.parametrize("algorithm", PAPER)
def test_settings_are_set_on_top_of_a_preset(algorithm: str):
    entry = ALGORITHMS[algorithm]
    config, paper = entry.configure({"hidden": [7]}, "paper"), entry.configure(None, "paper")
    assert config == dataclasses.replace(paper, hidden=(7,)) and config != paper


def test_a_whole_config_stands_for_itself():
    entry = ALGORITHMS["FOCOPS"]
    assert entry.configure(entry.config(passes=3)) == entry.config(passes=3)
    with pytest.raises(AlgorithmError, match="a whole FOCOPSConfig leaves nothing to the preset 'paper'"):
        entry.configure(entry.config(passes=3), "paper")
    with pytest.raises(AlgorithmError, match="a config of PPOConfig or a mapping is needed, got FOCOPSConfig"):
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
