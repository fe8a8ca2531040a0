"""Kinds of matter that a point of a world may lie in: ground, water, the stone of a bridge, a plant or a rock."""

from typing import NamedTuple

import numpy as np

from thalweg.world.bridges import Bridge, local_coordinates
from thalweg.world.record import PARAPET_THICKNESS_M, World
from thalweg.world.species import KINDS


class Enclosure(NamedTuple):
    """What contains a point."""

    name: str
    """With a preposition, such as `under the ground` or `inside a bridge`."""
    top_m: float
    """Height z above which the point would be outside."""


def enclosure_of(world: World, x: float, y: float, z: float) -> Enclosure | None:
    """Return what contains a point on the map (metres), or None for a point in the open air."""
    ground, water = _height(world, world.ground_m, x, y), _height(world, world.water_m, x, y)
    if z <= ground:
        return Enclosure("under the ground", max(ground, water))
    if z <= water:
        return Enclosure("under water", water)
    for row in world.bridges:
        if (top := _stone_top(row, x, y, z)) is not None:
            return Enclosure("inside a bridge", top)
    return _plant_around(world, x, y, z)


def _height(world: World, heights: np.ndarray, x: float, y: float) -> float:
    """Return the bilinear height of a map [GY, GX] at a point."""
    grid, (rows, columns) = world.grid, heights.shape
    across, up = (x - grid.origin_x_m) / grid.cell_m, (y - grid.origin_y_m) / grid.cell_m
    column, row = min(int(across), columns - 2), min(int(up), rows - 2)
    east, north = across - column, up - row
    south_edge, north_edge = heights[row : row + 2, column : column + 2].astype(float) @ [1 - east, east]
    return float((1 - north) * south_edge + north * north_edge)


def _stone_top(row: np.ndarray, x: float, y: float, z: float) -> float | None:
    """Return the top of a bridge's stone over a point in it; None for a point beside, above or under its arch."""
    bridge = Bridge(*row)
    u, v = (abs(float(value)) for value in local_coordinates(row, np.asarray(x), np.asarray(y)))
    if u > bridge.length / 2 or v > bridge.width / 2:
        return None
    top = bridge.deck_z - bridge.hump * (2 * u / bridge.length) ** 2
    if v > bridge.width / 2 - PARAPET_THICKNESS_M:
        top += bridge.parapet
    from_middle = 2 * u / bridge.span
    arch = bridge.spring_z + bridge.rise * np.sqrt(1 - from_middle**2) if from_middle < 1 else -np.inf
    return float(top) if arch < z <= top else None


def _plant_around(world: World, x: float, y: float, z: float) -> Enclosure | None:
    """Return the first plant or rock whose outline contains a point, its clear trunk left out."""
    plants = world.plants
    foot, height = plants.position_m.astype(float), plants.height_m.astype(float)
    apart = np.hypot(foot[:, 0] - x, foot[:, 1] - y)
    near = (2 * apart <= plants.width_m) & (z >= foot[:, 2]) & (z <= foot[:, 2] + height)
    for index in np.flatnonzero(near):
        kind = KINDS[plants.kind[index]]
        share = (z - foot[index, 2]) / height[index]
        if apart[index] <= kind.crown_radius(share) * plants.width_m[index] / 2:
            return Enclosure(f"inside a plant or rock ({kind.name})", float(foot[index, 2] + height[index]))
    return None
