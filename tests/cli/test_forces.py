"""Tests of the options for wind, current and dynamics."""

from pathlib import Path

import pytest

from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.cli.bench import Rules
from thalweg.cli.forces import ForceFlags
from thalweg.cli.main import _parse, main
from thalweg.cli.options import UsageError
from thalweg.env.forces.options import ForceOptions
from thalweg.env.physics.inertia import Inertia
from thalweg.env.physics.wind import Wind

USUAL = ForceOptions(wind=Wind(speed_m_per_s=(2.0, 2.0)), current_m_per_s=(0.5, 0.5), carried_by_current=True)


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (ForceFlags(), ForceOptions()),
        (ForceFlags(wind=("3",)), ForceOptions(wind=Wind(speed_m_per_s=(3.0, 3.0)))),
        (ForceFlags(wind=("1", "4", "towards_deg=90")), ForceOptions(wind=Wind((1.0, 4.0), (90.0, 90.0)))),
        (ForceFlags(wind=("gust_share=[0,0.2]",)), ForceOptions(wind=Wind(gust_share=(0.0, 0.2)))),
        (ForceFlags(current=("0.2", "0.8")), ForceOptions(current_m_per_s=(0.2, 0.8))),
        (
            ForceFlags(current=("0.5",), carried_by_current=True),
            ForceOptions(current_m_per_s=(0.5, 0.5), carried_by_current=True),
        ),
        (
            ForceFlags(dynamics="inertial", inertia=("time_constant_s=0.3",)),
            ForceOptions(dynamics="inertial", inertia=Inertia(time_constant_s=0.3)),
        ),
    ],
)
def test_options_are_understood(flags: ForceFlags, expected: ForceOptions):
    assert flags.options() == expected


def test_what_is_not_given_is_as_usual():
    assert ForceFlags().options(USUAL) == USUAL
    assert ForceFlags(wind=("none",)).options(USUAL).wind is None
    assert ForceFlags(current=("none",)).options(USUAL) == ForceOptions(wind=USUAL.wind)
    assert ForceFlags(dynamics="inertial").options(USUAL).wind == USUAL.wind


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (
            ForceFlags(wind=("strong",)),
            "--wind takes one number or two in m/s, such as 2 or 1 4, or none, not 'strong'",
        ),
        (ForceFlags(wind=("1", "2", "3")), "--wind takes one number or two"),
        (ForceFlags(wind=("2", "speed_m_per_s=3")), "the speed is given twice"),
        (ForceFlags(wind=("speed=3",)), "--wind: Wind has no 'speed'"),
        (ForceFlags(wind=("4", "1")), "--wind: speed_m_per_s: a range must have its lower end first"),
        (ForceFlags(current=("fast",)), "--current takes one number or two"),
        (ForceFlags(carried_by_current=True), "--carried-by-current goes with --current"),
        (ForceFlags(inertia=("time_constant_s=0.3",)), "--inertia goes with --dynamics inertial"),
        (ForceFlags(dynamics="inertial", inertia=("mass=3",)), "--inertia: Inertia has no 'mass'"),
    ],
)
def test_what_is_not_understood_is_named(flags: ForceFlags, message: str):
    with pytest.raises(ValueError, match=message):
        flags.options()


def test_commands_take_them():
    words = ["--wind", "1", "4", "--current", "0.5", "--carried-by-current", "--dynamics", "kinematic"]
    given = ForceFlags(("1", "4"), ("0.5",), True, "kinematic")
    for command in (["train", "--out", "a"], ["evaluate", "hover"], ["bench", "quick", "--out", "a"]):
        assert vars(_parse([*command, *words]))["forces"] == given


def test_a_bench_replaces_those_of_its_suite():
    suite = Suite("own", (Arm("PPO"),), task="Nests", forces=USUAL)
    assert Rules().of(suite) == suite
    changed = Rules("Swimmers", True, ForceFlags(wind=("1",))).of(suite)
    assert (changed.task, changed.hard, changed.forces.wind) == ("Swimmers", True, Wind(speed_m_per_s=(1.0, 1.0)))
    assert changed.forces.current_m_per_s == (0.5, 0.5)
    with pytest.raises(UsageError, match="unknown task"):
        Rules("Lake").of(suite)


def test_a_wind_that_is_too_strong_is_refused_before_anything_is_done(tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "run"
    assert main(["train", "--out", str(out), "--wind", "40"]) != 0
    told = capsys.readouterr().err
    assert "pushes the vehicle by up to" in told and "it holds against a wind of" in told and not out.exists()
    assert main(["evaluate", "hover", "--dynamics", "inertial", "--shield"]) != 0
    assert "the shield judges" in capsys.readouterr().err
