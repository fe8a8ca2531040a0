"""The footprint of the boat against circles and rectangles, beside slow polygons."""

import numpy as np
import pytest

from tests.env.vehicle.polygons import distance, gap, rectangle
from thalweg.env.vehicle.footprint import meets_circle, meets_rectangle

UNSURE = 1e-6
"""Metres within which rounding may decide."""


@pytest.mark.parametrize("seed", range(3))
def test_circles_meet_as_slow_polygons_do(seed: int):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(1000):
        x, y, yaw = *rng.uniform(-3, 3, 2), rng.uniform(-4, 4)
        half_length, half_beam, radius = rng.uniform(0.1, 2.0, 3)
        centre = rng.uniform(-3, 3, 2)
        apart = distance(rectangle(x, y, yaw, half_length, half_beam), centre) - radius
        if abs(apart) > UNSURE:
            met = meets_circle(x, y, yaw, half_length, half_beam, *centre, radius)
            assert met == (apart < 0)
            found.append(met)
    assert 0.2 < np.mean(found) < 0.9


@pytest.mark.parametrize("seed", range(3))
def test_rectangles_meet_as_slow_polygons_do(seed: int):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(1000):
        one = (*rng.uniform(-3, 3, 2), rng.uniform(-4, 4), *rng.uniform(0.1, 2.0, 2))
        x, y, angle, along, across = (*rng.uniform(-3, 3, 2), rng.uniform(-4, 4), *rng.uniform(0.1, 2.0, 2))
        apart = gap(rectangle(*one), rectangle(x, y, angle, along, across))
        met = meets_rectangle(*one, x, y, np.cos(angle), np.sin(angle), along, across)
        if apart > UNSURE or apart == 0.0:
            assert met == (apart == 0.0)
            found.append(met)
    assert 0.2 < np.mean(found) < 0.9


def test_touching_is_meeting():
    assert meets_circle(0.0, 0.0, 0.0, 1.0, 0.5, 1.75, 0.0, 0.75)
    assert not meets_circle(0.0, 0.0, 0.0, 1.0, 0.5, 1.76, 0.0, 0.75)
    # A corner at (1, 0.5) and a circle of radius 5/4 three quarters east and one north of it.
    assert meets_circle(0.0, 0.0, 0.0, 1.0, 0.5, 1.75, 1.5, 1.25)
    assert not meets_circle(0.0, 0.0, 0.0, 1.0, 0.5, 1.75, 1.5, 1.2499)
    assert meets_rectangle(0.0, 0.0, 0.0, 1.0, 0.5, 3.0, 0.0, 1.0, 0.0, 2.0, 1.0)
    assert not meets_rectangle(0.0, 0.0, 0.0, 1.0, 0.5, 3.01, 0.0, 1.0, 0.0, 2.0, 1.0)
