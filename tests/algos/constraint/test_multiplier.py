"""Multipliers over several updates, each number worked out by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.constraint.cost_limits import check_cost_episodes
from thalweg.algos.constraint.multiplier import Multiplier, MultiplierConfig, Multipliers


def multiplier(limit: float = 0.1, **settings: Any) -> Multiplier:
    """By its rule alone and J_c - d, unless it says otherwise."""
    plain: dict[str, Any] = {
        "multiplier_violation": "absolute",
        "multiplier_rate": 0.5,
        "multiplier_gain": 0.0,
        "multiplier_max": 2.0,
    }
    return Multiplier(MultiplierConfig(**(plain | settings)), limit)


def values(one: Multiplier, *costs: float) -> list[float]:
    """λ after each update."""
    found = []
    for cost in costs:
        one.update(cost, 0.25)
        found.append(one.value)
    return found


def test_by_gradient_it_follows_the_violation_within_its_bounds():
    # + 0.5 (c - 0.1) each time
    assert values(multiplier(), 0.5, 0.0, 0.0, 9.0) == pytest.approx([0.2, 0.15, 0.1, 2.0])
    assert values(multiplier(multiplier_initial=0.02), 0.0) == [0.0]


def test_by_the_relative_violation_it_falls_as_fast_as_it_rises():
    # δ of 0.2, 0.05, 0, 1 at a limit of 0.1: ½, -½, -1, 0.9; I + 0.5 δ, from 0.6
    one = multiplier(multiplier_violation="relative", multiplier_initial=0.6)
    assert values(one, 0.2, 0.05, 0.0, 1.0) == pytest.approx([0.85, 0.6, 0.1, 0.55])


def test_in_any_unit_of_cost_the_relative_violation_moves_it_alike():
    small, large = (
        multiplier(limit, multiplier_violation="relative", multiplier_gain=0.5, multiplier_derivative=0.5)
        for limit in (0.1, 25.0)
    )
    costs = (0.3, 0.2, 0.05, 0.15)
    found = values(small, *costs)
    assert found == pytest.approx(values(large, *(250.0 * cost for cost in costs))) and found[0] > 0.3


def test_while_it_is_at_its_bound_the_integral_does_not_wind_up():
    # Each cost of 0.9 adds 2 (0.9 - 0.1) = 1.6 at once, above the bound of 1. I grows to 0.4 only while that is
    # not at the bound: I + 1.6 > 1 from the first update, so I stays 0, and λ is 0 as soon as the cost is at its limit.
    bounded = {"multiplier_gain": 2.0, "multiplier_max": 1.0}
    assert values(multiplier(**bounded), 0.9, 0.9, 0.9, 0.1) == pytest.approx([1.0, 1.0, 1.0, 0.0])
    # Without, I is 0.4, 0.8, 1.0, and takes as many updates to fall.
    wound = multiplier(multiplier_antiwindup=False, **bounded)
    assert values(wound, 0.9, 0.9, 0.9, 0.1) == pytest.approx([1.0, 1.0, 1.0, 1.0])


def test_at_its_bound_the_integral_still_falls():
    # I + 2·0.3 = 2.1 is above the bound of 2, but the last cost, which is not smoothed, is below its limit: I falls.
    one = multiplier(multiplier_gain=2.0, multiplier_initial=1.5, multiplier_smoothing=0.5)
    assert values(one, 0.8, 0.0) == [2.0, 2.0] and one.state()["moving"] == pytest.approx(1.45)


def test_by_adam_the_moments_do_not_wind_up_either():
    one = multiplier(multiplier_rule="adam", multiplier_gain=10.0, multiplier_rate=0.1)
    assert values(one, 0.9, 0.9, 0.9) == [2.0, 2.0, 2.0]
    assert one.state()["count"] == 0 and one.state()["moments"] == [0.0, 0.0]


def test_one_that_settles_falls_ever_less_towards_the_end():
    # Of what the cost stays below its limit, all counts until the last quarter, half of it less than at its end in its
    # middle: with a final share of ½, ¾ and ½; with 0, ½ and nothing. A violation counts in full.
    for final, expected in ((0.5, (0.45, 0.4125, 0.3875, 0.4875)), (0.0, (0.45, 0.425, 0.425, 0.525))):
        one = multiplier(multiplier_initial=0.5, multiplier_settles=True, multiplier_final_fall=final)
        found = []
        for cost, progress in ((0.0, 0.5), (0.0, 0.875), (0.0, 1.0), (0.3, 1.0)):
            one.update(cost, progress)
            found.append(one.value)
        assert found == pytest.approx(expected)


def test_it_answers_to_the_limit_of_the_moment():
    one = multiplier()
    for limit, expected in ((0.5, 0.0), (0.3, 0.05), (None, 0.2)):  # the cost is 0.4, the final limit 0.1
        one.update(0.4, 0.25, limit)
        assert one.value == pytest.approx(expected)


def test_by_adam_it_follows_torchs_steps():
    import torch

    parameter = torch.nn.Parameter(torch.tensor(0.5, dtype=torch.float64))
    optimiser, one = (
        torch.optim.Adam([parameter], lr=0.05),
        multiplier(multiplier_rule="adam", multiplier_rate=0.05, multiplier_initial=0.5),
    )
    for cost in (0.4, 0.0, 0.9, 0.05):
        optimiser.zero_grad()
        (-parameter * (cost - 0.1)).backward()
        optimiser.step()
        assert values(one, cost) == pytest.approx([parameter.item()], rel=1e-6)


def test_the_gain_answers_at_once_and_leaves_no_trace():
    # I: 0.2, 0.2, 0.15; + 2 (c - 0.1)
    assert values(multiplier(multiplier_gain=2.0), 0.5, 0.1, 0.0) == pytest.approx([1.0, 0.2, 0.0])


def test_smoothing_delays_the_gain_and_not_the_integral():
    # smooth: 0.5, then 0.75·0.5 + 0.25·0.1 = 0.4, then 0.3; I: 0.2, 0.2, 0.15
    one = multiplier(multiplier_gain=1.0, multiplier_smoothing=0.75)
    assert values(one, 0.5, 0.1, 0.0) == pytest.approx([0.2 + 0.4, 0.2 + 0.3, 0.15 + 0.2])


def test_the_derivative_answers_to_growth_over_its_delay_and_never_to_a_fall():
    # I: 0, 0.1, 0.25, 0.3, 0.25; growth over two updates: 0, 0.2, 0.3, -0.1 + 0.0, -0.4
    one = multiplier(multiplier_derivative=1.0, multiplier_delay=2)
    costs = (0.1, 0.3, 0.4, 0.2, 0.0)
    expected = [0.0, 0.1 + 0.2, 0.25 + 0.3, 0.3, 0.25]
    assert values(one, *costs) == pytest.approx(expected)


def test_the_derivative_is_that_of_the_smoothed_cost():
    # smooth: 0.1, 0.5·0.1 + 0.5·0.5 = 0.3, 0.3; growth: 0, 0.2, 0; I: 0, 0.2, 0.3
    one = multiplier(multiplier_derivative=1.0, multiplier_smoothing=0.5)
    assert values(one, 0.1, 0.5, 0.3) == pytest.approx([0.0, 0.4, 0.3])


def test_nothing_moves_before_the_warm_up_is_over_nor_is_anything_remembered_of_it():
    one = multiplier(multiplier_warmup=2, multiplier_initial=0.3, multiplier_derivative=5.0, multiplier_gain=1.0)
    # then I = 0.3 + 0.5·0.1, + 1·0.1, and no growth: the costs of the warm-up are not known
    assert values(one, 9.0, 0.0, 0.2) == pytest.approx([0.3, 0.3, 0.45])


@pytest.mark.parametrize("rule", ["gradient", "adam"])
def test_it_never_exceeds_its_bounds(rule: Any):
    one = multiplier(multiplier_rule=rule, multiplier_gain=100.0, multiplier_derivative=100.0)
    assert values(one, 1.0, 9.0, 0.0) == [2.0, 2.0, 0.0]


def test_without_an_episode_it_stays():
    one = multiplier(multiplier_initial=0.3, multiplier_gain=1.0)
    assert values(one, math.nan) == [0.3]


@pytest.mark.parametrize("rule", ["gradient", "adam"])
def test_it_resumes_from_its_state_bit_for_bit(rule: Any):
    settings = {
        "multiplier_rule": rule,
        "multiplier_gain": 1.0,
        "multiplier_derivative": 2.0,
        "multiplier_delay": 3,
        "multiplier_smoothing": 0.3,
        "multiplier_warmup": 2,
    }
    one, other = multiplier(**settings), multiplier(**settings)
    values(one, 0.3, 0.5, 0.2, 0.4, 0.1)
    other.load_state(one.state())
    assert values(one, 0.6, 0.2, 0.5) == values(other, 0.6, 0.2, 0.5)


def test_its_reach_is_what_it_gets_to_if_every_episode_is_the_worst():
    # ten steps of 0.1 (1 - 0.5)
    one = multiplier(0.5, multiplier_rate=0.1)
    assert one.reach(10, 1.0) == pytest.approx(0.5) == values(one, *[1.0] * 10)[-1]
    assert one.reach(1000, 1.0) == 2.0
    assert one.reach(10, 0.4) == one.value


def test_the_reach_counts_the_gain_and_waits_for_the_warm_up():
    one = multiplier(0.5, multiplier_rate=0.1, multiplier_gain=1.0, multiplier_warmup=4)
    assert one.reach(4, 1.0) == 0.0
    assert one.reach(10, 1.0) == pytest.approx(6 * 0.05 + 0.5) == values(one, *[1.0] * 10)[-1]


def test_by_adam_the_reach_is_never_exceeded():
    one = multiplier(multiplier_rule="adam", multiplier_rate=0.035, multiplier_max=50.0)
    assert one.reach(10, 5.0) == pytest.approx(0.35 * math.sqrt(10))
    values(one, *[0.1] * 100)  # its moments know of no violation: then it takes its longest steps
    reach = one.reach(20, 0.9)
    found = values(one, *[0.9] * 20)[-1]
    assert 20 * 0.035 < found <= reach


def test_settling_alone_is_no_growth_of_the_cost():
    one = multiplier(multiplier_derivative=10.0, multiplier_delay=10, multiplier_settles=True)
    for step in range(31):
        one.update(0.0, 0.4 + 0.02 * step)
        assert one.value == 0.0


def test_an_episode_counts_once():
    both, told = Multipliers(CONFIG, (0.1,)), feedback(0.5)
    both.update(told)
    both.update(replace(told, new_costs=told.new_costs[:0]))
    assert both.values == pytest.approx((0.2,))


CONFIG = MultiplierConfig(multiplier_violation="absolute", multiplier_rate=0.5, multiplier_gain=0.0)


def test_each_cost_moves_its_own():
    both = Multipliers(CONFIG, (0.1, 0.3))
    both.update(feedback(0.5, 0.2))
    assert both.values == pytest.approx((0.2, 0.0))
    both.update(feedback(0.0, 0.9))
    assert both.values == pytest.approx((0.15, 0.3))


def test_each_cost_has_its_limit_of_the_moment():
    both = Multipliers(CONFIG, (0.1, 0.3))
    both.update(feedback(0.5, 0.9), (0.2, 0.9))
    assert both.values == pytest.approx((0.15, 0.0))


def test_two_costs_are_called_tight_and_loose():
    both, told = Multipliers(CONFIG, (0.1, 0.3)), feedback(0.5, 0.9)
    both.update(told)
    assert both.metrics(told, 2) == pytest.approx(
        {
            "multiplier_tight": 0.2,
            "multiplier_loose": 0.3,
            "multiplier_reach_tight": 0.2 + 2 * 0.5 * 0.9,
            "multiplier_reach_loose": 0.3 + 2 * 0.5 * 0.7,
        }
    )


def test_a_window_takes_the_mean_of_the_last_episodes_whenever_they_ended():
    told = replace(feedback(0.9, count=1), recent_costs=feedback(0.1, count=60).recent_costs)
    for window, value in ((0, 0.5 * (0.9 - 0.05)), (50, 0.5 * (0.1 - 0.05))):
        one = Multipliers(replace(CONFIG, cost_window=window, cost_episodes=1), (0.05,))
        one.update(told)
        assert one.values == pytest.approx((value,))


def test_a_few_new_episodes_are_averaged_with_those_before():
    # three new episodes of 0.9 after 57 of 0.1: the mean of the last 30 is (27·0.1 + 3·0.9) / 30 = 0.18
    told = replace(feedback(0.9), recent_costs=np.array([[0.1]] * 57 + [[0.9]] * 3))
    one = Multipliers(CONFIG, (0.1,))
    one.update(told)
    assert one.values == pytest.approx((0.5 * 0.08,)) and CONFIG.cost_means(told) == pytest.approx((0.18,))


def test_each_of_several_resumes_from_its_state():
    both, other = Multipliers(CONFIG, (0.1, 0.3)), Multipliers(CONFIG, (0.1, 0.3))
    both.update(feedback(0.5, 0.9))
    other.load_state(both.state())
    for one in (both, other):
        one.update(feedback(0.2, 0.2))
    assert both.values == other.values


def test_a_multiplier_too_slow_to_matter_is_named_with_its_cost():
    slow = Multipliers(
        MultiplierConfig(multiplier_rate=1e-4, multiplier_gain=0.0, multiplier_violation="absolute"), (5.0, 0.5)
    )
    found = slow.warnings(feedback(0.5, 0.5), 10)
    assert list(found) == ["multiplier_too_slow_loose"]
    assert found["multiplier_too_slow_loose"].startswith(
        "the loose multiplier can't exceed 0.0005 in this run, 10 updates"
    )
    assert not slow.warnings(feedback(0.5, 0.5, episodes=5), 10)


def test_one_whose_bound_is_too_low_to_matter_is_named_with_it():
    found = Multipliers(MultiplierConfig(multiplier_max=0.05), (0.1,)).warnings(feedback(0.5), 1000)
    assert "multiplier_max (now 0.05)" in found["multiplier_too_slow"]


def test_one_that_had_time_enough_is_not_called_slow_at_the_end():
    one = Multipliers(MultiplierConfig(multiplier_rate=0.1, multiplier_gain=0.0), (0.1,))
    kept, broken = feedback(0.0), feedback(0.9)
    for _ in range(50):
        one.update(kept)
    assert one.values == (0.0,) and not one.warnings(broken, 1)


def test_more_episodes_than_a_run_remembers_are_refused():
    for num_envs, most in ((16, 100), (64, 192)):
        check_cost_episodes(MultiplierConfig(cost_episodes=most), num_envs)
        with pytest.raises(AlgorithmError, match=f"cost_episodes must be at most {most} with {num_envs} environments"):
            check_cost_episodes(MultiplierConfig(cost_episodes=most + 1), num_envs)


def test_new_episodes_count_else_the_last_fifty():
    told = feedback(0.5)
    assert told.cost_means() == (0.5,)
    older = replace(told, new_costs=told.new_costs[:0], recent_costs=feedback(*[1.0], count=100).recent_costs)
    older.recent_costs[:50] = 0.0
    assert older.cost_means() == (1.0,) and older.cost_means(window=80) == (50 / 80,)
    assert older.cost_means(least=80) == (1.0,), "of no new episode, the last fifty"
    few = replace(told, recent_costs=older.recent_costs)
    assert few.cost_means(least=3) == (0.5,) and few.cost_means(least=80) == (50 / 80,)
    assert replace(older, judged=60).cost_means() == (50 / 60,), "of many environments, as many as are judged"
    nothing = feedback(0.5, 0.5, count=0)
    assert all(math.isnan(mean) for mean in nothing.cost_means()) and len(nothing.cost_means(window=5)) == 2


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("multiplier_rate", -1.0),
        ("multiplier_gain", -1.0),
        ("multiplier_derivative", -1.0),
        ("multiplier_smoothing", 1.0),
        ("multiplier_delay", 0),
        ("multiplier_initial", 11.0),
        ("multiplier_max", -1.0),
        ("multiplier_warmup", -1),
        ("multiplier_violation", "squared"),
        ("multiplier_antiwindup", "often"),
        ("multiplier_final_fall", 1.5),
        ("cost_window", 101),
        ("cost_episodes", 0),
    ],
)
def test_a_setting_that_makes_no_sense_is_refused_by_name(key: str, value: Any):
    with pytest.raises(AlgorithmError, match=key):
        MultiplierConfig(**{key: value})


def test_the_reach_counts_the_steepest_growth_of_the_cost():
    one = multiplier(0.5, multiplier_rate=0.1, multiplier_derivative=0.5)
    # one step of 0.1 (1 - 0.5), and 0.5 times the growth from no cost to 1
    assert one.reach(1, 1.0) == pytest.approx(0.55) == values(one, 0.0, 1.0)[-1]
