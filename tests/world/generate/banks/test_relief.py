"""Tests of the ground of banks, by profiles across a straight river."""

import numpy as np
import pytest

from tests.world.generate.banks import straight
from thalweg.world.banks import QUAY_FALL, QUAY_WALL_M, quay_run_m
from thalweg.world.bridges import bridge_across
from thalweg.world.generate.banks.relief import FOOT_M, shaped


@pytest.fixture(scope="module")
def land():
    return straight.terrain()


def height_of(terrain) -> np.ndarray:
    return terrain.ground_m - terrain.water_m


def with_banks(land, banks: str):
    return shaped(land, straight.zones(banks, land), straight.NO_BRIDGES, np.random.default_rng(5))


@pytest.mark.parametrize("banks", ["meadow", "reeds", "quay", "quay_10-30_left+reeds_20-50_right"])
def test_the_water_ends_where_it_did(land, banks):
    new = with_banks(land, banks)
    np.testing.assert_array_equal(new.ground_m > new.water_m, land.ground_m > land.water_m)
    np.testing.assert_array_equal(new.water_m, land.water_m)


def test_ground_without_a_share_stays_to_the_bit(land):
    zones = straight.zones("quay_20-40_left", land)
    new = shaped(land, zones, straight.NO_BRIDGES, np.random.default_rng(5))
    none = zones.share["quay"] == 0
    assert none.mean() > 0.5
    np.testing.assert_array_equal(new.ground_m[none], land.ground_m[none])


def test_a_quay_is_a_wall_before_a_level_pavement(land):
    height, run = height_of(with_banks(land, "quay")), quay_run_m(land.grid.cell_m)
    profile = {d: straight.at(land, height, 30.0, 4.0 + d) for d in (0.0, 1.25, 3.0, 5.0)}
    assert profile[0.0] == pytest.approx(0.0, abs=0.02)
    for d in (1.25, 3.0, 5.0):
        assert profile[d] == pytest.approx(QUAY_WALL_M + QUAY_FALL * (d - run), abs=0.01)
    rise = np.array([straight.at(land, height, 30.0, 4.0 + d) for d in np.arange(0.0, 1.5, land.grid.cell_m)])
    assert np.diff(rise).max() / land.grid.cell_m > 1.2


def test_water_is_deep_at_the_foot_of_a_quay_and_as_it_was_in_mid_channel(land):
    height = height_of(with_banks(land, "quay"))
    assert -straight.at(land, height, 30.0, 3.0) > 0.9 * FOOT_M
    assert straight.at(land, height, 30.0, 0.0) == straight.at(land, height_of(land), 30.0, 0.0)


def test_a_meadow_rises_quickly_and_then_is_flat(land):
    height = height_of(with_banks(land, "meadow"))
    near, far = straight.at(land, height, 30.0, 5.5), straight.at(land, height, 30.0, 11.0)
    assert 0.45 < near < 0.7
    assert abs(far - near) < 0.3


def test_reeds_stand_on_low_ground(land):
    height = height_of(with_banks(land, "reeds"))
    rows = [straight.at(land, height, x, side * 7.0) for x in (10.0, 30.0, 50.0) for side in (1.0, -1.0)]
    assert min(rows) > 0.2 and max(rows) < 0.4


def test_a_bridge_keeps_its_causeways():
    bridge = np.array([bridge_across(np.array([30.0, 0.0]), np.array([1.0, 0.0]), 8.0, 0.0, np.random.default_rng(1))])
    land = straight.terrain(bridges=bridge)
    new = shaped(land, straight.zones("meadow", land), bridge, np.random.default_rng(5))
    end_m = bridge[0, 3] / 2
    for y in (end_m + 0.5, -end_m - 0.5):
        before, after = (straight.at(land, height_of(each), 30.0, y) for each in (land, new))
        assert before > 1.2
        assert after == pytest.approx(before, abs=0.05)


def test_islands_stay_as_they_were():
    land = straight.terrain(islands=np.array([[30.0, 1.2, 3.0, 1.0, 0.0]]))
    zones = straight.zones("quay", land)
    new = shaped(land, zones, straight.NO_BRIDGES, np.random.default_rng(5))
    on = zones.island_m == 0
    assert on.sum() > 50
    np.testing.assert_array_equal(new.ground_m[on], land.ground_m[on])
