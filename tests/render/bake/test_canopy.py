"""Tests of the canopy that water mirrors, over planes with a plant or a bridge."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.frames import ARCH
from tests.render.plain import CELL_M, HALF_M, plane, plants_at
from thalweg.render.bake import canopy, impostors, scene_tables
from thalweg.render.records import layout
from thalweg.world.light.bake import bake
from thalweg.world.species import KINDS

OAK = next(k for k, kind in enumerate(KINDS) if kind.species == "oak")


def baked(world):
    """Heights in metres [Y, X, 4], radiance [Y, X, 3] and heights of plants [Y, X] of a world's canopy."""
    sun = scene_tables.sun_vector(world)
    lit = scene_tables.ground_radiance(world, sun)
    heights, paint = canopy.canopy_map(world, lit, impostors.atlas(world.sun_elevation), sun)
    four = np.stack([heights >> shift & 255 for shift in (0, 8, 16, 24)], axis=-1)
    colour = np.stack([paint >> shift & 255 for shift in (0, 8, 16)], axis=-1) / 255.0
    metres = lambda code: (code / 255.0) ** 2 * layout.CANOPY_RANGE_M  # noqa: E731
    return metres(four), colour**2 * layout.PAINT_RANGE, metres(paint >> 24)


def lit(world):
    """A world with the light and the height of its canopy that its plants and bridges ask for."""
    seen = world.grid, world.ground_m, world.water_m, world.plants, world.bridges
    light = bake(*seen, world.sun_azimuth, world.sun_elevation)
    plants = replace(world.plants, light=light.plant_light)
    return replace(world, sun=light.sun, sky=light.sky, canopy_m=light.canopy_m, plants=plants)


def cell(x, y):
    return int((y + HALF_M) / CELL_M) // layout.CANOPY_CELL, int((x + HALF_M) / CELL_M) // layout.CANOPY_CELL


def test_heights_are_those_above_the_water_and_zero_where_it_is_open():
    heights, _, tall = baked(plane(slope_x=0.1, water_level=1.0))
    assert (heights[:, : cell(0, 0)[1], 0] == 0).all()
    # The ground is ten metres inland one metre higher than the water.
    assert heights[cell(20.0, 0.0)][0] == pytest.approx(1.05, abs=0.06)
    assert (tall == 0).all()


def test_a_texel_holds_the_heights_of_the_next_cells():
    heights, _, _ = baked(plane(slope_x=0.1, slope_y=0.05, water_level=-1.0))
    np.testing.assert_array_equal(heights[:, :-1, 1], heights[:, 1:, 0])
    np.testing.assert_array_equal(heights[:-1, :, 2], heights[1:, :, 0])
    np.testing.assert_array_equal(heights[:-1, :-1, 3], heights[1:, 1:, 0])


def test_a_crown_has_its_height_shape_and_colour():
    trees = plants_at([(4.0, 3.0), (-14.0, -6.0)], kind=OAK, height=9.0, width=6.0)
    red = replace(trees, tint=np.array([[4.0, 1.0, 1.0], [1.0, 1.0, 1.0]], np.float32))
    world = plane(water_level=-1.0, plants=red)
    world = lit(world)
    heights, colour, tall = baked(world)
    middle, beside, clear = cell(4.0, 3.0), cell(6.5, 3.0), cell(9.0, 3.0)
    assert 10.0 - canopy.RAGGED_M - 0.2 < heights[middle][0] < 10.2
    assert heights[beside][0] < heights[middle][0] - 0.4
    assert heights[clear][0] == pytest.approx(1.0, abs=0.05)
    assert tall[middle] == pytest.approx(heights[middle][0], abs=0.1)
    assert tall[clear] == 0
    other = cell(-14.0, -6.0)
    assert colour[middle][0] / colour[other][0] > 2.5
    assert colour[other][1] > colour[other][2]
    # Leaves are darker than the light ground beside them.
    assert colour[other][1] < 0.3 * colour[clear][1]


def test_of_two_crowns_the_higher_one_owns_a_cell():
    world = plane(plants=plants_at([(0.0, 0.0), (1.0, 0.0)], kind=OAK, height=6.0, width=6.0))
    higher = replace(world.plants, height_m=np.array([6.0, 9.0], np.float32))
    owner = canopy.owners(replace(world, plants=higher), (100, 100))
    assert owner[cell(0.0, 0.0)] == 1
    assert owner[cell(-2.9, 0.0)] == 0
    assert owner[cell(20.0, 0.0)] == -1


def test_a_bridge_is_mirrored_as_stone():
    world = plane(water_level=1.0, bridges=ARCH)
    world = lit(world)
    heights, colour, _ = baked(world)
    np.testing.assert_allclose(colour[cell(0.3, 0.3)], canopy.STONE_RADIANCE, rtol=0.03)
    assert heights[cell(0.3, 0.3)][0] == pytest.approx(1.2, abs=0.35)
    assert heights[cell(12.0, 12.0)][0] == 0


def test_ground_at_the_edge_of_the_water_is_wet_and_dark():
    heights, colour, _ = baked(plane(slope_x=0.1, water_level=0.0))
    wet, dry = cell(0.6, 0.0), cell(30.0, 0.0)
    assert heights[dry][0] > canopy.DRY_M
    assert colour[wet][0] / colour[dry][0] == pytest.approx(canopy.WET, abs=0.08)


def test_a_side_that_faces_the_sun_is_brighter():
    rise = np.repeat(np.abs(np.arange(20) - 10)[None, :] * -1.0 + 10.0, 20, axis=0)
    factor = canopy.sunward(rise, 1.0, np.array([0.8, 0.0, 0.6]))
    # The ridge runs along y; its side towards +x sees the sun.
    assert factor[5, 15] > 1.8 * factor[5, 5]
