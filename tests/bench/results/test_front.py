"""Tests of fronts of cost and return, on points worked by hand and against a linear programme."""

import numpy as np
import pytest
from scipy.optimize import linprog

from thalweg.bench.results.front import Front

COSTS, RETURNS = np.array([0.0, 10.0, 4.0, 2.0, 6.0]), np.array([2.0, 10.0, 7.0, 3.0, 7.0])
"""Points of which (2, 3) lies below the line from (0, 2) to (4, 7), and (6, 7) is dominated."""


def test_a_front_keeps_the_corners_of_the_concave_hull():
    front = Front.of(COSTS, RETURNS)
    np.testing.assert_array_equal(front.cost, [0.0, 4.0, 10.0])
    np.testing.assert_array_equal(front.return_, [2.0, 7.0, 10.0])


def test_of_two_points_of_the_same_cost_the_better_counts():
    front = Front.of(np.array([1.0, 1.0]), np.array([3.0, 5.0]))
    np.testing.assert_array_equal(front.return_, [5.0])


def test_mixtures_of_two_corners_are_attainable():
    front = Front.of(COSTS, RETURNS)
    np.testing.assert_allclose(front.greatest_return(np.array([2.0, 7.0, 50.0])), [4.5, 8.5, 10.0])


def test_nothing_is_attainable_below_the_safest_point():
    assert np.isnan(Front.of(COSTS + 1.0, RETURNS).greatest_return(0.5))


def test_the_greatest_return_is_that_of_the_best_mixture():
    generator = np.random.default_rng(3)
    costs, returns = generator.uniform(0, 10, 20), generator.uniform(0, 10, 20)
    front = Front.of(costs, returns)
    for limit in (np.min(costs) + 0.3, 4.0, 9.0):
        best = linprog(-returns, A_ub=costs[None], b_ub=[limit], A_eq=np.ones((1, 20)), b_eq=[1.0])
        assert front.greatest_return(limit) == pytest.approx(-best.fun)


def test_the_least_cost_is_where_the_hull_has_the_return():
    front = Front.of(COSTS, RETURNS)
    np.testing.assert_allclose(front.least_cost(np.array([1.0, 4.5, 10.0, 10.1])), [0.0, 2.0, 10.0, np.nan])


def test_half_of_the_return_is_kept_at_the_cost_of_the_middle_return():
    # The middle of 2 and 10 is 6, four fifths of the way from (0, 2) to (4, 7).
    assert Front.of(COSTS, RETURNS).kept(0.5) == pytest.approx(3.2)


def test_regret_is_the_distance_to_what_is_attainable_at_the_same_cost():
    front = Front.of(COSTS, RETURNS)
    assert front.regret(2.0, 3.0) == pytest.approx(1.5)
    assert front.regret(20.0, 9.0) == pytest.approx(1.0)


def test_a_policy_safer_than_the_safest_point_is_compared_with_it():
    assert Front.of(COSTS + 1.0, RETURNS).regret(0.0, 0.5) == pytest.approx(1.5)


def test_the_hypervolume_is_the_area_under_the_hull():
    front = Front.of(COSTS, RETURNS)
    # Trapezia from cost 0 to 4, 4 to 10, and a rectangle to 12.
    assert front.hypervolume(12.0) == pytest.approx(4 * 4.5 + 6 * 8.5 + 2 * 10.0)
    assert front.hypervolume(2.0) == pytest.approx(2 * (2.0 + 4.5) / 2)


def test_a_front_beyond_the_reference_covers_nothing():
    assert Front.of(COSTS + 5.0, RETURNS).hypervolume(5.0) == 0.0


@pytest.mark.parametrize(
    ("cost", "return_", "message"),
    [([], [], "one length"), ([1.0], [1.0, 2.0], "one length"), ([np.nan], [1.0], "finite")],
)
def test_points_without_a_front_are_refused(cost, return_, message):
    with pytest.raises(ValueError, match=message):
        Front.of(np.array(cost), np.array(return_))
