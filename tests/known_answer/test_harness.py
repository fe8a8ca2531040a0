"""Tests that each algorithm gets the right limit and is compared with the right optimum."""

from dataclasses import replace

import numpy as np
import pytest

from tests.known_answer.harness import ACTION_SETUPS, REQUIREMENTS, Case, Result, cases, reference
from tests.known_answer.problems import PROBLEMS
from tests.known_answer.scores import Score
from tests.known_answer.solutions import best_deterministic, optimum, planned
from thalweg.algos import ALGORITHMS
from thalweg.algos.planning.ccepets import CCEPETSConfig

SINGLE = ("dense", "end", "mixture")


def test_every_algorithm_has_a_row():
    assert set(ALGORITHMS) == set(REQUIREMENTS)


def test_cells_are_every_algorithm_on_every_device_and_problem():
    assert len(set(cases())) == len(REQUIREMENTS) * len(ACTION_SETUPS) * len(PROBLEMS)
    assert {case.problem for case in cases(["PPO"], ["end"])} == {"end"}


def test_two_limits_are_reported_separately():
    assert Case("FOCOPS", "box", "dense").config == {"cost_limit": 0.355}
    assert Case("FOCOPS", "box_scaled", "two").config == {"cost_limits": (0.255, 0.955), "adapter": "box_scaled"}
    assert Case("PPO", "discrete", "two").config == {}


def test_a_planner_is_held_against_one_of_its_own_horizon(monkeypatch: pytest.MonkeyPatch):
    assert Case("CCEPETS", "box", "mixture").horizon == CCEPETSConfig().sizes.horizon
    monkeypatch.setitem(REQUIREMENTS, "CCEPETS", replace(REQUIREMENTS["CCEPETS"], config={"horizon": 1}))
    short = Case("CCEPETS", "box", "mixture")
    problem = PROBLEMS["mixture"]
    wanted = planned(problem, 0.35, 1, length=optimum(problem, 0.35).length)
    assert short.horizon == 1 and reference(short).reward == pytest.approx(wanted.reward)


def test_each_is_held_against_what_its_kind_can_do():
    problem = PROBLEMS["mixture"]
    assert reference(Case("PPO", "box", "mixture")).reward == pytest.approx(optimum(problem).reward)
    assert reference(Case("CPO", "box", "mixture")).reward == pytest.approx(optimum(problem, 0.35).reward)
    assert reference(Case("TD3Lag", "box", "mixture")).reward == pytest.approx(best_deterministic(problem, 0.35).reward)
    assert reference(Case("CCEPETS", "box", "mixture")).reward == pytest.approx(85 / 19)


@pytest.mark.parametrize("name", SINGLE)
@pytest.mark.parametrize("algorithm", ["CPO", "SafeLOOP", "TD3Lag"])
def test_the_required_return_is_feasible_and_the_unconstrained_optimum_is_not(name: str, algorithm: str):
    case = Case(algorithm, "discrete", name)
    best = reference(case)
    assert Result(case, Score.of(best), best).reached
    assert not Result(case, Score.of(optimum(PROBLEMS[name])), best).reached


def test_the_cost_may_exceed_its_limit_by_a_tenth_or_two_hundredths():
    best = optimum(PROBLEMS["two"], PROBLEMS["two"].limits)
    for costs, reached in [((0.28, 1.05), True), ((0.285, 0.9), False), ((0.2, 1.06), False)]:
        score = Score.of(replace(best, costs=np.array(costs)))
        assert Result(Case("CPO", "discrete", "two"), score, best).reached == reached
    best = optimum(PROBLEMS["end"], 0.1)
    for cost, reached in [(0.119, True), (0.121, False)]:
        score = Score.of(replace(best, costs=np.array([cost])))
        assert Result(Case("CPO", "discrete", "end"), score, best).reached == reached


def test_nine_tenths_of_the_return_are_required():
    best = optimum(PROBLEMS["end"], 0.1)
    for share, reached in [(0.91, True), (0.89, False)]:
        score = Score.of(replace(best, reward=share * best.reward))
        assert Result(Case("CPO", "discrete", "end"), score, best).reached == reached
