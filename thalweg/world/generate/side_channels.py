"""Which water is no part of the course? Tributaries that leave it, and ponds: in the water mask, outside the volume."""

from dataclasses import dataclass

import numpy as np

from thalweg.world.generate.hydrology import Line

STEP_M = 1.5
"""Spacing of the vertices of a branch."""
LAND_BETWEEN_M = 5.0
"""Least land between a branch and any arm of the river that it does not belong to."""


@dataclass(frozen=True)
class Branch:
    """Still water along an open line: the union of discs of changing width."""

    position_m: np.ndarray
    """[K, 2] float64; the first vertex of a tributary lies on the centre line of the course."""
    width_m: np.ndarray
    """[K] float64."""
    level_m: float
    """Height of its surface, that of the river at the mouth."""
    depth_m: float
    """Depth in the middle."""


def bank_distance(points: np.ndarray, line: np.ndarray, width_m: np.ndarray) -> np.ndarray:
    """[P] about the distance in metres of points [P, 2] from the nearest bank of a river, negative in its water."""
    delta = points[:, None, :] - line[None, :, :]
    return (np.hypot(delta[..., 0], delta[..., 1]) - width_m / 2).min(axis=1)


def tributary(
    line: Line, width_m: np.ndarray, mouth: int, level_m: float, side: float, rng: np.random.Generator
) -> Branch | None:
    """A side channel 25 to 45 m long that leaves the course at sample `mouth`; None if it comes near another arm.

    `side` is +1 to leave to the left, -1 to the right.
    """
    steps = round(rng.uniform(25.0, 45.0) / STEP_M) + int(width_m[mouth] / 2 / STEP_M)
    tangent = line.tangent[mouth]
    lean = side * rng.uniform(np.radians(50), np.radians(80)) * (1 if rng.random() < 0.5 else -1)
    heading = np.arctan2(tangent[1], tangent[0]) + (lean if np.sign(lean) == side else np.pi + lean)
    bow = rng.uniform(-0.025, 0.025) + 0.03 * np.sin(
        np.arange(steps) * STEP_M * 2 * np.pi / rng.uniform(18, 30) + rng.uniform(0, 2 * np.pi)
    )
    headings = heading + np.cumsum(np.concatenate([[0.0], bow])) * STEP_M
    stride = STEP_M * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    position = line.position_m[mouth] + np.concatenate([np.zeros((1, 2)), np.cumsum(stride, axis=0)])
    travelled = np.arange(len(position)) * STEP_M
    share = travelled / travelled[-1]
    base = min(rng.uniform(3.2, 5.8), 0.8 * width_m[mouth] + 0.6)
    width = base * (1 - 0.45 * share**2) * (1 + 0.12 * np.sin(travelled * 0.35 + rng.uniform(0, 6)))
    width = np.clip(width, 2.4, 6.0)
    away = bank_distance(position, line.position_m, width_m) - width / 2
    beyond = travelled - width_m[mouth] / 2
    needed = np.minimum(LAND_BETWEEN_M, 0.4 * beyond - width / 2)
    if np.any((away < needed) & (beyond > 3.0)):
        return None
    return Branch(position, width, level_m, depth_m=float(rng.uniform(0.5, 0.9)))


def pond(
    line: Line, width_m: np.ndarray, branches: list[Branch], keep_m: np.ndarray, level_m: np.ndarray
) -> Branch | None:
    """A pond at the roomiest place inside the loop, [K, 2] `keep_m` metres clear of bridges; None if there is no room.

    Its level is that of the nearest sample of the course, so that it lies in the valley as it is there.
    """
    low, high = line.position_m.min(axis=0), line.position_m.max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0], 2.0), np.arange(low[1], high[1], 2.0))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    places = places[winding(line.position_m, places) != 0]
    room = bank_distance(places, line.position_m, width_m)
    for branch in branches:
        room = np.minimum(room, bank_distance(places, branch.position_m, branch.width_m))
    if len(keep_m):
        room = np.minimum(room, bank_distance(places, keep_m, np.full(len(keep_m), 12.0)))
    if len(places) == 0 or room.max() < 9.5:
        return None
    best = int(np.argmax(room))
    radius = min(room[best] - 6.5, 6.5)
    near = int(np.argmin(np.hypot(*(line.position_m - places[best]).T)))
    along = line.tangent[near]
    offsets = np.linspace(-1.0, 1.0, 7)
    position = places[best] + offsets[:, None] * along * 0.55 * radius
    width = 2 * radius * np.array([0.45, 0.55, 0.62, 0.6, 0.5, 0.45, 0.4])
    return Branch(position, width, float(level_m[near]), depth_m=0.8)


def winding(line: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[P] int: how often a closed line [S, 2] goes round each of `points` [P, 2], counter-clockwise (Sunday, 2001)."""
    start, end = line, np.roll(line, -1, axis=0)
    up = (start[None, :, 1] <= points[:, None, 1]) & (end[None, :, 1] > points[:, None, 1])
    down = (start[None, :, 1] > points[:, None, 1]) & (end[None, :, 1] <= points[:, None, 1])
    side = (end[:, 0] - start[:, 0])[None, :] * (points[:, None, 1] - start[None, :, 1]) - (
        points[:, None, 0] - start[None, :, 0]
    ) * (end[:, 1] - start[:, 1])[None, :]
    return (up & (side > 0)).sum(axis=1) - (down & (side < 0)).sum(axis=1)
