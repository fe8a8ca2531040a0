"""Rivers made by hand whose bed is a formula, for the tests of the boat."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.env.handmade import canal
from thalweg.world.bridges import bridge_across
from thalweg.world.record import Grid, Plants, World
from thalweg.world.species import KINDS

CELL_M, SHORE_M = 0.25, 14.0


def basin(
    depth: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    *,
    length_m: float = 60.0,
    width_m: float = 10.0,
    rocks: tuple[tuple[float, float, float], ...] = (),
    **options,
) -> World:
    """A straight canal along x whose depth at x, y is a function, by default 1.5 m; its banks are half a metre high.

    rocks: x, y, and the greatest radius in metres; their feet stand on the bed half a metre below the water.
    """
    world = canal(length_m, width_m=width_m, **options)
    x = np.arange(-SHORE_M, length_m + SHORE_M + CELL_M / 2, CELL_M)
    y = np.arange(-SHORE_M, SHORE_M + CELL_M / 2, CELL_M)
    grid_x, grid_y = np.meshgrid(x, y)
    deep = np.full(grid_x.shape, 1.5) if depth is None else depth(grid_x, grid_y)
    level = float(world.river.level_m[0])
    ground = level - np.where(np.abs(grid_y) > width_m / 2, -0.5, deep)
    return replace(
        world,
        grid=Grid(-SHORE_M, -SHORE_M, CELL_M),
        ground_m=ground.astype(np.float32),
        water_m=np.full(ground.shape, level, np.float32),
        plants=_rocks(rocks, level),
    )


def _rocks(rocks: tuple[tuple[float, float, float], ...], level: float) -> Plants:
    """Stones of the first kind, whose outline is widest, with the whole half width, at a fifth of the height."""
    table = np.array(rocks, np.float32).reshape(-1, 3)
    count = len(table)
    kind = next(index for index, kind in enumerate(KINDS) if kind.group == "rock")
    return Plants(
        position_m=np.column_stack([table[:, :2], np.full(count, level - 0.5, np.float32)]),
        height_m=np.full(count, 1.0, np.float32),
        width_m=2.0 * table[:, 2],
        kind=np.full(count, kind, np.int16),
        turn=np.zeros(count, np.float32),
        tint=np.ones((count, 3), np.float32),
        light=np.ones((count, 2), np.float32),
    )


def arch_at(x: float, width_m: float, level_m: float = 0.0) -> np.ndarray:
    """A bridge across such a canal, as the generator makes it."""
    rng = np.random.default_rng(1)
    return bridge_across(np.array([x, 0.0]), np.array([1.0, 0.0]), width_m, level_m, rng)[None]
