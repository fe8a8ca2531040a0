"""The map of a river as plain data that a page draws: banks, centre line, islands and bridges, in metres."""

from typing import Any

import numpy as np

from thalweg.render.records.props import KIND, X, Y
from thalweg.world.bridges import deck
from thalweg.world.islands import outline
from thalweg.world.record import World


def map_of(world: World) -> dict[str, Any]:
    """Return the map of a world: lines are lists of [x, y] in metres, to the centimetre."""
    river = world.river
    side = 0.5 * river.width_m[:, None] * np.stack([-river.tangent[:, 1], river.tangent[:, 0]], axis=1)
    return {
        "closed": bool(river.closed),
        "length_m": round(float(river.length_m), 1),
        "centre": _points(river.position_m),
        "left": _points(river.position_m + side),
        "right": _points(river.position_m - side),
        "islands": [_points(outline(row, 24)) for row in world.islands],
        "bridges": [_points(deck(row)) for row in world.bridges],
    }


def props_on_map(props: np.ndarray | None) -> list[list[float]]:
    """Return kind, x and y of the objects [1, P, 6] that are drawn now; empty without any."""
    if props is None:
        return []
    rows = props[0]
    return np.round(rows[rows[:, KIND] > 0][:, [KIND, X, Y]].astype(float), 2).tolist()


def _points(line: np.ndarray) -> list[list[float]]:
    return np.round(line, 2).tolist()
