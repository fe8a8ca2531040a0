"""A lake over level ground, a camera above it, and one prop of each kind in its view."""

import numpy as np

from tests.render.frames import ARCH
from tests.render.plain import plane
from thalweg.render.records.props import PropKind
from thalweg.world.record import World

LEVEL = 1.0
"""Height of the water, over level ground at 0."""
POSE = np.array([[0.0, 0.0, 4.0, 0.0]])
"""Three metres above the water, looking along x, 20 degrees down."""


def lake(**changed) -> World:
    return plane(water_level=LEVEL, **changed)


def row(kind: PropKind, x: float, y: float, yaw: float = 0.0, phase: float = 0.0) -> list[float]:
    return [float(kind), x, y, LEVEL, yaw, phase]


def arch_at(x: float) -> np.ndarray:
    """A bridge [1, 11] across the view at x, whose arch begins at the water."""
    arch = ARCH.copy()
    arch[0, [0, 2, 6, 7, 8]] = x, np.pi / 2, LEVEL, 1.9, LEVEL + 3.0
    return arch


ALL = np.array(
    [
        [
            row(PropKind.SWIMMER, 8.0, -1.5, 2.0, 1.0),
            row(PropKind.KAYAK, 11.0, 2.0, 1.0, 0.4),
            row(PropKind.NONE, 6.0, 0.0),
            row(PropKind.BUOY, 9.0, 0.6),
            row(PropKind.STATION, 14.0, -3.5, np.pi, 0.0),
        ]
    ]
)
