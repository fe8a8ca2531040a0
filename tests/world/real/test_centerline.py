"""Tests of worlds from custom lines, and of the errors for invalid lines."""

import tracemalloc
from typing import Any

import numpy as np
import pytest

from tests.world.lines import circle, course, figure_eight, stadium
from thalweg.world import World, WorldError


def world_of(line: np.ndarray, closed: bool = True, width_m: float = 6.0) -> World:
    return World.from_centerline(course(line, width_m), closed, plants=False)


def test_a_circle_is_resampled_evenly_by_about_1_3_m():
    river = world_of(circle(20.0, 30)).river
    assert river.closed
    assert river.length_m == pytest.approx(2 * np.pi * 20.0, rel=1e-3)
    assert river.length_m / river.segments == pytest.approx(1.3, abs=0.01)
    np.testing.assert_allclose(np.hypot(*river.position_m.T), 20.0, atol=0.01)
    np.testing.assert_allclose(np.diff(river.arc_m), river.length_m / river.segments, rtol=1e-3)


def test_a_repeated_first_point_is_dropped():
    line = circle(20.0, 30)
    np.testing.assert_array_equal(
        world_of(np.concatenate([line, line[:1]])).river.position_m, world_of(line).river.position_m
    )


def test_an_open_line_keeps_its_ends():
    line = np.stack([np.linspace(0, 50, 11), np.zeros(11)], axis=1)
    river = world_of(line, closed=False).river
    assert not river.closed
    assert river.segments == len(river.arc_m) - 1 == round(50 / 1.3)
    assert river.length_m == pytest.approx(50.0)
    np.testing.assert_allclose(river.position_m[[0, -1]], [[0, 0], [50, 0]], atol=1e-9)


def test_width_and_level_follow_the_points_without_overshoot():
    line = np.stack([np.linspace(0, 60, 13), np.zeros(13)], axis=1)
    points = course(line)
    points[:6, 3], points[6:, 3] = 4.0, 9.0
    points[:, 2] = np.linspace(5.0, 3.0, 13)
    river = World.from_centerline(points, closed=False, plants=False).river
    assert (river.width_m.min(), river.width_m.max()) == (pytest.approx(4.0), pytest.approx(9.0))
    np.testing.assert_allclose(river.level_m, 5.0 - 2.0 * river.arc_m / 60.0, atol=0.02)


def test_a_world_without_plants_is_evenly_lit_and_bare():
    world = world_of(circle(15.0, 24))
    assert len(world.plants.kind) == len(world.bridges) == len(world.islands) == 0
    assert world.sun.min() == world.sky.min() == 255
    np.testing.assert_array_equal(world.canopy_m, np.maximum(world.ground_m, world.water_m))


def test_the_same_line_and_seed_give_the_same_ground_and_another_seed_another():
    points = course(circle(15.0, 24))
    first, again, other = (World.from_centerline(points, seed=seed, plants=False).ground_m for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.3


def test_a_custom_line_has_no_default_seed_of_a_level():
    seed: Any = None
    with pytest.raises(WorldError, match="a seed is a whole number, not None"):
        World.from_centerline(course(circle(15.0, 24)), seed=seed, plants=False)


def hairpin(gap_m: float) -> np.ndarray:
    """Two arms with that much land between them where they come together behind a wide loop."""
    t = np.linspace(-0.5 * np.pi, 1.5 * np.pi, 60)
    loop = 25.0 * np.stack([np.sin(t), np.cos(t)], axis=1)
    keep = np.abs((t - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi) < np.pi - np.arcsin(gap_m / 50.0)
    return loop[keep]


BAD = {
    "crosses": (course(figure_eight(40.0, 60)), True, r"crosses itself near \(-?\d+\.\d, -?\d+\.\d\) m: arc \d+"),
    "open": (course(circle(20.0, 40)[:25]), True, r"is open: its ends lie 3\d\.\d m apart.*closed=False"),
    "short": (course(circle(7.0, 24), 2.5), True, r"closed course of 43\.\d m.* too short; at least 45\.0 m"),
    "short open": (course(np.stack([np.linspace(0, 9, 5), np.zeros(5)], 1)), False, r"9\.0 m .* too short"),
    "tight": (course(stadium(40.0, 5.0), 3.0), True, r"bend at arc \d+\.\d m has a radius of \d\.\d+ m.*needs 6\.50 m"),
    "fold": (course(stadium(60.0, 9.0), 18.5), True, r"bank folds at arc \d+\.\d m: 18\.50 m is too wide.*limit"),
    "overlap": (course(hairpin(5.0), 8.0), False, r"banks of two arms overlap: arc \d+\.\d m and \d+\.\d m"),
    "few": (course(circle(20.0, 3)), True, "3 points are too few"),
    "shape": (circle(20.0, 30), True, r"shape \(30, 2\); expected \[K, 4\]"),
    "words": ([["a", "b", "c", "d"]] * 5, True, "not numbers"),
}


@pytest.mark.parametrize(("points", "closed", "message"), BAD.values(), ids=BAD)
def test_an_invalid_line_is_refused_with_position_and_limit(points, closed, message):
    with pytest.raises(WorldError, match=message):
        World.from_centerline(points, closed, plants=False)


def test_a_boolean_of_numpy_closes_a_line():
    closed: Any = np.bool_(True)
    assert world_of(circle(15.0, 24), closed).river.closed is True


@pytest.mark.parametrize("closed", [0, 1, "yes", None])
def test_anything_but_a_boolean_does_not_say_whether_a_line_is_closed(closed: Any):
    with pytest.raises(WorldError, match=f"closed is {closed!r}; expected True or False"):
        world_of(circle(15.0, 24), closed)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        (3, 0.0, r"width is 0\.00 m at arc 62\.\d m \(point 15\)"),
        (3, -2.0, r"width is -2\.00 m at arc"),
        (3, np.nan, "point 15 is not finite"),
        (2, np.inf, "point 15 is not finite"),
        (3, 1.5, r"1\.\d\d m wide at arc \d+\.\d m; at least 2\.00 m"),
        (2, 9.0, r"water level changes by \d\.\d+ m per metre at arc \d+\.\d m; limit 0\.50"),
    ],
)
def test_an_invalid_value_is_refused_with_its_position(column, value, message):
    points = course(circle(20.0, 30))
    points[15, column] = value
    with pytest.raises(WorldError, match=message):
        World.from_centerline(points, plants=False)


def test_two_equal_points_are_refused_by_index():
    points = course(circle(20.0, 30))
    points[7, :2] = points[6, :2] = (12.5, -7.25)
    with pytest.raises(
        WorldError, match=r"points 6 and 7 are the same place, \(12.5, -7.25\) m: leave out one of the two$"
    ):
        World.from_centerline(points, plants=False)


def test_of_many_equal_points_the_first_pair_is_named_and_the_others_are_counted():
    points = course(circle(20.0, 30)).repeat(2, axis=0)
    with pytest.raises(WorldError, match=r"points 0 and 1 are the same place, .*; 30 such pairs in all$"):
        World.from_centerline(points, plants=False)


SIZES = {
    "map": (course(circle(1500.0, 800)), True, r"covers 3110 x 3110 m, 9\.7 km²; limit 6\.0 km²"),
    "diagonal": (
        course(np.stack([np.linspace(0, 9e3, 50), np.linspace(0, 9e3, 50)], axis=1)),
        False,
        r"covers 9110 x 9110 m, 83\.0 km²; limit 6\.0 km²",
    ),
    "length": (
        course(np.stack([np.linspace(0, 9e3, 50), np.zeros(50)], axis=1) * [2, 1]),
        False,
        r"18000 m long, 13846 samples; limit 8000 samples",
    ),
    "points": (course(circle(100.0, 9000)), True, r"9000 points are too many; limit 8000"),
}


@pytest.mark.parametrize(("points", "closed", "message"), SIZES.values(), ids=SIZES)
def test_a_line_that_is_too_large_is_refused_before_memory_is_allocated(points, closed, message, monkeypatch):
    monkeypatch.setattr("thalweg.world.generate.memory.free_bytes", lambda: None)  # which would be told first
    tracemalloc.start()
    try:
        with pytest.raises(WorldError, match=message):
            World.from_centerline(points, closed, plants=False)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


def test_a_river_that_is_too_wide_is_refused():
    line = np.stack([np.linspace(0, 300, 31), np.zeros(31)], axis=1)
    with pytest.raises(WorldError, match=r"the width is 100\.50 m at arc 0\.0 m \(point 0\); limit 100 m"):
        world_of(line, closed=False, width_m=100.5)


@pytest.mark.parametrize(
    ("column", "offset", "named"),
    [(0, 5e5, r"x = 5\d\d\d\d\d\.0 m"), (1, -5.4e6, r"y = -5\d+\.\d m"), (2, 3e4, r"water level = 30000\.0 m")],
)
def test_a_line_far_from_the_origin_is_refused_with_the_value_and_a_remedy(column, offset, named):
    points = course(circle(20.0, 30))
    points[:, column] += offset
    with pytest.raises(WorldError, match=rf"point 0 lies at {named}; limit 20000 m.*subtract an offset"):
        World.from_centerline(points, plants=False)
