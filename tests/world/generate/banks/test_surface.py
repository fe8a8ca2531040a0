"""Tests of the paint of banks: which material lies where, and that the rest of the valley keeps its own."""

import numpy as np
import pytest

from tests.world.generate.banks import straight
from thalweg.world.banks import quay_run_m
from thalweg.world.generate.banks import surface
from thalweg.world.generate.banks.surface import painted


@pytest.fixture(scope="module")
def forest():
    return straight.valley(straight.terrain())


def strip(forest, banks: str, low: float, high: float) -> np.ndarray:
    """Mean reflectance [3] of the land between two distances from the water, in the middle of the course."""
    zones = straight.zones(banks, forest.terrain)
    albedo = painted(forest.albedo, forest.terrain, zones, np.random.default_rng(6))
    chosen = (zones.bank_m > low) & (zones.bank_m < high) & (zones.arc_m > 10) & (zones.arc_m < 50)
    return ((albedo[chosen] / 255.0) ** 2).mean(axis=0)


@pytest.mark.parametrize("kind", ["meadow", "reeds"])
def test_green_grows_where_the_sand_was(forest, kind):
    green = strip(forest, kind, 0.6, 2.0)
    assert green[1] > 0.9 * green[0] and green[1] > 1.8 * green[2]
    assert green.max() < 0.25


def test_dark_soil_shows_at_the_lip_of_a_meadow(forest):
    assert strip(forest, "meadow", -0.05, 0.2).sum() < 0.7 * strip(forest, "meadow", 1.0, 4.0).sum()


def test_a_quay_is_grey_stone_with_a_pale_edge_and_a_dark_foot(forest):
    run = quay_run_m(forest.terrain.grid.cell_m)
    foot, coping = strip(forest, "quay", -0.05, 0.2), strip(forest, "quay", run + 0.1, run + 0.4)
    paving, lawn = strip(forest, "quay", 2.0, 4.0), strip(forest, "quay", 7.0, 11.0)
    assert foot.sum() < 0.5 * paving.sum() < 0.5 * coping.sum()
    for stone in (coping, paving):
        assert stone[2] > 0.7 * stone[0]
    assert lawn[1] > lawn[0] > 2 * lawn[2]


def test_the_other_bank_keeps_its_paint_to_the_bit(forest):
    zones = straight.zones("meadow_left", forest.terrain)
    albedo = painted(forest.albedo, forest.terrain, zones, np.random.default_rng(6))
    other = (zones.share["meadow"] == 0) & (zones.side < 0)
    assert other.mean() > 0.3
    np.testing.assert_array_equal(albedo[other], forest.albedo[other])


def test_islands_keep_their_sand():
    forest = straight.valley(straight.terrain(islands=np.array([[30.0, 0.0, 3.0, 1.2, 0.0]])))
    zones = straight.zones("meadow", forest.terrain)
    albedo = painted(forest.albedo, forest.terrain, zones, np.random.default_rng(6))
    on = zones.island_m == 0
    assert on.sum() > 50
    np.testing.assert_array_equal(albedo[on], forest.albedo[on])


def test_every_slab_has_one_tone():
    s, d = np.meshgrid(np.arange(0.05, 1.05, 0.1), np.array([0.3]))
    tones = surface.hashed(np.floor(s / 1.1), np.floor(d / 0.75))
    assert np.unique(tones).size == 1
    assert tones.min() >= 0 and tones.max() < 1
