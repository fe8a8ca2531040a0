"""Tests of the points of a front, from flights over a canal, and of the command that flies them."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.env.handmade import canal
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.fronts import flights
from thalweg.bench.fronts.flights import fly, front_points
from thalweg.bench.fronts.fronts import read_fronts
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
