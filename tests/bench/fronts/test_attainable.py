"""Cost limits below the oracle's safest point, on fronts of two points."""

import warnings
from dataclasses import dataclass, replace

import pytest

from thalweg.algos import LimitWarning
from thalweg.bench.fronts import fronts
from thalweg.bench.fronts.attainable import below_safest, warn_of_limits
from thalweg.bench.fronts.fronts import FrontPoint
from thalweg.bench.suite.priced import LIMITS
from thalweg.core import versions
from thalweg.env.tasks import TaskName

SAFE = FrontPoint("RacingLine", "Medium", "fixed", 10.0, 50, 1.5, 1.4, 1.6, 1.25, 1.2, 1.3, 1)
FAST = replace(SAFE, price=0.0, return_=9.0, cost=40.0)
POINTS = [SAFE, FAST, replace(SAFE, rivers="unseen", cost=2.0), replace(FAST, rivers="unseen")]


@dataclass(frozen=True)
class Limited:
    """Settings of an algorithm with a limit."""

    cost_limit: float


@pytest.fixture
def two_points(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fronts, "read_fronts", lambda: POINTS)


@pytest.mark.usefixtures("two_points")
def test_a_limit_below_the_cheaper_of_the_safest_points_is_told_with_that_point():
    assert below_safest("RacingLine", "Medium", 1.2) == (
        "cost_limit=1.2 is below the oracle's safest point in RacingLine on Medium, a cost of 1.25 at a return of 1.5:"
        " no pilot is known to hold it"
    )
    assert below_safest("RacingLine", "Medium", 1.25) == ""


@pytest.mark.usefixtures("two_points")
@pytest.mark.parametrize(("task", "level"), [("RacingLine", "Hard"), ("River", "Medium")])
def test_nothing_is_said_without_a_front(task: str, level: str):
    assert below_safest(task, level, 0.0) == ""


def test_a_front_of_other_tasks_warns_of_nothing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fronts, "read_fronts", lambda: [replace(SAFE, tasks=versions.TASKS - 1), FAST])
    assert below_safest("RacingLine", "Medium", 1.2) == ""  # else FAST, at 40, were the safest


@pytest.mark.usefixtures("two_points")
def test_all_that_are_trained_with_a_limit_are_named_in_one_warning():
    trained = [("PPO", "Medium", object()), *((name, "Medium", Limited(0.5)) for name in ("CPO", "CPO", "CUP"))]
    with pytest.warns(LimitWarning, match="^CPO, CUP: cost_limit=0.5 is below") as caught:
        warn_of_limits("RacingLine", trained)
    assert len(caught) == 1


@pytest.mark.parametrize("task", LIMITS)
def test_limits_of_the_suites_are_attained_by_the_oracle(task: TaskName):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_limits(task, [("CPO", "Medium", Limited(limit)) for limit in LIMITS[task]])
