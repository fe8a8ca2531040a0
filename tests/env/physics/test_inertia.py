"""Tests of the limited lag against closed forms and a slow integration, and of the way that it takes."""

import math

import numpy as np
import pytest

from thalweg.env.physics.inertia import UNLIMITED, Inertia, follow, follow_plane, limited_lag


def integrated(error: float, time_constant: float, acceleration: float, duration: float) -> tuple[float, float]:
    """The limited lag by 200,000 small steps: its slow twin."""
    dt, integral = duration / 200_000, 0.0
    for _ in range(200_000):
        change = min(error / time_constant, acceleration)
        middle = error - 0.5 * dt * change
        error -= dt * min(middle / time_constant, acceleration)
        integral += dt * middle
    return error, integral


@pytest.mark.parametrize(
    ("error", "acceleration"),
    [(1.0, 10.0), (4.0, 2.0), (4.0, 9.0), (0.0, 1.0)],
    ids=["lag alone", "limit alone", "first limit then lag", "none"],
)
def test_the_lag_equals_its_slow_integration(error: float, acceleration: float):
    given = error, 0.4, acceleration, 0.25
    np.testing.assert_allclose(limited_lag(*given), integrated(*given), atol=1e-8)


def test_a_velocity_approaches_its_target_exponentially():
    velocity, position = 0.0, 0.0
    for k in range(1, 11):
        velocity, way = follow(velocity, 3.0, 0.4, UNLIMITED, 0.25)
        position += way
        t = 0.25 * k
        assert velocity == pytest.approx(3.0 * (1 - math.exp(-t / 0.4)), rel=1e-12)
        assert position == pytest.approx(3.0 * t - 3.0 * 0.4 * (1 - math.exp(-t / 0.4)), rel=1e-12)


def test_acceleration_is_limited():
    velocity, position = 0.0, 0.0
    for k in range(1, 5):
        velocity, way = follow(velocity, -100.0, 0.4, 2.0, 0.25)
        position += way
        assert velocity == pytest.approx(-2.0 * 0.25 * k)
        assert position == pytest.approx(-0.5 * 2.0 * (0.25 * k) ** 2)


def test_steps_of_half_the_duration_lead_to_the_same_place():
    whole = follow_plane(1.0, -2.0, 3.0, 2.0, 0.4, 5.0, 0.5)
    vx, vy, x, y = follow_plane(1.0, -2.0, 3.0, 2.0, 0.4, 5.0, 0.25)
    vx, vy, more_x, more_y = follow_plane(vx, vy, 3.0, 2.0, 0.4, 5.0, 0.25)
    np.testing.assert_allclose((vx, vy, x + more_x, y + more_y), whole, rtol=1e-12)


def test_acceleration_in_a_plane_is_limited_whatever_its_direction():
    for angle in np.linspace(0.0, 2 * np.pi, 7):
        vx, vy, *_ = follow_plane(1.0, 1.0, 1.0 + 50 * math.cos(angle), 1.0 + 50 * math.sin(angle), 0.4, 5.0, 0.25)
        assert math.hypot(vx - 1.0, vy - 1.0) == pytest.approx(5.0 * 0.25)


def test_a_velocity_at_its_target_stays():
    assert follow_plane(1.0, 2.0, 1.0, 2.0, 0.4, 5.0, 0.25) == (1.0, 2.0, 0.25, 0.5)


def test_the_share_of_the_wind_is_its_drag_over_a_time_constant():
    assert Inertia(drag_per_s=0.5, time_constant_s=0.3).wind_share == pytest.approx(0.15)
