"""Tests of how observations are named, and of the spaces of their parts."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from thalweg.env import ConfigError, EnvConfig
from thalweg.env.observation import PARTS, PRESETS, parts_of, read_observation
from thalweg.env.spaces import observation_space
from thalweg.env.task.course_arrays import config_fingerprint
from thalweg.render.records import classes


@pytest.mark.parametrize(
    ("given", "held"),
    [
        *((word, word) for word in ("rgb+mask", "rgb", "mask", "dict", "privileged", "none")),
        ("rgb,depth,proprioception", ("rgb", "depth", "proprioception")),
        ("depth", ("depth",)),
        (" class , mask ", ("mask", "class")),
        (["proprioception", "rgb"], ("rgb", "proprioception")),
        (("rgb",), ("rgb",)),
        (("privileged", "proprioception"), ("proprioception", "privileged")),
    ],
)
def test_an_observation_is_a_word_or_parts_in_a_fixed_order(given, held):
    assert EnvConfig(observation=given).observation == held


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("rgb,dept", r"must be one of 'rgb\+mask'.*such as 'rgb,depth', got 'dept' \(did you mean 'depth'\?\)"),
        ("rgb+depth", r"got 'rgb\+depth'"),
        ("rgb,none", "got 'none'"),
        ("rgb,,mask", "got ''"),
        (("rgb", "mask", "rgb"), "each part must be named once, got 'rgb' 2 times"),
        ((), r"got \(\)"),
        (("rgb", 3), r"got \('rgb', 3\)"),
        (None, "got None"),
    ],
)
def test_another_observation_is_refused_by_name(given, said: str):
    with pytest.raises(ConfigError, match="^observation: .*" + said):
        EnvConfig(observation=given)


def test_velocities_need_steps_that_take_time():
    with pytest.raises(ConfigError, match=r"step_s must be above 0 for proprioception.*got 0\.0"):
        EnvConfig(observation=("proprioception",), step_s=0.0)


@pytest.mark.parametrize(
    ("observation", "channels", "layers"),
    [
        ("rgb+mask", 4, False),
        ("rgb", 4, False),
        ("mask", 1, False),
        ("dict", 4, False),
        ("privileged", 0, False),
        ("none", 0, False),
        (("rgb", "privileged"), 4, False),
        (("mask",), 1, False),
        (("class",), 1, True),
        (("rgb", "depth"), 4, True),
        (("proprioception", "privileged"), 0, False),
    ],
)
def test_only_what_is_observed_must_be_drawn(observation, channels: int, layers: bool):
    config = EnvConfig(observation=observation)
    assert (config.channels, config.draws_layers) == (channels, layers)


def test_parts_of_words_are_named_like_all_others():
    assert [parts_of(word) for word in PRESETS] == [
        ("rgb", "mask"), ("rgb",), ("mask",), ("rgb", "mask"), ("privileged",), (),
    ]  # fmt: skip


def test_the_space_of_a_combination_has_the_space_of_each_part():
    space = observation_space(read_observation(PARTS), 3, 5)
    assert isinstance(space, gymnasium.spaces.Dict) and set(space.spaces) == set(PARTS)
    box = gymnasium.spaces.Box
    assert space["rgb"] == box(0, 255, (3, 5, 3), np.uint8)
    assert space["mask"] == box(0, 255, (3, 5, 1), np.uint8)
    assert space["depth"] == box(-1.0, np.inf, (3, 5, 1), np.float32)
    assert space["class"] == box(0, 8, (3, 5, 1), np.uint8)
    assert space["proprioception"] == box(-np.inf, np.inf, (9,), np.float32)
    assert space["privileged"] == box(-np.inf, np.inf, (37,), np.float32)
    assert observation_space(("rgb",), 3, 5) == gymnasium.spaces.Dict({"rgb": space["rgb"]})


def test_classes_have_names_in_the_order_of_their_ids():
    assert [getattr(classes, name.upper()) for name in classes.CLASSES] == list(range(len(classes.CLASSES)))


def test_a_combination_is_plain_data_from_which_the_same_config_follows():
    config = EnvConfig(observation=("rgb", "depth"))
    assert config.as_data()["observation"] == ["rgb", "depth"]
    assert EnvConfig(observation=config.as_data()["observation"]) == config
    different: list[Any] = ["rgb", "dict", ("rgb",), ("rgb", "mask")]
    fingerprints = {config_fingerprint(EnvConfig(observation=each)) for each in different}
    assert len(fingerprints) == 4
