"""Tests of the environment's configuration: defaults, and the values it refuses."""

import dataclasses
import math

import numpy as np
import pytest

from thalweg.env import ConfigError, DoneReason, EnvConfig


def test_defaults_are_those_of_the_original_task():
    limits = EnvConfig().limits
    assert (limits.vertical_step, limits.forward_step, limits.lateral_step) == (1.0, 1.0, 0.5)
    assert limits.yaw_step == math.radians(10)
    assert (limits.min_height, limits.max_height, limits.max_idle_steps) == (0.5, 15.0, 50)
    assert limits.max_yaw_deviation == math.pi / 2
    assert not limits.allow_backward


@pytest.mark.parametrize(("scheme", "loose"), [("paper", 0.2), ("package", 0.5)])
def test_loose_cost_follows_the_scheme(scheme: str, loose: float):
    config = EnvConfig(reward_scheme=scheme)  # pyright: ignore[reportArgumentType]
    assert (config.limits.tight_cost, config.limits.loose_cost) == (1.0, loose)


@pytest.mark.parametrize(
    ("field", "known"),
    [
        ("observation", "'rgb+mask', 'rgb', 'mask', 'dict', 'privileged', 'none'"),
        ("action", "multidiscrete"),
        ("reward_scheme", "'paper', 'package'"),
    ],
)
def test_an_unknown_value_lists_the_known_ones(field: str, known: str):
    with pytest.raises(ConfigError, match="must be one of .*" + known.replace("+", r"\+") + ".*, got 'sonar'"):
        EnvConfig().with_options(**{field: "sonar"})


def test_an_unknown_option_lists_the_known_ones():
    with pytest.raises(ConfigError, match=r"'max_heigth_m'.*max_height_m"):
        EnvConfig().with_options(max_heigth_m=3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"forward_step_m": 0.0},
        {"yaw_step_deg": float("nan")},
        {"min_height_m": -1.0},
        {"min_height_m": 16.0},
        {"max_yaw_deviation_deg": 190.0},
        {"max_yaw_deviation_deg": 60.0},
        {"max_steps": 0},
        {"max_height_m": float("inf")},
        {"max_idle_steps": 0.5},
        {"max_steps": 2.5},
        {"max_steps": "500"},
        {"max_steps": True},
        {"allow_backward": "no"},
        {"allow_backward": 1},
        {"forward_step_m": "1"},
        {"forward_step_m": True},
        {"start_heading_deg": float("nan")},
        {"observation": 4},
        {"camera": None},
    ],
)
def test_numbers_out_of_range_are_refused_by_name(wrong: dict):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        EnvConfig(**wrong)


def test_numbers_of_numpy_are_numbers():
    config = EnvConfig().with_options(max_height_m=np.float32(9.0), max_steps=np.int64(7), allow_backward=np.True_)
    assert (config.limits.max_height, config.max_steps, config.limits.allow_backward) == (9.0, 7, 1)


def test_the_config_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        EnvConfig().max_height_m = 3.0  # pyright: ignore[reportAttributeAccessIssue]


def test_codes_and_names_are_those_of_the_paper():
    labels = {reason.value: reason.label for reason in DoneReason}
    assert labels.pop(7) == "CostIncurred"  # of tasks beside the paper's
    assert labels == {
        -1: "Running",
        0: "Collision",
        1: "OutOfVolumeHorizontal",
        2: "OutOfVolumeVertical",
        3: "YawOverDeviation",
        4: "Idle",
        5: "MaxStepReached",
        6: "Success",
    }
