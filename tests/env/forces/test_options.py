"""Tests of wind, current and dynamics as data."""

import json

import pytest

from tests.env.winds import wind_of
from thalweg.core.config import parse_config
from thalweg.env import ConfigError, EnvConfig
from thalweg.env.forces.options import ForceOptions
from thalweg.env.physics.inertia import Inertia

WINDY = ForceOptions(wind=wind_of(speed_m_per_s=(1.0, 3.0)))
DRIVEN = ForceOptions(dynamics="inertial", inertia=Inertia(time_constant_s=0.3), current_m_per_s=(0.2, 0.4))


def test_without_options_nothing_changes():
    assert ForceOptions().applied(EnvConfig()) == EnvConfig()
    assert ForceOptions().as_data() == {} and not ForceOptions().push


def test_options_are_those_of_the_config():
    config = DRIVEN.applied(EnvConfig(observation="none"))
    assert (config.dynamics, config.action, config.observation) == ("inertial", "continuous", "none")
    assert config.inertia.time_constant_s == 0.3 and config.current_m_per_s == (0.2, 0.4)
    assert WINDY.applied(EnvConfig()).wind == WINDY.wind and WINDY.applied(EnvConfig()).action == "multidiscrete"


@pytest.mark.parametrize("options", [ForceOptions(), WINDY, DRIVEN, ForceOptions(current_m_per_s=(0.0, 0.0))])
def test_it_is_said_whether_anything_pushes(options: ForceOptions):
    assert options.push == options.applied(EnvConfig()).has_forces


@pytest.mark.parametrize("options", [ForceOptions(), WINDY, DRIVEN])
def test_files_keep_them(options: ForceOptions):
    assert parse_config(ForceOptions, json.loads(json.dumps(options.as_data()))) == options
    config = json.loads(json.dumps(options.applied(EnvConfig()).as_data()))
    assert ForceOptions.of_env_data(config) == options


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"wind": {"speed": 3}}, r"wind has no 'speed'.*; it has speed_m_per_s"),
        ({"wind": {"speed_m_per_s": [4, 1]}}, r"wind.speed_m_per_s: a range must have its lower end first"),
        ({"current_m_per_s": -1}, r"current_m_per_s"),
        ({"dynamics": "springy"}, r"dynamics must be one of 'kinematic', 'inertial', got 'springy'"),
    ],
)
def test_wrong_data_is_named(data, message: str):
    with pytest.raises(ConfigError, match=message):
        parse_config(ForceOptions, data)


def test_a_wind_that_nothing_holds_against_is_refused():
    with pytest.raises(ConfigError, match="it holds against a wind of"):
        ForceOptions(wind=wind_of(speed_m_per_s=50)).applied(EnvConfig())
