"""Tests of the low-altitude formulas, of ranges, and of forces that are refused."""

from typing import Any

import numpy as np
import pytest

from tests.env.winds import wind_of
from thalweg.env import EnvConfig
from thalweg.env.config import ConfigError
from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.wind import FOOT_M, Wind, horizontal_length, horizontal_ratio, strongest_held, strongest_push


def test_gusts_at_a_thousand_feet_are_isotropic_and_as_long_as_the_height():
    assert horizontal_ratio(1000 * FOOT_M) == pytest.approx(1.0, abs=1e-9)
    assert horizontal_length(1000 * FOOT_M) == pytest.approx(1000 * FOOT_M, abs=1e-6)


def test_the_formulas_at_twenty_feet():
    # 0.177 + 0.000823 * 20 = 0.19346; to the power of -0.4 it is 1.929, to that of -1.2 it is 7.180.
    assert horizontal_ratio(20 * FOOT_M) == pytest.approx(1.929, abs=1e-3)
    assert horizontal_length(20 * FOOT_M) == pytest.approx(7.180 * 6.096, abs=0.02)


def test_a_number_is_a_range_of_nothing_else():
    assert wind_of(speed_m_per_s=2).speed_m_per_s == (2.0, 2.0)
    assert wind_of(speed_m_per_s=np.float32(2)).speed_m_per_s == (2.0, 2.0)
    assert EnvConfig().with_options(current_m_per_s=[0.1, 0.3]).current_m_per_s == (0.1, 0.3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed_m_per_s": (3.0, 1.0)}, r"speed_m_per_s: a range must have its lower end first, got \(3.0, 1.0\)"),
        ({"speed_m_per_s": -1.0}, r"speed_m_per_s\[0\] must be a finite number of at least 0, got -1.0"),
        ({"gust_share": "strong"}, "gust_share must be a pair, each a finite number of at least 0, got 'strong'"),
        ({"height_m": 1.0}, "height_m must be a number from 3.048 to 304.8, got 1.0"),
        ({"drift_share": 1.5}, "drift_share must be a number from 0 to 1, got 1.5"),
    ],
)
def test_a_wrong_value_is_named(options: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        wind_of(**options)


def test_a_wind_beyond_what_the_vehicle_can_hold_is_refused_with_the_one_that_it_can():
    # A gust of three deviations is 1 + 3 * 0.1 * 1.929 = 1.579 times the mean; 0.15 of it must not exceed 2 m/s.
    with pytest.raises(
        ConfigError, match=r"wind.speed_m_per_s = 20 pushes .* 4.74 m/s .* sideways by 2 m/s .* 8.45 m/s"
    ):
        EnvConfig(wind=wind_of(speed_m_per_s=20.0))
    EnvConfig(wind=wind_of(speed_m_per_s=8.44))


def test_the_wind_that_is_held_pushes_as_fast_as_the_vehicle_flies():
    wind = wind_of(speed_m_per_s=(0.0, 5.0), gust_share=(0.0, 0.3))
    held = strongest_held(wind, 0.2, 2.0)
    assert strongest_push(wind_of(speed_m_per_s=held, gust_share=0.3), 0.2) == pytest.approx(2.0)


def test_what_inertia_holds_follows_from_its_drag():
    wind = wind_of(speed_m_per_s=10.0, gust_share=0.0)
    options: dict[str, Any] = {"action": "continuous", "dynamics": "inertial"}
    EnvConfig(wind=wind, inertia=Inertia(drag_per_s=0.49), **options)
    with pytest.raises(ConfigError, match=r"up to 2.04 m/s .* it holds against a wind of 9.8 m/s"):
        EnvConfig(wind=wind, inertia=Inertia(drag_per_s=0.51), **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dynamics": "inertial"}, "dynamics='inertial' needs action='continuous', not 'multidiscrete'"),
        ({"dynamics": "real"}, "dynamics must be one of 'kinematic', 'inertial', got 'real'"),
        ({"carried_by_current": True}, "carried_by_current needs a current: set current_m_per_s"),
        ({"wind": Wind(), "step_s": 0.0}, "step_s must be above 0 for wind, current and inertial dynamics"),
        ({"current_m_per_s": 5.0, "carried_by_current": True}, "current_m_per_s = 5 is faster .* its own speed, 4 m/s"),
        ({"current_m_per_s": 5.0, "vehicle": "asv"}, "current_m_per_s = 5 is faster .* its own speed, 4 m/s"),
        ({"current_m_per_s": 1.0, "vehicle": "asv", "step_s": 0.0}, "step_s must be above 0 for wind, current and"),
        ({"wind": 3.0}, "wind must be a Wind or None, got 3.0"),
    ],
)
def test_forces_that_contradict_a_config_are_refused(options: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        EnvConfig(**options)


def test_a_current_may_pass_below_a_vehicle_that_flies_faster_or_slower():
    assert EnvConfig().with_options(current_m_per_s=5).current_m_per_s == (5.0, 5.0)


def test_forces_at_their_defaults_leave_the_data_of_a_config_as_it_was():
    names = {"dynamics", "inertia", "wind", "current_m_per_s", "carried_by_current"}
    assert not names & EnvConfig().as_data().keys()
    assert names & EnvConfig(wind=Wind()).as_data().keys() == {"wind"}
