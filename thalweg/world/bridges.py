"""Geometry of arch bridges: the random row of a bridge, its deck and collision hull, and the causeways to its ends.

Rows [11] have the columns of `thalweg.world.record.BRIDGE`. The rules use the hull for collisions: the space under the
arch counts as solid, so a camera has to fly over the bridge.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

DECK_ABOVE_WATER_M = 2.2
"""Height of the deck's middle above the water."""
LANDING_M = 2.6
"""Length of the deck beyond each bank."""
ARCH_THICKNESS_M = 0.45
"""Stone between the crown of the arch and the deck."""
FOOT_M = 1.0
"""Depth of the hull below the spring of the arch, which is near the water's surface."""
TANGENTS = 9
"""Number of planes that approximate the curved top of the hull from outside."""
RAMP_SLOPE = 0.18
"""Slope of the causeway along its way from the bridge."""
SHOULDER_SLOPE = 0.75
"""Slope of the causeway's sides."""


class Bridge(NamedTuple):
    """A bridge row with its columns by name, as in `thalweg.world.record.BRIDGE`."""

    x: float
    y: float
    angle: float
    length: float
    width: float
    span: float
    spring_z: float
    rise: float
    deck_z: float
    hump: float
    parapet: float


def bridge_across(
    position: np.ndarray, tangent: np.ndarray, river_width_m: float, level_m: float, rng: np.random.Generator
) -> np.ndarray:
    """Return a random bridge [11] float64 across the river at `position` [2], at right angles to `tangent` [2]."""
    hump = rng.uniform(0.2, 0.4)
    deck = level_m + DECK_ABOVE_WATER_M
    spring = level_m + 0.1
    return np.array(
        Bridge(
            x=float(position[0]),
            y=float(position[1]),
            angle=float(np.arctan2(tangent[0], -tangent[1])),
            length=river_width_m + 2 * LANDING_M,
            width=rng.uniform(2.6, 3.8),
            span=max(river_width_m - 0.4, 1.0),
            spring_z=spring,
            rise=deck - ARCH_THICKNESS_M - spring,
            deck_z=deck,
            hump=hump,
            parapet=rng.uniform(0.55, 0.75),
        )
    )


def local_coordinates(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (u, v), the coordinates of points in the bridge's frame: u along it and v across its deck, in metres."""
    bridge = Bridge(*row)
    cos, sin = np.cos(bridge.angle), np.sin(bridge.angle)
    dx, dy = x - bridge.x, y - bridge.y
    return cos * dx + sin * dy, -sin * dx + cos * dy


def deck(row: np.ndarray) -> np.ndarray:
    """Return the corners [4, 2] in metres of a bridge's deck from above; `row` [11] is one of `World.bridges`."""
    along = np.array([math.cos(row[2]), math.sin(row[2])])
    across = np.array([-along[1], along[0]])
    shares = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5
    return row[:2] + shares[:, :1] * row[3] * along + shares[:, 1:] * row[4] * across


def top_profile(row: np.ndarray) -> np.ndarray:
    """Return [TANGENTS + 1, 2] the vertices (u, z) of the hull's top, from one end of the bridge to the other.

    The top of the parapets, z = deck + parapet - hump (u / h)², is enclosed by its tangents at evenly spaced u.
    Neighbouring tangents meet half way between, hump (Δ / 2h)² above the curve.
    """
    bridge = Bridge(*row)
    half = bridge.length / 2
    touch = np.linspace(-1.0, 1.0, TANGENTS)
    corner = np.concatenate([[-1.0], 0.5 * (touch[1:] + touch[:-1]), [1.0]])
    nearest_touch = touch[np.minimum(np.arange(TANGENTS + 1), TANGENTS - 1)]
    height = bridge.deck_z + bridge.parapet - bridge.hump * (2 * nearest_touch * corner - nearest_touch**2)
    return np.stack([corner * half, height], axis=1)


def hull_planes(row: np.ndarray) -> np.ndarray:
    """Return [P, 4] float64 the planes of the convex hull: outward unit normal n and offset d; n·p <= d is inside.

    The hull encloses body and parapets and reaches `FOOT_M` below the spring of the arch.
    """
    bridge = Bridge(*row)
    along = np.array([np.cos(bridge.angle), np.sin(bridge.angle), 0.0])
    side = np.array([-along[1], along[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    centre = np.array([bridge.x, bridge.y, 0.0])
    top = top_profile(row)
    faces = [
        (along, centre + along * bridge.length / 2),
        (-along, centre - along * bridge.length / 2),
        (side, centre + side * bridge.width / 2),
        (-side, centre - side * bridge.width / 2),
        (-up, up * (bridge.spring_z - FOOT_M)),
    ]
    for (u0, z0), (u1, z1) in pairwise(top):
        normal = (up * (u1 - u0) - along * (z1 - z0)) / np.hypot(u1 - u0, z1 - z0)
        faces.append((normal, centre + along * u0 + up * z0))
    return np.array([[*normal, normal @ point] for normal, point in faces])


def hull_top(row: np.ndarray, x: np.ndarray, y: np.ndarray, body_m: float = 0.0) -> np.ndarray:
    """Return the height of the hull's top at points x, y [...], -inf outside the hull; `body_m` widens it sideways."""
    bridge = Bridge(*row)
    u, v = local_coordinates(row, x, y)
    inside = (np.abs(u) <= bridge.length / 2 + body_m) & (np.abs(v) <= bridge.width / 2 + body_m)
    top = top_profile(row)
    return np.where(inside, np.interp(u, top[:, 0], top[:, 1]), -np.inf)


def causeway(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the height at points x, y [...] of the causeway to the deck's ends; far below the ground elsewhere."""
    bridge = Bridge(*row)
    u, v = local_coordinates(row, x, y)
    along = np.maximum(np.abs(u) - bridge.length / 2, 0.0)
    sideways = np.maximum(np.abs(v) - bridge.width / 2 - 0.3, 0.0)
    return bridge.deck_z - bridge.hump - 0.02 - RAMP_SLOPE * along - SHOULDER_SLOPE * sideways


def on_approach(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return whether points x, y [...] lie on a bridge or on the way to it, where no plant may stand."""
    bridge = Bridge(*row)
    u, v = local_coordinates(row, x, y)
    return (np.abs(u) <= bridge.length / 2 + 10.0) & (np.abs(v) <= bridge.width / 2 + 0.8)
