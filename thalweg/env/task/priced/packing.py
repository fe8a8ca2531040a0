"""Objects of a task in a river, by the river's seed: places of swimmers, reserves, and the buoys that mark these."""

import math

import numpy as np

from thalweg.env.tasks import Task
from thalweg.render.records.props import PROP_COLUMNS, PropKind
from thalweg.world.record import River, World

HAUNT_SPACING_M = 2.0
"""Distance along the course between the places about which a swimmer or kayak may move."""
REACH_M = 10.0
"""Greatest distance along the course of a swimmer or kayak from its place."""
ISLAND_GAP_M = 2.0
"""Least distance along the course of a swimmer or kayak from an island."""
BUOY_SPACING_M = 10.0
"""Greatest distance along the course between buoys of a reserve."""
BUOY_INSET_M = 0.5
"""Distance of buoys from the bank."""
SALT = 0x4E455354
"""Separates the random numbers of reserves from others of the same seed."""


def swimmers_of(world: World, haunts: np.ndarray, task: Task) -> int:
    """Return the number of swimmers and kayaks in a river with haunts [H]."""
    if not len(haunts):
        return 0
    return max(1, round(world.river.length_m / task.swimmer_spacing_m))


def haunts_of(world: World, island_arcs: np.ndarray, task: Task) -> np.ndarray:
    """Return the places [H] in metres along the course about which swimmers may move without coming to an island.

    island_arcs [I]: metres along the course of the centre of each island. Empty in a task without swimmers.
    """
    if not task.swimmer_spacing_m:
        return np.zeros(0)
    river = world.river
    first, last = (0.0, river.length_m) if river.closed else (REACH_M, river.length_m - REACH_M)
    arcs = np.arange(first, last, HAUNT_SPACING_M)
    apart = np.abs(arcs[:, None] - island_arcs)
    if river.closed:
        apart = np.minimum(apart, river.length_m - apart)
    half_lengths = np.asarray(world.islands, np.float64).reshape(-1, 5)[:, 2:4].max(axis=1, initial=0.0)
    return arcs[(apart > half_lengths + REACH_M + ISLAND_GAP_M).all(axis=1)]


def reserves_of(world: World, task: Task) -> np.ndarray:
    """Return the reserves [R, 2] of a river: metres along the course where each begins and ends.

    One lies in each of R equal parts of the course, at a place that follows from the river's seed.
    """
    if not task.reserve_share:
        return np.zeros((0, 2))
    length = world.river.length_m
    count = max(1, round(length / task.reserve_period_m))
    part = length / count
    free = (1.0 - task.reserve_share) * part
    begin = part * np.arange(count) + free * np.random.default_rng([SALT, world.seed]).random(count)
    return np.column_stack([begin, begin + task.reserve_share * part])


def buoys_of(river: River, reserves: np.ndarray) -> np.ndarray:
    """Return the buoys [Q, 6], as in `thalweg.render.records.props`, along both edges of reserves [R, 2]."""
    rows = []
    for begin, end in reserves:
        for arc in np.linspace(begin, end, 1 + math.ceil((end - begin) / BUOY_SPACING_M)):
            x, y, tx, ty, width, level = at_arc(river, arc)
            for side in (1.0, -1.0):
                aside = side * (0.5 * width - BUOY_INSET_M)
                # Buoys that bob in step would look like one body.
                rows.append(
                    [PropKind.BUOY, x - aside * ty, y + aside * tx, level, 0.0, (1.7 * arc + side) % (2 * math.pi)]
                )
    return np.array(rows).reshape(-1, PROP_COLUMNS)


def at_arc(river: River, arc: float) -> np.ndarray:
    """Return x, y, the two components of the unit tangent, width and water level, at an arc length in metres."""
    columns = np.column_stack([river.position_m, river.tangent, river.width_m, river.level_m])
    arcs = river.arc_m
    if river.closed:
        columns, arcs = np.concatenate([columns, columns[:1]]), np.append(arcs, river.length_m)
    found = np.array([np.interp(arc, arcs, values) for values in columns.T])
    found[2:4] /= np.hypot(*found[2:4])
    return found
