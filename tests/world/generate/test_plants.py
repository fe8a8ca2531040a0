"""Tests of the positions, densities and sizes of plants."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial import KDTree

from tests.world.valley import valley
from thalweg.world.generate.plants import REED_REACH_M, SPACING_M, Site, scatter, throw_darts
from thalweg.world.generate.surface import forest_edge_m
from thalweg.world.species import KINDS

GROUP = np.array([kind.group for kind in KINDS])
SPECIES = np.array([kind.species for kind in KINDS])


@pytest.fixture(scope="module")
def scene():
    grid, ground, water, shore, clear = valley(400)
    clear[150:250, 300:330] = True
    plants = scatter(grid, ground, water, shore, clear, 1.0, np.random.default_rng(5))
    site = Site(grid, ground, water, shore, shore - forest_edge_m(grid, shore.shape), ~clear)
    return site, plants


def places(scene, group: str) -> np.ndarray:
    return scene[1].position_m[GROUP[scene[1].kind] == group, :2].astype(np.float64)


def test_every_group_is_present(scene):
    assert set(GROUP[scene[1].kind]) == {"tree", "shrub", "reed", "rock"}


def test_no_plant_stands_where_it_must_be_clear(scene):
    site, plants = scene
    assert site.at(site.open, plants.position_m[:, :2]).all()


def test_feet_are_on_the_ground(scene):
    site, plants = scene
    row, column = ((plants.position_m[:, k].astype(np.float64) + 50.0) / 0.25 for k in (1, 0))
    under = RegularGridInterpolator((np.arange(400.0), np.arange(400.0)), site.ground_m)((row, column))
    assert np.abs(plants.position_m[:, 2] - under).max() < 1e-3


def test_trees_begin_behind_the_bank_and_nowhere_nearer_than_two_metres(scene):
    site, _ = scene
    away = site.at(site.shore_m, places(scene, "tree"))
    assert away.min() > 2.0
    first = np.percentile(away[away < 14.0], 5)
    assert 3.0 < first < 8.0


def test_no_crown_of_a_tree_or_shrub_reaches_over_the_water(scene):
    site, plants = scene
    woody = np.isin(GROUP[plants.kind], ("tree", "shrub"))
    room = site.at(site.shore_m, plants.position_m[woody, :2])
    assert (0.5 * plants.width_m[woody] <= room + 1e-4).all()


def test_no_crown_reaches_over_water_that_the_distance_to_the_shore_misses():
    grid, ground, water, shore, clear = valley(200)
    plants = scatter(grid, ground, water, shore + 3.0, clear, 1.0, np.random.default_rng(5))
    woody = np.isin(GROUP[plants.kind], ("tree", "shrub"))
    row, column = np.nonzero(water > ground)
    wet = np.column_stack([grid.origin_x_m + column * grid.cell_m, grid.origin_y_m + row * grid.cell_m])
    away = KDTree(wet).query(plants.position_m[woody, :2])[0]
    assert (away > 0.5 * plants.width_m[woody] - 2.0 * grid.cell_m).all()


def test_reeds_keep_to_the_shallow_edge(scene):
    site, plants = scene
    xy = plants.position_m[SPECIES[plants.kind] == "reed", :2]
    assert site.at(site.shore_m, xy).min() > -REED_REACH_M - 0.01
    assert (site.at(site.water_m, xy) - site.at(site.ground_m, xy)).max() < 0.3


@pytest.mark.parametrize("group", ["shrub", "reed", "rock"])
def test_plants_of_a_group_keep_their_spacing(scene, group):
    nearest = KDTree(places(scene, group)).query(places(scene, group), k=2)[0][:, 1]
    assert nearest.min() >= SPACING_M[group] * 0.999


def test_forest_is_denser_in_front_than_deep_inside(scene):
    site, _ = scene
    xy = places(scene, "tree")
    inside = site.at(site.inside_m, xy)
    spacing = {}
    for name, low, high in (("front", 1.0, 12.0), ("deep", 23.0, 99.0)):
        area = np.count_nonzero((site.inside_m > low) & (site.inside_m < high) & site.open) * site.grid.cell_m**2
        spacing[name] = np.sqrt(area / np.count_nonzero((inside > low) & (inside < high)))
    assert 2.7 < spacing["front"] < 3.5
    assert 3.9 < spacing["deep"] < 5.0


def test_heights_and_widths_are_those_of_the_kind(scene):
    _, plants = scene
    low, high = np.array([KINDS[k].height_m for k in plants.kind]).T
    grown = plants.height_m / low
    assert grown.min() > 0.6
    assert (plants.height_m <= high + 1e-3).all()
    trees = GROUP[plants.kind] == "tree"
    aspect = np.array([KINDS[k].aspect for k in plants.kind])
    assert np.median((plants.width_m / plants.height_m / aspect)[trees]) == pytest.approx(1.0, abs=0.06)


def test_species_stand_in_patches(scene):
    _, plants = scene
    trees = GROUP[plants.kind] == "tree"
    conifer = np.isin(SPECIES[plants.kind[trees]], ("pine", "fir"))
    xy = plants.position_m[trees, :2]
    neighbours = np.asarray(KDTree(xy).query(xy, k=5)[1])[:, 1:]
    agreement = np.mean(conifer[neighbours] == conifer[:, None])
    by_chance = np.mean(conifer) ** 2 + np.mean(~conifer) ** 2
    assert agreement > by_chance + 0.08


def test_tints_vary_by_ten_to_sixteen_percent_about_one(scene):
    tint = scene[1].tint
    assert np.all((tint.std(axis=0) > 0.09) & (tint.std(axis=0) < 0.17))
    assert tint.mean(axis=0) == pytest.approx(np.ones(3), abs=0.08)


def test_light_is_filled_with_ones(scene):
    assert np.array_equal(scene[1].light, np.ones((len(scene[1].kind), 2), np.float32))


def test_same_seed_same_bytes(scene):
    site, plants = scene
    again = scatter(site.grid, site.ground_m, site.water_m, site.shore_m, ~site.open, 1.0, np.random.default_rng(5))
    for name in plants.__dataclass_fields__:
        assert np.array_equal(getattr(plants, name), getattr(again, name)), name


def test_density_multiplies_the_number_of_trees():
    grid, ground, water, shore, clear = valley(320)
    count = {}
    for density in (0.5, 1.0):
        plants = scatter(grid, ground, water, shore, clear, density, np.random.default_rng(5))
        count[density] = np.count_nonzero(GROUP[plants.kind] == "tree")
    assert count[0.5] / count[1.0] == pytest.approx(0.5, abs=0.06)


def test_density_0_gives_no_plants_and_a_negative_density_is_an_error():
    grid, ground, water, shore, clear = valley(64)
    assert len(scatter(grid, ground, water, shore, clear, 0.0, np.random.default_rng(0)).kind) == 0
    with pytest.raises(ValueError, match="negative"):
        scatter(grid, ground, water, shore, clear, -1.0, np.random.default_rng(0))


def test_a_map_without_land_has_no_trees():
    grid, ground, water, shore, clear = valley(64)
    plants = scatter(grid, ground - 9.0, water, np.full_like(shore, -5.0), clear, 1.0, np.random.default_rng(0))
    assert len(plants.kind) == 0


def test_dart_throwing_agrees_with_testing_every_pair():
    rng = np.random.default_rng(2)
    place = rng.uniform(0.0, 20.0, (600, 2))
    spacing = rng.uniform(0.8, 2.5, 600)
    accepted: list[int] = []
    for n in range(len(place)):
        if all(np.hypot(*(place[n] - place[k])) >= spacing[n] for k in accepted):
            accepted.append(n)
    assert np.flatnonzero(throw_darts(place, spacing, float(spacing.min()), 20.0, 20.0)).tolist() == accepted
