"""Tests of distances from ellipses and of random islands."""

import numpy as np
import pytest

from thalweg.world import islands

ROW = np.array([2.0, 1.0, 6.0, 2.0, np.pi / 2])


def test_the_outline_has_squared_radius_one_and_distance_zero():
    edge = islands.outline(ROW)
    np.testing.assert_allclose(islands.squared_radius(ROW, *edge.T), 1.0)
    np.testing.assert_allclose(islands.distance(ROW, *edge.T), 0.0, atol=1e-9)


def test_the_first_axis_has_the_rows_angle():
    assert islands.squared_radius(ROW, np.array(2.0), np.array(7.0)) == pytest.approx(1.0)
    assert islands.squared_radius(ROW, np.array(4.0), np.array(1.0)) == pytest.approx(1.0)


def test_distance_of_a_circle_is_exact():
    circle = np.array([0.0, 0.0, 3.0, 3.0, 0.4])
    np.testing.assert_allclose(
        islands.distance(circle, np.array([5.0, 0.0, 1.0]), np.array([0.0, 3.5, 0.0])), [2, 0.5, -2]
    )


def test_distance_is_close_near_the_edge_of_an_ellipse():
    assert islands.distance(ROW, np.array(4.5), np.array(1.0)) == pytest.approx(0.5, rel=1e-6)
    assert islands.distance(ROW, np.array(2.0), np.array(8.0)) == pytest.approx(1.0, rel=1e-6)


def test_no_island_fits_in_a_narrow_river():
    rng = np.random.default_rng(0)
    assert islands.random_island(np.zeros(2), np.array([1.0, 0.0]), 4.0, 0.0, rng) is None


def test_an_island_leaves_its_arm():
    for seed in range(20):
        row = islands.random_island(np.zeros(2), np.array([1.0, 0.0]), 12.0, 0.05, np.random.default_rng(seed))
        assert row is not None
        free = 6.0 + abs(row[1]) - row[3]
        assert free >= islands.MIN_ARM_M
