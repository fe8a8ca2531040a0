"""Tests of medial axes on shapes whose middle line is known."""

import numpy as np
import pytest

from thalweg.world.errors import WorldError
from thalweg.world.real.course.medial_axis import medial_axis

shapely = pytest.importorskip("shapely")


def test_the_middle_line_of_a_rectangle_runs_from_end_to_end():
    line, clearance = medial_axis(shapely.box(0, 0, 200, 12))
    np.testing.assert_allclose(line[:, 1], 6.0, atol=1e-9)
    assert sorted(line[[0, -1], 0]) == pytest.approx([0.0, 200.0], abs=1e-9)
    np.testing.assert_allclose(clearance, 6.0, atol=1e-6)


def test_a_bay_beside_the_river_neither_bends_the_line_far_nor_ends_it():
    river = shapely.box(0, 0, 200, 12).union(shapely.box(90, 12, 98, 40))
    line, clearance = medial_axis(river)
    assert sorted(line[[0, -1], 0]) == pytest.approx([0.0, 200.0], abs=1e-9)
    assert np.abs(line[:, 1] - 6).max() < 2.0
    assert clearance.max() < 8.0


def test_the_middle_of_a_ring_segment_is_an_arc():
    angle = np.linspace(0, np.pi / 2, 400)
    outer, inner = (radius * np.column_stack([np.cos(angle), np.sin(angle)]) for radius in (65.0, 55.0))
    line, clearance = medial_axis(shapely.Polygon(np.concatenate([outer, inner[::-1]])))
    middle = line[5:-5]
    np.testing.assert_allclose(np.hypot(*middle.T), 60.0, atol=0.05)
    np.testing.assert_allclose(clearance[5:-5], 5.0, atol=0.05)


def test_known_ends_choose_the_arm():
    star = shapely.box(0, 0, 200, 12).union(shapely.box(90, 0, 102, 150))
    line, _ = medial_axis(star, np.array([2.0, 6.0]), np.array([96.0, 148.0]))
    assert line[0, 0] < 1.0
    assert line[-1] == pytest.approx([96.0, 150.0], abs=0.2)


def test_a_bank_that_runs_straight_too_far_is_refused_before_it_takes_minutes():
    slip = shapely.Polygon([(0, 0), (150, 0), (39_000, 22), (0, 22)])
    with pytest.raises(WorldError, match=r"run straight for 39000 m between two positions; limit 6\d{3} m at"):
        medial_axis(slip)
