"""Tests of the mean cost of the worst tenth, on numbers worked by hand."""

import numpy as np
import pytest

from thalweg.bench.results.risk import conditional_value_at_risk


def test_the_tail_of_ten_costs_is_the_largest():
    assert conditional_value_at_risk(np.arange(10.0)) == 9.0


def test_a_share_of_an_episode_counts_by_that_share():
    # A tenth of 15 costs is one and a half: the largest, and half of the next.
    assert conditional_value_at_risk(np.arange(15.0)) == pytest.approx((14.0 + 0.5 * 13.0) / 1.5)


def test_fewer_costs_than_the_tail_needs_give_the_largest():
    assert conditional_value_at_risk(np.array([1.0, 4.0])) == 4.0


def test_level_zero_is_the_mean():
    costs = np.array([3.0, 0.0, 6.0])
    assert conditional_value_at_risk(costs, 0.0) == pytest.approx(3.0)


def test_the_tail_is_the_least_of_rockafellars_auxiliary_function():
    # Rockafellar and Uryasev: the minimum over a of a + E[(cost - a)+] / (1 - level).
    costs = np.random.default_rng(1).exponential(size=237)
    values = [a + np.maximum(costs - a, 0).mean() / 0.1 for a in costs]
    assert conditional_value_at_risk(costs) == pytest.approx(min(values))


@pytest.mark.parametrize("level", [-0.1, 1.0, 2.0])
def test_a_level_out_of_range_is_refused(level):
    with pytest.raises(ValueError, match=f"not {level}"):
        conditional_value_at_risk(np.ones(3), level)


def test_no_costs_are_refused():
    with pytest.raises(ValueError, match="no costs"):
        conditional_value_at_risk(np.array([]))
