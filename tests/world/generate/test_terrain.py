"""Tests of the terrain: the water's edge is at the bank of the rules."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tests.world.lines import circle, course, stadium
from tests.world.nearest import along, nearest
from thalweg.world import LEVELS, World, WorldError, geometry, islands
from thalweg.world.generate.hydrology import make_river
from thalweg.world.generate.plan import plan, random_stream
from thalweg.world.generate.side_channels import bank_distance
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain, make_grid


@pytest.fixture(scope="module", params=[("Easy", 2), ("Medium", 1), ("Medium", 5), ("Hard", 1), ("Hard", 4)], ids=str)
def valley(request):
    """A plan and its terrain."""
    level = LEVELS[request.param[0]]
    drawn = plan(level, request.param[1])
    relief = Relief(level.hills_m, level.cut_banks)
    return drawn, build_terrain(
        drawn.river, drawn.islands, drawn.bridges, drawn.branches, relief, random_stream(level, request.param[1], 0)
    )


def at(terrain: Terrain, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Bilinear values of a map at points [P, 2]."""
    column = (points[:, 0] - terrain.grid.origin_x_m) / terrain.grid.cell_m
    row = (points[:, 1] - terrain.grid.origin_y_m) / terrain.grid.cell_m
    return map_coordinates(values.astype(np.float64), [row, column], order=1)


def beside(river, offset_m: float, side: float) -> np.ndarray:
    """[S, 2] places so far beyond the bank of each sample."""
    return river.position_m + side * (river.width_m / 2 + offset_m)[:, None] * geometry.normals(river.tangent)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_waters_edge_lies_half_a_width_from_the_centre_line(valley, side):
    drawn, terrain = valley
    river = drawn.river
    depth = terrain.water_m - terrain.ground_m
    for offset, wet in ((-0.3, True), (0.3, False)):
        points = beside(river, offset, side)
        segment, share, lateral = nearest(river.position_m, True, points)
        off = np.abs(lateral) - along(river.width_m, segment, share) / 2
        clear = np.sign(off) == np.sign(offset)
        clear &= np.abs(off) > 0.15
        for branch in drawn.branches:
            clear &= bank_distance(points, branch.position_m, branch.width_m) > 1.0
        assert clear.sum() > 0.75 * len(clear)
        found = at(terrain, depth, points[clear])
        assert np.all(found > 0) if wet else np.all(found < 0)


def test_the_complete_channel_is_wet_except_its_islands(valley):
    drawn, terrain = valley
    river = drawn.river
    depth = terrain.water_m - terrain.ground_m
    for share in np.linspace(-0.93, 0.93, 13):
        points = river.position_m + share * river.width_m[:, None] / 2 * geometry.normals(river.tangent)
        away = np.full(len(points), np.inf)
        for row in drawn.islands:
            away = np.minimum(away, islands.distance(row, *points.T))
        assert np.all(at(terrain, depth, points[away > 0.3]) > 0)
        assert np.all(at(terrain, depth, points[away < -0.3]) < 0)


def test_the_depth_on_the_centre_line_is_the_rivers(valley):
    drawn, terrain = valley
    river = drawn.river
    far = np.full(len(river.arc_m), True)
    for row in drawn.islands:
        far &= islands.distance(row, *river.position_m.T) > 6.0
    for branch in drawn.branches:
        far &= bank_distance(river.position_m, branch.position_m, branch.width_m) > 2.0
    found = at(terrain, terrain.water_m - terrain.ground_m, river.position_m)
    np.testing.assert_allclose(found[far], river.depth_m[far], atol=0.06)


def test_the_waters_surface_is_the_rivers_level(valley):
    drawn, terrain = valley
    river = drawn.river
    for share in (-0.8, 0.0, 0.8):
        points = river.position_m + share * river.width_m[:, None] / 2 * geometry.normals(river.tangent)
        np.testing.assert_allclose(at(terrain, terrain.water_m, points), river.level_m, atol=0.12)
    np.testing.assert_allclose(at(terrain, terrain.water_m, river.position_m), river.level_m, atol=0.02)


def test_land_stands_clear_of_the_water(valley):
    _, terrain = valley
    height = terrain.ground_m - terrain.water_m
    assert height[terrain.shore_m > 0.45].min() >= 0.05
    assert height[terrain.shore_m > 0.1].min() > 0
    assert height[terrain.shore_m < -0.1].max() < 0


def test_banks_are_sandy_slopes_and_hills_lie_far_off(valley):
    _, terrain = valley
    height = terrain.ground_m - terrain.water_m
    bank = height[np.abs(terrain.shore_m - 1.0) < 0.1]
    assert 0.13 < np.median(bank) < 0.5
    far = height[terrain.shore_m > 45.0]
    assert 2.0 < np.median(far) < 10.0
    assert height.max() < 17.0


def test_the_surface_of_the_water_has_no_steps(valley):
    _, terrain = valley
    steps = max(np.abs(np.diff(terrain.water_m, axis=axis)).max() for axis in (0, 1))
    assert steps < 0.35


def test_side_water_is_wet_and_outside_the_volume(valley):
    drawn, terrain = valley
    river = drawn.river
    for branch in drawn.branches:
        outside = bank_distance(branch.position_m, river.position_m, river.width_m) > 0.5
        points = branch.position_m[outside]
        assert len(points) > 5
        assert np.all(at(terrain, terrain.water_m - terrain.ground_m, points) > 0.3)
        np.testing.assert_allclose(at(terrain, terrain.water_m, points[2:]), branch.level_m, atol=0.05)


def test_islands_are_low_and_dry(valley):
    drawn, terrain = valley
    for row in drawn.islands:
        top = at(terrain, terrain.ground_m - terrain.water_m, row[None, :2])[0]
        assert 0.25 < top < 0.85
        inner = islands.outline(row * [1, 1, 0.8, 0.8, 1])
        assert at(terrain, terrain.ground_m - terrain.water_m, inner).min() > 0.02
        assert at(terrain, terrain.shore_m, row[None, :2])[0] > 0.5


def test_banks_rise_to_the_ends_of_the_bridges(valley):
    drawn, terrain = valley
    for row in drawn.bridges:
        along = np.array([np.cos(row[2]), np.sin(row[2])])
        ends = row[:2] + np.array([[-1.0], [1.0]]) * (row[3] / 2 + 0.3) * along
        assert np.abs(at(terrain, terrain.ground_m, ends) - (row[8] - row[9])).max() < 0.5
        keep = at(terrain, terrain.keep_clear, np.concatenate([row[None, :2], ends]))
        assert keep.min() == 1


def test_the_outside_of_a_bend_is_deeper():
    world = World.from_centerline(course(circle(14.0, 40), 8.0), plants=False)
    terrain = Terrain(world.grid, world.ground_m, world.water_m, world.ground_m, world.ground_m > 0)
    depth = world.water_m - world.ground_m
    inner = at(terrain, depth, circle(14.0 - 2.0, 100)).mean()
    outer = at(terrain, depth, circle(14.0 + 2.0, 100)).mean()
    assert outer > 1.2 * inner


def test_levels_pass_smoothly_between_arms_of_different_height():
    line = stadium(60.0, 14.0)
    points = course(line, 5.0)
    points[:, 2] = np.where(line[:, 1] > 0, 1.0, 0.0) * np.clip(line[:, 1] / 14.0, 0, 1) * 2.0
    world = World.from_centerline(points, plants=False)
    steps = max(np.abs(np.diff(world.water_m, axis=axis)).max() for axis in (0, 1))
    assert steps < 0.2


def test_a_course_whose_map_would_be_too_large_is_refused():
    line = circle(1250.0, 900)
    river = make_river(line, True, np.full(900, 6.0), np.ones(900), np.zeros(900))
    with pytest.raises(WorldError, match=r"map covers 2610 x 2610 m, 6\.8 km²; limit 6\.0 km²"):
        make_grid(river.position_m)
