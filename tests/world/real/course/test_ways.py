"""Tests of joining ways, on ways along a parallel whose order and direction are seen at a glance."""

import numpy as np
import pytest

from tests.world.real.geojson_files import from_metres
from thalweg.world import WorldError
from thalweg.world.real.course.ways import Stem, Way, join_ways


def way(*metres, width: float = np.nan, name: str | None = None, label: str = "way") -> Way:
    degrees = np.array(from_metres(metres))
    return Way(np.column_stack([degrees, np.full(len(degrees), np.nan)]), np.full(len(degrees), width), name, label)


def xs(stem: Stem) -> list[int]:
    """Metres east of the reference place, of each position."""
    at = np.array(from_metres([(0, 0), (1000, 0)]))
    return [round(x) for x in (stem.places[:, 0] - at[0, 0]) / (at[1, 0] - at[0, 0]) * 1000]


A, B, C, D = (0, 0), (100, 0), (180, 0), (300, 0)


def test_ways_are_put_in_order():
    assert xs(join_ways([way(C, D), way(A, B), way(B, C)])) == [0, 100, 180, 300]


def test_a_way_that_runs_against_the_others_is_turned():
    stem = join_ways([way(A, B, label="a"), way(C, B, label="b"), way(C, D, label="c")])
    assert xs(stem) == [0, 100, 180, 300]
    assert (stem.joined, stem.turned, stem.left_out) == (3, 1, 0)


def test_ways_of_one_label_are_counted_one_by_one():
    stem = join_ways([way(A, B), way(C, B), way(C, D), way((60, 40), B)])
    assert (stem.joined, stem.turned, stem.left_out) == (3, 1, 1)


def test_the_line_runs_as_most_of_its_length_does():
    assert xs(join_ways([way(B, A), way(B, C), way(D, C)])) == [300, 180, 100, 0]
    assert xs(join_ways([way(B, A), way(B, D)])) == [0, 100, 300]


def test_widths_stay_with_their_ways():
    stem = join_ways([way(C, B, width=5.0), way(A, B, width=9.0)])
    assert xs(stem) == [0, 100, 180]
    assert stem.width_m.tolist() == [9.0, 9.0, 5.0]


def test_ends_within_a_metre_belong_together_and_beyond_it_the_gap_is_named():
    assert xs(join_ways([way(A, B), way((100.9, 0), C)])) == [0, 100, 180]
    with pytest.raises(
        WorldError, match=r"2 ways of water in 2 pieces .* \(way/2\), 35\.0 m from .* \(way/1\); limit 1 m: draw"
    ):
        join_ways([way(A, B, label="way/1"), way((135, 0), D, label="way/2")])


def test_of_several_rivers_the_names_are_offered():
    with pytest.raises(WorldError, match=r"or choose one of Brook, River by river_name"):
        join_ways([way(A, B, name="River"), way((0, 500), (100, 500), name="Brook")])


def test_ways_that_meet_in_a_ring_are_closed():
    corner = (100, 80)
    stem = join_ways([way(A, B), way(A, corner), way(B, corner)])
    assert len(stem.places) == 4
    np.testing.assert_array_equal(stem.places[0], stem.places[-1])
    assert xs(stem) == [0, 100, 100, 0]


def test_a_side_arm_that_ends_on_the_river_is_left_out():
    arm = way((60, 40), B, label="arm")
    stem = join_ways([way(A, B, C, D, label="river"), arm])
    assert xs(stem) == [0, 100, 180, 300]
    assert stem.left_out == 1


def test_of_two_arms_around_an_island_the_shorter_is_taken():
    north, south = way(B, (140, 30), C, label="north"), way(B, (140, -60), C, label="south")
    stem = join_ways([way(A, B), north, south, way(C, D)])
    assert xs(stem) == [0, 100, 140, 180, 300]
    assert stem.places[2, 1] > stem.places[0, 1]


def test_at_a_fork_the_river_that_most_is_named_after_goes_on_though_a_tributary_is_longer():
    main = [way(A, B, name="River"), way(B, C, name="River"), way(C, D, name="River")]
    tributary = way((100, 250), B, name="Brook")
    assert xs(join_ways([tributary, *main])) == [0, 100, 180, 300]


def test_one_way_is_taken_as_it_is():
    only = way(A, B, (0.5, 0.0))
    assert join_ways([only]).places is only.places


def test_loops_that_meet_in_one_place_have_no_main_stem():
    one = way(B, (150, 40), (150, -40), B)
    other = way(B, (50, 40), (50, -40), B)
    with pytest.raises(WorldError, match="its 2 ways of water are loops that meet in one place"):
        join_ways([one, other])


def test_of_two_ways_between_the_same_places_the_shorter_one_counts_for_the_main_stem():
    """From A to B it is 100 m by one way and 412 m by the other; a tributary of 250 m from B is shorter than A to C."""
    ways = [way(A, (50, 200), B), way(A, B), way(B, C), way((100, 90), B)]
    assert xs(join_ways(ways)) == [0, 100, 100]
