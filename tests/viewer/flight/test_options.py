"""Tests of the options of a flight."""

from types import SimpleNamespace
from typing import Any

import pytest

from thalweg.core.config import parse_config
from thalweg.env import ConfigError
from thalweg.render.records.appearance import Look
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.looks import LOOKS, USUAL
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.rivers import Rivers


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"look": "autum"}, r"look must be one of .*got 'autum' \(did you mean 'autumn'\?\)"),
        ({"size": 64}, r"has no 'size' \(did you mean 'size_px'\?\)"),
        ({"size_px": 5000}, "size_px must be .*768.*5000"),
        ({"seed": -1}, "seed must be .*-1"),
        ({"seed": "1"}, "seed must be .*'1'"),
        ({"task": "Racing"}, "task must be .*Racing"),
    ],
)
def test_a_wrong_option_is_named(given: dict, error: str):
    with pytest.raises(ViewerError, match=error):
        parse_config(FlightOptions, given)


def test_options_that_do_not_go_together_are_refused_in_the_environments_words():
    with pytest.raises(ConfigError, match="needs action='continuous'"):
        FlightOptions(dynamics="inertial").rules  # noqa: B018
    with pytest.raises(ConfigError, match="it holds against a wind of"):
        FlightOptions(wind_m_per_s=20.0).rules  # noqa: B018


def test_looks_change_what_they_name_and_nothing_else():
    ranges = LOOKS["mist"]
    assert ranges is not None
    assert (ranges.haze, ranges.season, ranges.suns) == ((12.0, 12.0), (Look().season,) * 2, 0)
    assert LOOKS[USUAL] is None


def test_an_unknown_river_is_named_with_those_that_there_are():
    with pytest.raises(
        ViewerError, match=r"unknown river 'Eazy' \(did you mean 'Easy'\?\); known: Easy, Medium, Hard, "
    ):
        Rivers().world("Eazy", None)


def test_a_level_may_have_other_banks():
    rivers = Rivers()
    rivers.check("Easy+meadow")
    rivers.check("Hard+reeds+quay_10-50_left")
    for name, message in (
        ("Easy+lawn", r"unknown kind 'lawn'.*; known: forest, meadow, reeds, quay"),
        ("Easy+", r"unknown river 'Easy\+'"),
        ("Eazy+meadow", r"unknown river 'Eazy\+meadow'"),
    ):
        with pytest.raises(ViewerError, match=message):
            rivers.check(name)


def test_a_river_is_built_once_and_the_fixed_one_is_that_of_its_level():
    rivers = Rivers()
    assert rivers.world("Easy", None) is rivers.world("Easy", None)
    assert (rivers.world("Easy", None).name, rivers.world("Easy", None).seed) == ("Easy", 1)
    assert rivers.world("Easy", 1) is rivers.world("Easy", None)


def test_the_rivers_that_were_flown_last_are_kept(monkeypatch: pytest.MonkeyPatch):
    rivers, built = Rivers(), []

    def build(name: str) -> Any:
        return lambda seed: built.append((name, seed)) or SimpleNamespace(seed=1 if seed is None else seed)

    monkeypatch.setattr(rivers, "_builder", build)
    for seed in (1, 2, 3, 4, 1, 5, 1, None, None, 2):
        assert rivers.world("Easy", seed).seed == (seed or 1)
    assert [seed for _, seed in built] == [1, 2, 3, 4, 5, None, 2]
