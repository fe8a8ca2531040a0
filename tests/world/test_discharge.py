"""Tests of the speed of the current: its discharge is the same in every section, and it flows downhill."""

import numpy as np
import pytest

from tests.env.handmade import canal, ring
from thalweg.world import load_or_build
from thalweg.world.discharge import downstream, relative_speed
from thalweg.world.record import River

ACROSS = np.linspace(-1.0, 1.0, 4001)


def discharge(river: River, sample: int) -> float:
    """Volume that passes a section in a second at a mean speed of 1 m/s: the sum over it of speed times depth."""
    depth = river.depth_m[sample] * (1 - ACROSS**2) ** 1.4  # the shape of the bed, see `world.generate.terrain`
    speed = relative_speed(river)[sample] * (1 - ACROSS**2)
    return float(np.trapezoid(depth * speed, 0.5 * river.width_m[sample] * ACROSS))


def test_every_section_passes_the_same_volume():
    river = load_or_build("Medium").river
    passing = [discharge(river, sample) for sample in range(0, len(river.arc_m), 17)]
    assert river.width_m.max() > 2 * river.width_m.min()
    np.testing.assert_allclose(passing, passing[0], rtol=1e-9)


def test_the_mean_along_the_course_is_one():
    # A linear interpolation between samples 1 m apart, of which those in the middle are twice as wide.
    width = np.full(61, 4.0)
    width[20:41] = 8.0
    speed = relative_speed(canal(width_m=width).river)
    assert speed[0] == pytest.approx(2 * speed[30])
    assert np.trapezoid(speed, dx=1.0) / 60 == pytest.approx(1.0)
    assert relative_speed(ring().river) == pytest.approx(np.ones(96))


def test_water_flows_downhill():
    fall = np.linspace(1.0, 0.0, 61)
    assert downstream(canal(level_m=fall).river) == 1
    assert downstream(canal(level_m=fall[::-1]).river) == -1
    assert relative_speed(canal(level_m=fall[::-1]).river) == pytest.approx(-np.ones(61))
    assert downstream(canal().river) == 1


def test_a_loop_flows_along_its_longer_fall():
    level = np.concatenate([np.linspace(1.0, 0.0, 90), np.linspace(0.2, 0.8, 6)])
    assert downstream(ring(level_m=level).river) == 1
    assert downstream(ring(level_m=level[::-1]).river) == -1
    for name in ("Medium", "Hard"):
        assert downstream(load_or_build(name).river) == 1
