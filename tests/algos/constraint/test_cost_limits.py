"""Costs by name, and limits that bind nothing."""

import math
from dataclasses import replace

import pytest

from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.constraint.cost_limits import CostConfig, cost_metrics, cost_suffixes, limit_warnings
from thalweg.algos.onpolicy.focops import FOCOPSConfig


def test_one_cost_has_no_name_two_are_tight_and_loose_and_more_are_counted():
    assert [cost_suffixes(count) for count in (1, 2, 3)] == [("",), ("_tight", "_loose"), ("_0", "_1", "_2")]


def test_a_limit_that_nothing_breaks_is_named_with_its_cost():
    config = FOCOPSConfig(cost_limits=(25.0, 0.5))
    found = limit_warnings(config, feedback(0.5, 0.5))
    assert list(found) == ["limit_never_binds_tight"]
    said = "the tight cost limit 25 has not bound anything: none of 30 episodes cost more than 1"
    assert found["limit_never_binds_tight"].startswith(said)
    assert not limit_warnings(config, feedback(0.5, 0.5, episodes=5))


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ((0.1,), r"cost_limits must be two, tight and loose, got \[0\.1\]"),
        ((0.1, 0.2, 0.3), r"cost_limits must be two, tight and loose, got \[0\.1, 0\.2, 0\.3\]"),
        ((0.1, -0.2), r"cost_limits\[1\] must be a finite number of at least 0, got -0\.2"),
    ],
)
def test_limits_of_separate_costs_must_be_two(limits: tuple[float, ...], words: str):
    with pytest.raises(AlgorithmError, match=words):
        FOCOPSConfig(cost_limits=limits)


def test_limits_of_separate_costs_replace_the_common_one():
    together, apart = FOCOPSConfig(cost_limit=0.3), FOCOPSConfig(cost_limit=0.3, cost_limits=(0.1, 0.2))
    assert (together.limits, together.separate_costs) == ((0.3,), False)
    assert (apart.limits, apart.separate_costs) == ((0.1, 0.2), True)


def test_a_limit_tightens_linearly_over_its_share_of_the_run():
    # from 4·0.1 to 0.1 within half of the run
    config = CostConfig(cost_limit=0.1, cost_limit_schedule=(4.0,), cost_limit_share=0.5)
    found = [config.limits_at(progress)[0] for progress in (0.0, 0.25, 0.5, 1.0)]
    assert found == pytest.approx([0.4, 0.25, 0.1, 0.1])
    assert CostConfig(cost_limit=0.3).limits_at(0.0) == (0.3,)


@pytest.mark.parametrize(("lowest", "limit"), [(math.nan, 0.25), (0.11, 0.25), (0.1, 0.1), (0.0, 0.1)])
def test_a_limit_that_has_been_met_is_the_final_one(lowest: float, limit: float):
    config = CostConfig(cost_limit=0.1, cost_limit_schedule=(4.0,), cost_limit_share=0.5)
    assert config.limits_at(0.25, (lowest,)) == pytest.approx((limit,))


def test_each_limit_is_met_by_its_own_cost():
    config = CostConfig(cost_limits=(0.1, 0.2), cost_limit_schedule=(2.0,), cost_limit_share=1.0)
    assert config.limits_at(0.0, (0.15, 0.15)) == pytest.approx((0.2, 0.2))
    assert config.limits_at(0.0, (0.05, 0.3)) == pytest.approx((0.1, 0.4))


def test_each_limit_tightens_from_its_own_multiple_or_all_from_one():
    each = CostConfig(cost_limits=(0.1, 1.0), cost_limit_schedule=(3.0, 1.0), cost_limit_share=1.0)
    assert each.limits_at(0.5) == pytest.approx((0.2, 1.0))
    both = CostConfig(cost_limits=(0.1, 1.0), cost_limit_schedule=(3.0,), cost_limit_share=1.0)
    assert both.limits_at(0.5) == pytest.approx((0.2, 2.0)) and both.limits == (0.1, 1.0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"cost_limit_schedule": (0.5,)}, r"cost_limit_schedule\[0\] must be .*1.*, got 0\.5"),
        ({"cost_limit_schedule": (2.0, 2.0)}, r"cost_limit_schedule must have one number, or one for each of 1 limits"),
        ({"cost_limit_share": 0.0}, "cost_limit_share must be a number above 0 and at most 1, got 0.0"),
    ],
)
def test_a_schedule_that_makes_no_sense_is_refused(settings: dict, words: str):
    with pytest.raises(AlgorithmError, match=words):
        CostConfig(**settings)


def test_metrics_have_the_limit_of_the_moment_and_whether_it_can_bind():
    found = cost_metrics(feedback(0.5, 0.7, largest=0.8), (0.1, 0.9), (0.4, 0.6))
    assert found == {
        "cost_mean_tight": 0.4,
        "cost_mean_loose": 0.6,
        "cost_episodes": 3,
        "cost_limit_tight": 0.1,
        "limit_can_bind_tight": 1.0,
        "cost_limit_loose": 0.9,
        "limit_can_bind_loose": 0.0,
    }
    assert cost_metrics(feedback(0.5)) == {"cost_mean": 0.5, "cost_episodes": 3}


def test_a_limit_that_is_never_met_is_named_with_the_lowest_cost():
    config = CostConfig(cost_limit=0.1)
    found = limit_warnings(config, feedback(0.4, episodes=480, lowest=0.2, progress=0.5))
    assert list(found) == ["limit_never_met"]
    said = "the cost limit 0.1 has never been met: in 480 episodes, the mean cost of 50 in a row never fell below 0.2"
    assert found["limit_never_met"].startswith(said)
    assert not limit_warnings(config, feedback(0.4, episodes=480, lowest=0.1, progress=0.5))
    assert not limit_warnings(config, feedback(0.4, episodes=480, lowest=0.2, progress=0.49))
    assert not limit_warnings(config, feedback(0.4, episodes=40, lowest=math.nan, progress=0.5))
    many = replace(feedback(0.4, episodes=480, lowest=0.2, progress=0.5), judged=192)
    assert "the mean cost of 192 in a row never" in limit_warnings(config, many)["limit_never_met"]


def test_a_limit_that_tightens_is_named_only_after_half_of_the_time_with_its_final_value():
    config = CostConfig(cost_limit=0.1, cost_limit_schedule=(4.0,), cost_limit_share=0.6)
    for progress, named in ((0.79, False), (0.81, True)):
        assert bool(limit_warnings(config, feedback(0.4, lowest=0.2, progress=progress))) == named
