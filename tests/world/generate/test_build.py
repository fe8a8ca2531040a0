"""Tests that a level and a seed give the same world each time."""

import numpy as np
import pytest

from thalweg.world import LEVELS, World, build

pytestmark = pytest.mark.slow


def saved(world: World, path) -> bytes:
    world.save(path)
    return path.read_bytes()


@pytest.mark.parametrize("name", LEVELS)
@pytest.mark.slow
def test_the_same_level_and_seed_give_the_same_bytes(name, tmp_path):
    assert saved(build(name, 11), tmp_path / "a.npz") == saved(build(name, 11), tmp_path / "b.npz")


def test_repr_and_covers_of_a_world(easy_world):
    assert repr(easy_world).startswith("World('Easy', seed 1: a loop of 277 m, 1 bridges, 0 islands, ")
    assert len(repr(easy_world)) < 120
    grid, (rows, columns) = easy_world.grid, easy_world.ground_m.shape
    right, top = grid.origin_x_m + (columns - 1) * grid.cell_m, grid.origin_y_m + (rows - 1) * grid.cell_m
    assert easy_world.covers(grid.origin_x_m, top)
    assert easy_world.covers(right, grid.origin_y_m)
    for x, y in ((right + 0.1, top), (right, top + 0.1), (grid.origin_x_m - 0.1, top), (float("nan"), 0.0)):
        assert not easy_world.covers(x, y)


def test_shapes_of_a_world_fit_together(hard_world):
    world, level = hard_world, LEVELS["Hard"]
    assert (world.name, world.seed) == ("Hard", level.default_seed)
    for values in (world.water_m, world.sun, world.sky, world.canopy_m, world.albedo[..., 0]):
        assert values.shape == world.ground_m.shape
    assert np.all(world.canopy_m >= np.maximum(world.ground_m, world.water_m) - 1e-4)
    assert len(world.plants.kind) > 1000
    assert world.plants.light.min() >= 0
    assert world.plants.light.max() <= 1
    assert np.degrees(world.sun_elevation) == pytest.approx(55.0)
    low = np.array([world.grid.origin_x_m, world.grid.origin_y_m])
    high = low + world.grid.cell_m * (np.array(world.ground_m.shape[::-1]) - 1)
    assert (world.river.position_m.min(axis=0) - low).min() >= 55.0
    assert (high - world.river.position_m.max(axis=0)).min() >= 55.0
