"""Tests of the plants of banks: what is taken away, what stands where, and that the rest of the valley keeps its
own."""

import numpy as np
import pytest

from tests.world.generate.banks import straight
from thalweg.world.generate.banks import cover
from thalweg.world.generate.banks.cover import BELT_DEPTH_M, ROW_M
from thalweg.world.generate.banks.surface import PAVED_M
from thalweg.world.species import KINDS

GROUP = np.array([kind.group for kind in KINDS])
SPECIES = np.array([kind.species for kind in KINDS])


@pytest.fixture(scope="module")
def forest():
    return straight.valley(straight.terrain())


@pytest.fixture(scope="module")
def banks(forest):
    return {kind: straight.laid(kind, forest) for kind in ("meadow", "reeds", "quay")}


def away(plants) -> np.ndarray:
    """Distance of each plant from the water's edge, NaN beyond the ends of the course."""
    x, y = plants.position_m[:, :2].T
    return np.where((x > 5) & (x < 55), np.abs(y) - straight.HALF_M, np.nan)


def test_a_meadow_has_few_trees_near_the_water_and_much_grass(forest, banks):
    plants, d = banks["meadow"].plants, away(banks["meadow"].plants)
    trees, grass = GROUP[plants.kind] == "tree", SPECIES[plants.kind] == "grass"
    before = np.count_nonzero((GROUP[forest.plants.kind] == "tree") & (away(forest.plants) < 20))
    assert np.count_nonzero(trees & (d < 20)) < 0.1 * before
    assert np.nanmin(d[trees]) > 7.0
    assert np.count_nonzero(grass & (d > 0) & (d < 1.3)) / (2 * 50 * 1.3) > 0.8


def test_reeds_stand_in_a_belt_on_both_sides_of_the_edge(banks):
    plants, d = banks["reeds"].plants, away(banks["reeds"].plants)
    reeds = SPECIES[plants.kind] == "reed"
    assert np.count_nonzero(reeds & (d > 0) & (d < 1.5)) > 100
    assert np.count_nonzero(reeds & (d < 0)) > 40
    assert np.nanmin(d[reeds]) > -1.4
    assert np.nanmax(d[reeds]) < 5.0
    assert np.median(plants.height_m[reeds & (d > -0.3) & (d < 1.5)]) > 1.4
    land = banks["reeds"].terrain
    wet = reeds & (d < -0.2)
    depth = [straight.at(land, land.water_m - land.ground_m, x, y) for x, y in plants.position_m[wet, :2]]
    assert max(depth) < BELT_DEPTH_M + 0.05


def test_reeds_take_no_more_than_a_share_of_a_river_from_either_side(forest, monkeypatch):
    monkeypatch.setattr(cover, "BELT_M", (3.0, 2.3))  # as wide as the water would let them
    d = away(straight.laid("reeds", forest).plants)
    assert np.nanmin(d) > -0.12 * 2 * straight.HALF_M - 0.2  # a node is 0.25 m wide


def test_a_quay_has_a_row_of_trees_and_nothing_on_the_pavement(banks):
    plants, d = banks["quay"].plants, away(banks["quay"].plants)
    assert np.count_nonzero((d > -2.0) & (d < PAVED_M)) == 0
    row = (GROUP[plants.kind] == "tree") & (d < 11.0)
    x, y = plants.position_m[row, :2].T
    for side in (-1, 1):
        gaps = np.diff(np.sort(x[np.sign(y) == side]))
        assert len(gaps) >= 4
        assert gaps == pytest.approx(np.full(len(gaps), ROW_M), abs=1.0)


@pytest.mark.parametrize("kind", ["meadow", "reeds", "quay"])
def test_feet_are_on_the_new_ground(banks, kind):
    land, plants = banks[kind].terrain, banks[kind].plants
    under = np.array([straight.at(land, land.ground_m, x, y) for x, y in plants.position_m[:, :2]])
    gentle = np.abs(plants.position_m[:, 2] - under)
    assert np.median(gentle) < 0.02
    assert gentle.max() < 0.5


def test_the_other_bank_keeps_its_plants_to_the_bit(forest):
    plants = straight.laid("meadow_left", forest).plants
    ours, theirs = (each.position_m[each.position_m[:, 1] < -1.0] for each in (plants, forest.plants))
    ours, theirs = (each[(each[:, 0] > 5) & (each[:, 0] < 55)] for each in (ours, theirs))
    assert len(theirs) > 300
    np.testing.assert_array_equal(ours, theirs)


def test_no_crown_of_the_new_banks_reaches_over_the_water(banks):
    for each in banks.values():
        plants = each.plants
        woody = np.isin(GROUP[plants.kind], ("tree", "shrub"))
        d = away(plants)[woody]
        known = np.isfinite(d)
        assert (0.5 * plants.width_m[woody][known] <= d[known] + 0.3).all()


def test_a_level_without_plants_gets_none(forest):
    from thalweg.world.banks import read_banks
    from thalweg.world.generate.banks.lay import lay

    bare = forest._replace(plants=type(forest.plants)(*(value[:0] for value in vars(forest.plants).values())))
    laid = lay(bare, straight.river(), straight.NO_BRIDGES, read_banks("reeds"), 0.0, np.random.default_rng(4))
    assert len(laid.plants.kind) == 0
