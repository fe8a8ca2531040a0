"""Tests that every limit of a level holds for every seed; only plans are drawn, no terrain."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.world.nearest import along, nearest
from thalweg.world import LEVELS, WorldError, geometry, islands
from thalweg.world import validation as checks
from thalweg.world.generate.hydrology import RAPID_M
from thalweg.world.generate.plan import Plan, plan
from thalweg.world.generate.side_channels import bank_distance

SEEDS = range(20)
EVERY = pytest.mark.parametrize("name", LEVELS)


@cache
def drawn(name: str, seed: int) -> Plan:
    return plan(LEVELS[name], seed)


def plans(name: str) -> list[Plan]:
    return [drawn(name, seed) for seed in SEEDS]


@EVERY
@pytest.mark.slow
def test_samples_and_length(name):
    level = LEVELS[name]
    for river in (each.river for each in plans(name)):
        assert river.closed
        assert len(river.arc_m) == river.segments == level.samples
        assert river.length_m == pytest.approx(level.length_m, rel=0.011)
        steps = np.hypot(*geometry.edges(river.position_m, True).T)
        np.testing.assert_allclose(steps, 1.297, atol=0.03)


@EVERY
def test_number_of_bends(name):
    low, high = LEVELS[name].bends
    counts = [geometry.bend_count(each.river.position_m, True) for each in plans(name)]
    assert min(counts) >= low
    assert max(counts) <= high


@EVERY
def test_widths_keep_to_the_range_and_use_it(name):
    low, high = LEVELS[name].width_m
    for river in (each.river for each in plans(name)):
        assert low <= river.width_m.min() <= low + 0.06 * (high - low)
        assert high - 0.1 * (high - low) <= river.width_m.max() <= high


@EVERY
def test_number_of_bridges_islands_and_tributaries(name):
    level = LEVELS[name]
    for each in plans(name):
        assert each.bridges.shape == (level.bridges, 11)
        assert each.islands.shape == (level.islands, 5)
        assert level.tributaries <= len(each.branches) <= level.tributaries + level.ponds


def test_depth_varies_more_from_level_to_level():
    spread = {name: [np.ptp(each.river.depth_m) / each.river.depth_m.mean() for each in plans(name)] for name in LEVELS}
    assert max(spread["Easy"]) < 0.2
    assert max(spread["Easy"]) < min(spread["Medium"])
    assert max(spread["Medium"]) < min(spread["Hard"])


@pytest.mark.parametrize("name", ["Easy", "Medium"])
def test_the_level_is_even_on_the_easier_levels(name):
    for each in plans(name):
        assert np.ptp(each.river.level_m) == 0


def test_the_level_falls_3_m_on_hard_and_is_regained_in_one_rapid():
    for each in plans("Hard"):
        river = each.river
        assert np.ptp(river.level_m) == pytest.approx(3.0, abs=0.02)
        rise = np.roll(river.level_m, -1) - river.level_m
        rising = rise > 0
        assert np.sum(rising & ~np.roll(rising, 1)) == 1
        assert 8.0 <= rising.sum() * river.length_m / river.segments <= RAPID_M + 2.0
        assert rise.max() / (river.length_m / river.segments) < checks.MAX_LEVEL_SLOPE


@EVERY
def test_no_crossing_and_no_bend_too_tight(name):
    for each in plans(name):
        assert len(geometry.self_crossings(each.river.position_m, True)) == 0
        radius = 1 / np.abs(checks.smoothed_curvature(each.river)).max()
        assert radius > checks.MIN_RADIUS_M
        inner = 1 / np.abs(checks.smoothed_curvature(each.river)) - each.river.width_m / 2
        assert inner.min() > checks.MIN_INNER_BANK_M


@EVERY
def test_arms_have_six_metres_of_land_between_them(name):
    for each in plans(name):
        checks.check_arms(each.river, 6.0)


@EVERY
def test_courses_lie_in_a_square_of_140_m(name):
    for each in plans(name):
        assert np.ptp(each.river.position_m, axis=0).max() <= 140.0
        assert np.abs(each.river.position_m.min(axis=0) + each.river.position_m.max(axis=0)).max() < 1e-9


@pytest.mark.parametrize("name", ["Medium", "Hard"])
def test_islands_lie_in_the_channel_and_leave_an_arm(name):
    for each in plans(name):
        river = each.river
        for row in each.islands:
            edge = islands.outline(row)
            segment, share, lateral = nearest(river.position_m, True, edge)
            width = along(river.width_m, segment, share)
            assert (width / 2 - np.abs(lateral)).min() > 0.3
            gaps = checks.widest_free_gaps(river, row[None], 0.0)
            beside = np.hypot(*(river.position_m - row[:2]).T) < row[2]
            assert (gaps[beside, 1] - gaps[beside, 0]).min() >= 2.5


@EVERY
def test_every_sample_has_a_safe_pose(name):
    for each in plans(name):
        gaps = checks.widest_free_gaps(each.river, each.islands, checks.CLEARANCE_M)
        assert np.all(gaps[:, 1] >= gaps[:, 0])
        heights = checks.safe_heights(each.river, each.bridges)
        assert heights[:, 0].max() < 4.0


@EVERY
def test_bridges_reach_both_banks_at_right_angles_and_clear_of_one_another(name):
    for each in plans(name):
        for row in each.bridges:
            along = np.array([np.cos(row[2]), np.sin(row[2])])
            ends = row[:2] + np.array([[-0.5], [0.5]]) * row[3] * along
            assert bank_distance(ends, each.river.position_m, each.river.width_m).min() > 1.0
            sample = int(np.argmin(np.hypot(*(each.river.position_m - row[:2]).T)))
            assert abs(each.river.tangent[sample] @ along) < 1e-9
            assert row[8] == pytest.approx(each.river.level_m[sample] + 2.2)
        apart = geometry.distances(each.bridges[:, :2]) + 1e3 * np.eye(len(each.bridges))
        assert apart.min() > 10.0


@pytest.mark.parametrize("name", ["Medium", "Hard"])
def test_tributaries_start_in_the_river_and_keep_away_from_other_arms(name):
    for each in plans(name):
        for branch in each.branches[: LEVELS[name].tributaries]:
            river = each.river
            length = geometry.arc_length(branch.position_m, False)[1]
            assert 25.0 <= length <= 60.0
            assert 2.4 <= branch.width_m.min() <= branch.width_m.max() <= 6.0
            away = bank_distance(branch.position_m, river.position_m, river.width_m)
            assert away[0] < 0
            assert np.sum(np.diff(np.sign(away)) != 0) == 1
            assert away[-1] > 5.0


def test_the_same_seed_gives_the_same_plan_and_another_seed_another():
    again = plan(LEVELS["Hard"], 3)
    np.testing.assert_array_equal(again.river.position_m, drawn("Hard", 3).river.position_m)
    np.testing.assert_array_equal(again.river.width_m, drawn("Hard", 3).river.width_m)
    np.testing.assert_array_equal(again.islands, drawn("Hard", 3).islands)
    assert np.abs(drawn("Hard", 4).river.position_m - again.river.position_m).max() > 5.0


def test_a_level_that_cannot_be_met_is_refused(monkeypatch):
    monkeypatch.setattr("thalweg.world.generate.plan.ATTEMPTS", 20)
    impossible = replace(LEVELS["Easy"], name="Crowded", bridges=40)
    with pytest.raises(WorldError, match="no river of level 'Crowded' was found for seed 5 in 20 attempts"):
        plan(impossible, 5)
