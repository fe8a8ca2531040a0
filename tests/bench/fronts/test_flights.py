"""Tests of the points of a front, from flights over a canal, and of the command that flies them."""

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from scipy import stats

from tests.env.handmade import canal
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.fronts import flights
from thalweg.bench.fronts.flights import fly, front_points
from thalweg.bench.fronts.fronts import read_fronts, write_fronts
from thalweg.cli.main import main
from thalweg.core import versions
from thalweg.env import EnvConfig
from thalweg.env.tasks import TaskName


def config(task: TaskName, episodes: int = 3) -> EvaluationConfig:
    return EvaluationConfig(episodes, env=EnvConfig(observation="none", task=task))


def test_a_point_is_the_mean_of_its_flights_with_an_interval(monkeypatch: pytest.MonkeyPatch):
    world, settings = canal(length_m=80.0, width_m=10.0), config("Nests")
    course = Course.on(world, settings)
    monkeypatch.setattr(Course, "of_level", lambda *_, **__: course)
    (point,) = front_points("Medium", settings, prices=(0.02,))
    flown = fly(course, settings, 0.02)
    half = stats.t.ppf(0.975, 2) * flown.cost.std(ddof=1) / np.sqrt(3)
    assert (point.task, point.level, point.rivers, point.price, point.episodes) == ("Nests", "Medium", "fixed", 0.02, 3)
    assert point.return_ == pytest.approx(flown.return_.mean()) and point.cost == pytest.approx(flown.cost.mean())
    assert point.cost_high - point.cost == pytest.approx(half) and point.tasks == versions.TASKS


def test_each_unseen_river_is_flown_from_one_start(monkeypatch: pytest.MonkeyPatch):
    settings = config("RacingLine", 2)
    courses = [Course.on(canal(length_m=length, width_m=10.0), settings).only(0) for length in (60.0, 70.0)]
    monkeypatch.setattr(Course, "unseen", lambda *_, **__: courses)
    (point,) = front_points("Hard", settings, unseen=True, prices=(0.0,))
    each = [fly(course, settings, 0.0).return_[0] for course in courses]
    assert (point.rivers, point.episodes) == ("unseen", 2) and point.return_ == pytest.approx(np.mean(each))


def test_the_command_adds_to_a_file_and_replaces_what_it_flies_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    world = canal(length_m=60.0, width_m=10.0)
    monkeypatch.setattr(Course, "of_level", lambda _, settings, **__: Course.on(world, settings))
    monkeypatch.setattr(flights, "PRICES", (0.0, 1.0))
    out = str(tmp_path / "fronts.csv")
    assert main(["oracle", "--tasks", "Nests", "RacingLine", "--episodes", "2", "--out", out]) == 0
    assert main(["oracle", "--tasks", "Nests", "--episodes", "3", "--prices", "0.5", "--out", out]) == 0
    found = {(point.task, point.price, point.episodes) for point in read_fronts(tmp_path / "fronts.csv")}
    assert found == {("RacingLine", 0.0, 2), ("RacingLine", 1.0, 2), ("Nests", 0.5, 3)}
    assert "Nests, Medium, fixed rivers" in capsys.readouterr().out


def test_an_interrupted_command_keeps_finished_fronts_and_flies_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    world, asked = canal(length_m=60.0, width_m=10.0), []
    monkeypatch.setattr(Course, "of_level", lambda _, settings, **__: Course.on(world, settings))
    fly_at = flights.fly

    def interrupted(course: Course, settings: EvaluationConfig, price: float) -> flights.Flights:
        if settings.env.task == stop_at:
            raise KeyboardInterrupt
        asked.append((settings.env.task, price))
        return fly_at(course, settings, price)

    monkeypatch.setattr(flights, "fly", interrupted)
    out = tmp_path / "fronts.csv"
    command = ["oracle", "--tasks", "Nests", "RacingLine", "--episodes", "2", "--prices", "0", "1", "--out", str(out)]
    stop_at = "Nests"
    assert main(command) == 130
    assert capsys.readouterr().err == "\nInterrupted. The same command starts from the beginning.\n"
    stop_at = "RacingLine"
    assert main(command) == 130
    told = capsys.readouterr().err
    assert told == f"\nInterrupted. {out} has 2 of 4 points. The same command flies the others.\n"
    first, stop_at = read_fronts(out), ""
    assert main(command) == 0
    assert asked == [("Nests", 0.0), ("Nests", 1.0), ("RacingLine", 0.0), ("RacingLine", 1.0)]
    assert f"Nests, Medium, fixed rivers, 2 of 2 points from {out}\n" in capsys.readouterr().out
    assert read_fronts(out)[:2] == first
    assert main([*command[:3], "--episodes", "2", "--prices", "0.5", "1", "--out", str(out)]) == 0
    assert asked[4:] == [("Nests", 0.5)]
    assert [point.price for point in read_fronts(out) if point.task == "Nests"] == [0.0, 0.5, 1.0]


def test_two_commands_at_once_keep_the_points_of_both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    world, fly_at, out = canal(length_m=60.0, width_m=10.0), flights.fly, str(tmp_path / "fronts.csv")
    monkeypatch.setattr(Course, "of_level", lambda _, settings, **__: Course.on(world, settings))
    command = ["oracle", "--tasks", "Nests", "--episodes", "2", "--out", out, "--prices"]

    def with_another(course: Course, settings: EvaluationConfig, price: float) -> flights.Flights:
        if price == 1.0:
            assert main([*command, "2"]) == 0
        return fly_at(course, settings, price)

    monkeypatch.setattr(flights, "fly", with_another)
    assert main([*command, "0", "1"]) == 0
    assert [point.price for point in read_fronts(tmp_path / "fronts.csv")] == [0.0, 1.0, 2.0]


def test_a_command_that_ends_within_a_front_keeps_its_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    world, fly_at, out = canal(length_m=60.0, width_m=10.0), flights.fly, tmp_path / "fronts.csv"
    monkeypatch.setattr(Course, "of_level", lambda _, settings, **__: Course.on(world, settings))

    def interrupted(course: Course, settings: EvaluationConfig, price: float) -> flights.Flights:
        if price == 1.0:
            raise KeyboardInterrupt
        return fly_at(course, settings, price)

    monkeypatch.setattr(flights, "fly", interrupted)
    assert main(["oracle", "--tasks", "Nests", "--episodes", "2", "--prices", "0", "1", "--out", str(out)]) == 130
    told = capsys.readouterr().err
    assert told == f"\nInterrupted. {out} has 1 of 2 points. The same command flies the others.\n"
    assert [point.price for point in read_fronts(out)] == [0.0]


def test_points_of_an_older_version_are_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    world = canal(length_m=60.0, width_m=10.0)
    monkeypatch.setattr(Course, "of_level", lambda _, settings, **__: Course.on(world, settings))
    out = tmp_path / "fronts.csv"
    command = ["oracle", "--tasks", "Nests", "--episodes", "2", "--prices", "1", "--out", str(out)]
    assert main(command) == 0
    (new,) = read_fronts(out)
    write_fronts(out, [replace(new, tasks=versions.TASKS - 1, return_=0.0)])
    assert main(command) == 0
    assert read_fronts(out) == [new]


def test_a_file_of_another_kind_is_refused_before_anything_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "other.csv").write_text("step,return\n1,2.0\n")
    monkeypatch.setattr(flights, "fly", Mock(side_effect=AssertionError("flown")))
    assert main(["oracle", "--tasks", "Nests", "--out", str(tmp_path / "other.csv")]) == 2
    assert "other.csv lacks the columns" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--tasks", "River"], "--tasks River: its violations end the episode"),
        (["--prices", "-1"], "--prices -1 is negative"),
        (["--out", "fronts.txt"], "--out must end in .csv"),
    ],
)
def test_what_the_command_cannot_do_is_refused(given, message, capsys: pytest.CaptureFixture[str]):
    assert main(["oracle", *given]) == 2
    assert message in capsys.readouterr().err
