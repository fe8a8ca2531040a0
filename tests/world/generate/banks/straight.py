"""A straight river of 60 m along the x axis, 8 m wide, whose banks can be told by hand: the left one is north."""

import numpy as np

from thalweg.world.banks import read_banks
from thalweg.world.generate import plants, surface
from thalweg.world.generate.banks.lay import Valley, lay
from thalweg.world.generate.banks.zones import Zones, measure
from thalweg.world.generate.terrain import Relief, Terrain, build_terrain
from thalweg.world.real.centerline import read_river
from thalweg.world.record import River

HALF_M = 4.0
NO_BRIDGES, NO_ISLANDS = np.zeros((0, 11)), np.zeros((0, 5))


def river() -> River:
    x = np.linspace(0.0, 60.0, 16)
    return read_river(np.stack([x, 0 * x, 0 * x, 0 * x + 2 * HALF_M], axis=1), False, 1.0)


def terrain(islands: np.ndarray = NO_ISLANDS, bridges: np.ndarray = NO_BRIDGES) -> Terrain:
    return build_terrain(river(), islands, bridges, (), Relief(), np.random.default_rng(1))


def zones(banks: str, land: Terrain) -> Zones:
    return measure(land, river(), read_banks(banks))


def valley(land: Terrain) -> Valley:
    """A whole valley of forest."""
    maps = land.grid, land.ground_m, land.water_m, land.shore_m
    return Valley(
        land,
        surface.paint(*maps, np.random.default_rng(2)),
        plants.scatter(*maps, land.keep_clear, 1.0, np.random.default_rng(3)),
    )


def laid(banks: str, forest: Valley, bridges: np.ndarray = NO_BRIDGES) -> Valley:
    return lay(forest, river(), bridges, read_banks(banks), 1.0, np.random.default_rng(4))


def at(land: Terrain, field: np.ndarray, x: float, y: float):
    """The value of a map at the node nearest to a place."""
    grid = land.grid
    return field[round((y - grid.origin_y_m) / grid.cell_m), round((x - grid.origin_x_m) / grid.cell_m)]
