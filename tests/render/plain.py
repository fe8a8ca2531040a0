"""Worlds whose frames can be worked out by hand: planes, one bridge, one plant."""

import math

import numpy as np

from thalweg.world.record import Grid, Plants, River, World

NODES = 201
CELL_M = 0.5
HALF_M = (NODES - 1) * CELL_M / 2


def no_plants() -> Plants:
    return Plants(
        np.zeros((0, 3), np.float32),
        np.zeros(0, np.float32),
        np.zeros(0, np.float32),
        np.zeros(0, np.int16),
        np.zeros(0, np.float32),
        np.zeros((0, 3), np.float32),
        np.zeros((0, 2), np.float32),
    )


def plants_at(places: list[tuple[float, float]], kind: int, height: float = 8.0, width: float = 4.0) -> Plants:
    count = len(places)
    return Plants(
        np.array([(x, y, 0.0) for x, y in places], np.float32),
        np.full(count, height, np.float32),
        np.full(count, width, np.float32),
        np.full(count, kind, np.int16),
        np.zeros(count, np.float32),
        np.ones((count, 3), np.float32),
        np.ones((count, 2), np.float32),
    )


def plane(
    *,
    slope_x: float = 0.0,
    slope_y: float = 0.0,
    water_level: float = -5.0,
    bridges: np.ndarray | None = None,
    plants: Plants | None = None,
    grey: int = 160,
) -> World:
    """Ground z = slope_x * x + slope_y * y on a square of 100 m about the origin.

    There is water wherever it lies below water_level.
    """
    axis = np.arange(NODES) * CELL_M - HALF_M
    ground = (slope_x * axis + slope_y * axis[:, None]).astype(np.float32)
    water = np.full((NODES, NODES), water_level, np.float32)
    line = np.linspace(-20.0, 20.0, 32)
    river = River(
        closed=False,
        position_m=np.stack([line, np.zeros_like(line)], axis=1),
        arc_m=line - line[0],
        length_m=40.0,
        tangent=np.broadcast_to([1.0, 0.0], (32, 2)).copy(),
        width_m=np.full(32, 8.0),
        depth_m=np.ones(32),
        level_m=np.zeros(32),
    )
    full = np.full((NODES, NODES), 255, np.uint8)
    return World(
        name="plane",
        seed=0,
        river=river,
        islands=np.zeros((0, 5)),
        bridges=np.zeros((0, 11)) if bridges is None else bridges,
        grid=Grid(-HALF_M, -HALF_M, CELL_M),
        ground_m=ground,
        water_m=water,
        albedo=np.full((NODES, NODES, 3), grey, np.uint8),
        sun=full,
        sky=full.copy(),
        canopy_m=np.maximum(ground, water),
        plants=no_plants() if plants is None else plants,
        sun_azimuth=0.6,
        sun_elevation=math.radians(55),
    )
