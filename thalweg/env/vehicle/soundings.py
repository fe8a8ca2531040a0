"""Soundings: what a boat needs to know of a river beyond its course, in flat arrays like those of the course.

The depths are those of the maps from which frames are drawn, so that what is seen is what is hit.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from thalweg.env.vehicle.boat import Boat, FitError
from thalweg.world.bridges import Bridge
from thalweg.world.record import River, World
from thalweg.world.species import KINDS, kinds_of

if TYPE_CHECKING:
    from thalweg.world.species import Kind

AROUND_M = 3.0
"""Land that is kept around the channel, beyond the length of the boat."""
COARSEST_M = 1.0
"""Greatest distance between the nodes of a map that says anything about a bed; rivers without land have a coarser."""
LANE_POINTS = 65
"""Points across the river, bank to bank, at which `thalweg.env.vehicle.lanes` asks whether the boat floats."""


def no_soundings() -> dict[str, np.ndarray]:
    """Return the arrays of a vehicle that does not float, all without rows."""
    none, offsets = np.zeros(0), np.zeros(0, np.int64)
    return {
        "first_depth": offsets,
        "depth_layout": np.zeros((0, 5)),
        "depth": none.astype(np.float32),
        "first_rock": offsets,
        "rock": np.zeros((0, 3)),
        "arch": np.zeros((0, 8)),
        "through": np.zeros((0, 2, LANE_POINTS), np.uint8),
    }


def take_soundings(worlds: Sequence[World], boat: Boat) -> dict[str, np.ndarray]:
    """Return the arrays of a batch of worlds, see `thalweg.env.task.course_arrays.CourseArrays`; `through` is zero.

    Raises `FitError` for a river whose bed is unknown.
    """
    for world in worlds:
        if world.grid.cell_m > COARSEST_M or not all(world.covers(*point) for point in world.river.position_m):
            raise FitError(
                f"the bed of {world.label} is unknown: a boat needs a river with its land, such as load_or_build makes"
            )
    maps = [_depths(world, boat) for world in worlds]
    rocks = [_rocks(world, boat) for world in worlds]
    arches = [_arches(world, boat) for world in worlds]
    samples = sum(len(world.river.arc_m) for world in worlds)
    return {
        "first_depth": np.cumsum([0, *(depth.size for _, depth in maps)]).astype(np.int64),
        "depth_layout": np.array([layout for layout, _ in maps], np.float64),
        "depth": np.concatenate([depth.ravel() for _, depth in maps]),
        "first_rock": np.cumsum([0, *map(len, rocks)]).astype(np.int64),
        "rock": np.concatenate(rocks),
        "arch": np.concatenate(arches),
        "through": np.zeros((samples, 2, LANE_POINTS), np.uint8),
    }


def level_near(river: River, points_m: np.ndarray) -> np.ndarray:
    """Return the water level [K] in metres at the sample of the course that is nearest to each point [K, 2]."""
    apart = np.linalg.norm(points_m[:, None] - river.position_m, axis=-1)
    return river.level_m[apart.argmin(axis=1)] if len(points_m) else np.zeros(0)


def _depths(world: World, boat: Boat) -> tuple[tuple[float, ...], np.ndarray]:
    """Return (x and y of the first node, cell, rows, columns) and the depths [rows, columns] float32 around the
    channel; they are negative on land."""
    grid, river = world.grid, world.river
    reach = 0.5 * river.width_m[:, None] + AROUND_M + boat.length_m
    origin = np.array([grid.origin_x_m, grid.origin_y_m])
    nodes = np.array(world.ground_m.shape[::-1])
    first = np.clip(np.floor(((river.position_m - reach).min(axis=0) - origin) / grid.cell_m), 0, nodes - 2).astype(int)
    last = np.clip(np.ceil(((river.position_m + reach).max(axis=0) - origin) / grid.cell_m), first + 1, nodes - 1)
    (left, low), (right, high) = first, last.astype(int)
    window = slice(low, high + 1), slice(left, right + 1)
    depth = world.water_m[window] - world.ground_m[window]
    x, y = origin + grid.cell_m * first
    return (float(x), float(y), grid.cell_m, *depth.shape), np.ascontiguousarray(depth, np.float32)


def _rocks(world: World, boat: Boat) -> np.ndarray:
    """Return the rocks [R, 3] near the channel that a hull can touch: x, y, and the radius, the greatest at any height
    between the keels and the top of the hull; all in metres."""
    plants, river = world.plants, world.river
    chosen = np.isin(plants.kind, kinds_of("rock"))
    foot, height, width = (
        values[chosen].astype(float) for values in (plants.position_m, plants.height_m, plants.width_m)
    )
    level = level_near(river, foot[:, :2])
    low, high = level - boat.draught_m - foot[:, 2], level + boat.hull_height_m - foot[:, 2]
    rows = []
    for index, kind in enumerate(plants.kind[chosen]):
        share = widest(KINDS[kind], low[index] / height[index], high[index] / height[index])
        x, y, radius = *foot[index, :2], 0.5 * width[index] * share
        past_bank = (np.hypot(river.position_m[:, 0] - x, river.position_m[:, 1] - y) - 0.5 * river.width_m).min()
        if radius > 0.0 and past_bank <= radius + AROUND_M:
            rows.append((x, y, radius))
    return np.array(rows, np.float64).reshape(-1, 3)


def widest(kind: "Kind", low: float, high: float) -> float:
    """Return the greatest radius of a kind between two shares of its height, relative to its half width; 0 outside."""
    low, high = max(low, 0.0), min(high, 1.0)
    if low > high:
        return 0.0
    # The outline is a line of straight pieces, which is widest at one of its corners or at an end.
    corners = [kind.clear_trunk + (1.0 - kind.clear_trunk) * along for along, _ in kind.profile]
    return float(kind.crown_radius([low, high, *(at for at in corners if low <= at <= high)]).max())


def _arches(world: World, boat: Boat) -> np.ndarray:
    """Return one row [B, 8] for each bridge: its middle x, y, the direction cos, sin of its length, half of its length
    and width, and half of the opening at the top of the hull, and at the top of the mast."""
    rows = []
    for row, level in zip(world.bridges, level_near(world.river, world.bridges[:, :2]), strict=True):
        bridge = Bridge(*row)
        openings = (half_opening(bridge, level + top) for top in (boat.hull_height_m, boat.camera_height_m))
        half = 0.5 * bridge.length, 0.5 * bridge.width
        rows.append((bridge.x, bridge.y, np.cos(bridge.angle), np.sin(bridge.angle), *half, *openings))
    return np.array(rows, np.float64).reshape(-1, 8)


def half_opening(bridge: Bridge, z: float) -> float:
    """Return half the width of the opening of an arch at a height z in metres: the half ellipse over the spring, its
    foot below that, and nothing above the crown."""
    share = max(z - bridge.spring_z, 0.0) / bridge.rise
    return 0.5 * bridge.span * float(np.sqrt(max(1.0 - share * share, 0.0)))
