"""Tests of placing islands and bridges on a straight river along the x axis."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from thalweg.world.bridges import Bridge
from thalweg.world.generate.hydrology import make_river
from thalweg.world.real.course.solids import Crossing, bridge_at, crossings_of, ellipse_of, merged, place_solids

S = 101
RIVER = make_river(
    np.column_stack([np.linspace(0, 130, S), np.zeros(S)]), False, np.full(S, 12.0), np.ones(S), np.full(S, 2.0)
)


def test_an_ellipse_is_found_again():
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    u, v = 6 * np.cos(t), 2 * np.sin(t)
    turn = np.radians(30)
    ring = np.column_stack([40 + u * np.cos(turn) - v * np.sin(turn), 1 + u * np.sin(turn) + v * np.cos(turn)])
    assert ellipse_of(ring) == pytest.approx([40, 1, 6, 2, turn], abs=1e-3)
    assert ellipse_of(ring[::-1]) == pytest.approx([40, 1, 6, 2, turn], abs=1e-3)


def test_a_rectangle_becomes_an_ellipse_of_its_area_and_proportions():
    """10 x 4 m: variances 100 / 12 and 16 / 12 give semi-axes in the ratio 10 : 4, scaled to an area of 40 m²."""
    found = ellipse_of(np.array([(0, 0), (4, 0), (4, 10), (0, 10), (0, 0)], float))
    assert found is not None
    x, y, along, across, angle = found
    assert (x, y) == (pytest.approx(2), pytest.approx(5))
    assert along / across == pytest.approx(2.5)
    assert np.pi * along * across == pytest.approx(40)
    assert angle == pytest.approx(np.pi / 2)


def test_a_rock_of_half_a_metre_is_no_island():
    assert ellipse_of(np.array([(0, 0), (0.5, 0), (0.5, 0.5), (0, 0)])) is None


def test_a_bridge_square_to_the_river_reaches_from_bank_to_bank():
    (crossing,) = crossings_of(np.array([(50.0, -30.0), (50.0, 30.0)]), 3.0, RIVER)
    assert astuple(crossing) == pytest.approx((50.0, 3.0, np.pi / 2, 1.0))
    bridge = Bridge(*bridge_at(crossing, RIVER))
    assert (bridge.x, bridge.y, bridge.length, bridge.span) == pytest.approx((50, 0, 12 + 2 * 2.6, 11.6))
    assert (bridge.deck_z, bridge.spring_z) == pytest.approx((4.2, 2.1))


def test_an_oblique_bridge_is_longer():
    (crossing,) = crossings_of(np.array([(30.0, -20.0), (70.0, 20.0)]), 3.0, RIVER)
    bridge = Bridge(*bridge_at(crossing, RIVER))
    assert (bridge.x, bridge.angle) == pytest.approx((50, np.pi / 4))
    assert bridge.length == pytest.approx(12 * 2**0.5 + 5.2)


@pytest.mark.parametrize(
    "line",
    [[(50, 10), (50, 30)], [(1, -30), (1, 30)], [(40, -3), (80, 3)], [(50, 0), (60, 0)]],
    ids=["beside", "at the end", "along", "on the course"],
)
def test_a_way_that_does_not_cross_properly_is_no_bridge(line):
    assert crossings_of(np.array(line, float), 3.0, RIVER) == []


def test_a_road_and_its_pavements_become_one_bridge():
    """Decks from 48 to 55 m and from 55.5 to 58.5 m: one from 48 to 58.5 m."""
    road, path = Crossing(51.5, 7.0, 1.5, 1.0), Crossing(57.0, 3.0, 1.6, 1.0)
    (one,) = merged([path, road])
    assert astuple(one) == pytest.approx((53.25, 10.5, 1.5, 1.0))
    far = Crossing(70.0, 3.0, 1.6, 1.0)
    assert merged([far, road]) == [road, far]


def test_crossings_beside_the_seam_of_a_loop_become_one_bridge():
    """Decks from 98.5 to 101.5 and from -0.5 to 2.5 m of a loop of 100 m: one from 98.5 to 102.5 m."""
    first, last, far = (Crossing(arc, 3.0, 1.5, 1.0) for arc in (1.0, 100.0, 50.0))
    found = merged([first, far, replace(last, arc_m=99.9999)], 100.0)
    assert [each.arc_m for each in found] == pytest.approx([0.5, 50.0], abs=1e-3)
    assert [each.width_m for each in found] == pytest.approx([4.0, 3.0], abs=1e-3)
    assert merged([first, far], 100.0) == [first, far] and merged([far], 100.0) == [far]


def test_an_island_that_a_file_has_twice_is_one():
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.column_stack([60 + 6 * np.cos(t), 2 * np.sin(t)])
    bank = np.column_stack([60 + 6.3 * np.cos(t), 2.1 * np.sin(t)])
    rock = np.column_stack([60 + 1.0 * np.cos(t), 0.8 * np.sin(t)])
    per_degree = 111_195.0
    outlines = [each / per_degree for each in (ring, bank, rock)]
    found = place_solids(outlines, [], (0.0, 0.0), RIVER)
    assert found.islands[:, 2] == pytest.approx([6.0, 1.0], rel=0.01)


@pytest.mark.parametrize(("north_m", "left_out"), [(0.0, 0), (40.0, 1)], ids=["in the river", "on land"])
def test_an_island_that_a_file_has_twice_is_left_out_once_at_most(north_m: float, left_out: int):
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.column_stack([60 + 6 * np.cos(t), north_m + 2 * np.sin(t)]) / 111_195.0
    assert place_solids([ring, ring[::-1]], [], (0.0, 0.0), RIVER).outside == left_out
