"""Tests of lengths, bends and crossings on circles, ellipses, stadiums, hairpins and figures of eight."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import ellipe

from tests.world.lines import circle, figure_eight, stadium
from tests.world.nearest import along, nearest
from thalweg.world import geometry


def test_arc_length_of_a_square():
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    arc, length = geometry.arc_length(square, closed=True)
    np.testing.assert_array_equal(arc, [0, 2, 4, 6])
    assert length == 8
    assert geometry.arc_length(square, closed=False)[1] == 6


def test_arc_length_of_an_ellipse_is_the_elliptic_integral():
    t = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    ellipse = np.stack([30 * np.cos(t), 20 * np.sin(t)], axis=1)
    assert geometry.arc_length(ellipse, True)[1] == pytest.approx(4 * 30 * ellipe(1 - (20 / 30) ** 2), rel=1e-5)


def test_curvature_of_a_circle_is_exact_and_has_the_sign_of_the_turn():
    line = circle(12.5, 40)
    np.testing.assert_allclose(geometry.curvature(line, True), 1 / 12.5, rtol=1e-12)
    np.testing.assert_allclose(geometry.curvature(line[::-1], True), -1 / 12.5, rtol=1e-12)


def test_curvature_of_an_ellipse_at_its_ends():
    t = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ellipse = np.stack([30 * np.cos(t), 20 * np.sin(t)], axis=1)
    kappa = geometry.curvature(ellipse, True)
    assert kappa[0] == pytest.approx(30 / 20**2, rel=1e-3)
    assert kappa[180] == pytest.approx(20 / 30**2, rel=1e-3)


def test_ends_of_an_open_line_have_no_curvature():
    arc = circle(10.0, 40)[:10]
    kappa = geometry.curvature(arc, closed=False)
    assert kappa[0] == kappa[-1] == 0
    np.testing.assert_allclose(kappa[1:-1], 0.1)


def test_tangents_and_normals_of_a_circle():
    line = circle(5.0, 60)
    tangent = geometry.tangents(line, True)
    np.testing.assert_allclose(geometry.normals(tangent), -line / 5.0, atol=1e-12)


def test_tangents_at_the_ends_of_an_open_line_are_one_sided():
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(geometry.tangents(line, False), [[1, 0], [np.sqrt(0.5), np.sqrt(0.5)], [0, 1]])


def test_turning_of_any_simple_loop_is_a_full_turn():
    assert geometry.turning(stadium(40.0, 12.0), True).sum() == pytest.approx(2 * np.pi)
    assert geometry.turning(figure_eight(30.0, 200), True).sum() == pytest.approx(0, abs=1e-9)


def test_a_stadium_has_two_bends_of_180_degrees():
    bends = np.degrees(geometry.bends(stadium(60.0, 15.0), True))
    assert len(bends) == 2
    np.testing.assert_allclose(bends, 180.0, atol=8.0)


def test_a_tight_circle_is_one_bend_and_a_wide_one_is_straight():
    np.testing.assert_allclose(geometry.bends(circle(20.0, 100), True), [2 * np.pi])
    assert geometry.bend_count(circle(60.0, 300), True) == 0


def test_a_figure_of_eight_bends_once_each_way():
    bends = geometry.bends(figure_eight(40.0, 200), True)
    assert len(bends) == 2
    assert bends[0] == pytest.approx(-bends[1], rel=0.05)


def test_small_wiggles_are_no_bends():
    x = np.arange(0, 100.0)
    wiggle = np.stack([x, 0.4 * np.sin(x)], axis=1)
    assert geometry.bend_count(wiggle, closed=False) == 0


def test_a_figure_of_eight_crosses_itself_once():
    crossings = geometry.self_crossings(figure_eight(30.0, 100), True)
    assert len(crossings) == 1
    np.testing.assert_array_equal(crossings[0], [49, 99])


@pytest.mark.parametrize("line", [circle(10.0, 12), stadium(50.0, 8.0)])
def test_simple_loops_do_not_cross(line):
    assert len(geometry.self_crossings(line, True)) == 0


def test_an_open_hairpin_crosses_only_where_it_is_closed_over_itself():
    hairpin = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 2.0], [5.0, -2.0]])
    np.testing.assert_array_equal(geometry.self_crossings(hairpin, False), [[0, 2]])
    hairpin[-1] = [5.0, 1.0]
    assert len(geometry.self_crossings(hairpin, False)) == 0


def test_nearest_point_left_and_right_of_a_segment_and_past_its_end():
    line = np.array([[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]])
    segment, share, lateral = nearest(line, False, np.array([[1.0, 2.0], [6.0, -3.0], [11.0, 4.0]]))
    np.testing.assert_array_equal(segment, [0, 1, 1])
    np.testing.assert_allclose(share, [0.25, 0.5, 1.0])
    np.testing.assert_allclose(lateral, [2.0, -3.0, 5.0])


def test_the_closing_segment_counts_on_a_closed_line():
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    segment, share, lateral = nearest(square, True, np.array([[0.25, 1.0]]))
    assert (segment[0], share[0], lateral[0]) == (3, 0.5, 0.25)
    np.testing.assert_allclose(along(np.array([0.0, 10.0, 20.0, 30.0]), np.array([3]), np.array([0.5])), 15.0)


def test_a_line_of_many_samples_is_compared_with_itself_in_blocks(monkeypatch):
    line = figure_eight(30.0, 100)
    arc, length = geometry.arc_length(line, True)
    whole = geometry.distances(line), geometry.arc_between(arc, length, True), geometry.self_crossings(line, True)
    assert len(whole[2]) == 1
    monkeypatch.setattr(geometry, "BLOCK_PAIRS", 700)
    blocks = list(geometry.blocks(100))
    assert [len(np.arange(100)[rows]) for rows in blocks] == [7] * 14 + [2]
    np.testing.assert_array_equal(np.concatenate([geometry.distances(line, rows) for rows in blocks]), whole[0])
    between = [geometry.arc_between(arc, length, True, rows) for rows in blocks]
    np.testing.assert_array_equal(np.concatenate(between), whole[1])
    np.testing.assert_array_equal(geometry.self_crossings(line, True), whole[2])


def crossings_of_all_pairs(line: np.ndarray, closed: bool) -> list[list[int]]:
    """The pairs of segments that cross, each compared with each."""
    ends = np.concatenate([line, line[:1]]) if closed else line
    segments = list(pairwise(ends))

    def left(a, b, p) -> bool:
        return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0

    found = []
    for i, (a, b) in enumerate(segments):
        for j, (c, d) in list(enumerate(segments))[i + 2 :]:
            if closed and (i, j) == (0, len(segments) - 1):
                continue
            boxes = np.all(np.minimum(a, b) <= np.maximum(c, d)) and np.all(np.minimum(c, d) <= np.maximum(a, b))
            if boxes and left(a, b, c) != left(a, b, d) and left(c, d, a) != left(c, d, b):
                found.append([i, j])
    return found


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("pairs", [7, 10**6])
def test_crossings_are_those_of_all_pairs_in_their_order(closed: bool, seed: int, pairs: int, monkeypatch):
    """A walk that crosses itself many times, with steps of very different lengths, on whole metres and elsewhere."""
    random = np.random.default_rng(seed)
    line = np.cumsum(random.normal(size=(60, 2)) * random.choice([0.3, 1.0, 20.0], (60, 1)), axis=0)
    line = np.round(line) if seed % 2 else line
    expected = crossings_of_all_pairs(line, closed)
    monkeypatch.setattr(geometry, "BLOCK_PAIRS", pairs)
    assert geometry.self_crossings(line, closed).tolist() == expected
    assert len(expected) >= 5


def test_boxes_that_overlap_or_touch_are_found_once():
    low = np.array([[0.0, 0.0], [5.0, 0.0], [1.0, 2.0], [1.0, -9.0]])
    high = np.array([[1.0, 2.0], [6.0, 1.0], [5.0, 3.0], [5.5, -1.0]])
    found = [(i, j) for one, other in geometry.overlapping(low, high) for i, j in zip(one, other, strict=True)]
    assert sorted(found) == [(0, 2)]
    high[2, 1] = high[3, 1] = 9.0
    found = [(i, j) for one, other in geometry.overlapping(low, high) for i, j in zip(one, other, strict=True)]
    assert sorted(found) == [(0, 2), (0, 3), (1, 3), (2, 3)]


def test_few_pairs_of_a_long_line_are_looked_at(monkeypatch):
    """8,000 boxes of a line that leads somewhere: all pairs are 32 million."""
    x = np.arange(8000.0)
    low = np.stack([x, 50 * np.sin(x / 100)], axis=1)
    monkeypatch.setattr(geometry, "BLOCK_PAIRS", 100_000)
    blocks = list(geometry.overlapping(low, low + 1.2))
    assert len(blocks) == 1 and len(blocks[0][0]) == 7999


def test_arc_between_takes_the_shorter_way_round():
    arc = np.array([0.0, 2.0, 4.0, 6.0])
    assert geometry.arc_between(arc, 8.0, True)[0, 3] == 2
    assert geometry.arc_between(arc, 6.0, False)[0, 3] == 6
    np.testing.assert_array_equal(geometry.arc_distance_from(arc, 8.0, True, 7.0), [1, 3, 3, 1])


def test_a_straight_line_with_rounding_noise_does_not_cross_itself():
    line = np.column_stack([np.linspace(-100, 100, 155), 1e-16 * np.random.default_rng(0).standard_normal(155)])
    assert len(geometry.self_crossings(line, closed=False)) == 0
    turned = line @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    assert len(geometry.self_crossings(turned, closed=False)) == 0
