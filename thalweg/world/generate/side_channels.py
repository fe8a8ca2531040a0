"""Water that is not part of the course: tributaries that leave it, and ponds. It is outside the flight volume."""

from dataclasses import dataclass

import numpy as np

from thalweg.world.generate.hydrology import Line

STEP_M = 1.5
"""Spacing of the vertices of a branch."""
MIN_LAND_M = 5.0
"""Minimum land between a branch and any arm of the river that it does not belong to."""


@dataclass(frozen=True)
class Branch:
    """Still water along an open line: the union of discs of changing width."""

    position_m: np.ndarray
    """[K, 2] float64; the first vertex of a tributary lies on the centre line of the course."""
    width_m: np.ndarray
    """[K] float64."""
    level_m: float
    """Height of its surface; for a tributary, that of the river at the mouth."""
    depth_m: float
    """Depth in the middle."""


def bank_distance(points: np.ndarray, line: np.ndarray, width_m: np.ndarray) -> np.ndarray:
    """Return [P] the approximate distance of points [P, 2] from the nearest bank in metres, negative in the water."""
    delta = points[:, None, :] - line[None, :, :]
    return (np.hypot(delta[..., 0], delta[..., 1]) - width_m / 2).min(axis=1)


def tributary(
    line: Line, width_m: np.ndarray, mouth: int, level_m: float, side: float, rng: np.random.Generator
) -> Branch | None:
    """Return a side channel 25 to 45 m long that leaves the course at sample `mouth`; None if it nears another arm.

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
    bank_gap = bank_distance(position, line.position_m, width_m) - width / 2
    past_bank = travelled - width_m[mouth] / 2
    # Near the mouth the gap may be smaller, because the branch still touches its own arm.
    needed = np.minimum(MIN_LAND_M, 0.4 * past_bank - width / 2)
    if np.any((bank_gap < needed) & (past_bank > 3.0)):
        return None
    return Branch(position, width, level_m, depth_m=float(rng.uniform(0.5, 0.9)))


def pond(
    line: Line, width_m: np.ndarray, branches: list[Branch], keep_clear_m: np.ndarray, level_m: np.ndarray
) -> Branch | None:
    """Return a pond at the roomiest position inside the loop, clear of points; None without room.

    keep_clear_m: the points [K, 2]. Its level is that of the nearest sample of the course.
    """
    low, high = line.position_m.min(axis=0), line.position_m.max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0], 2.0), np.arange(low[1], high[1], 2.0))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    points = points[winding(line.position_m, points) != 0]
    clearance = bank_distance(points, line.position_m, width_m)
    for branch in branches:
        clearance = np.minimum(clearance, bank_distance(points, branch.position_m, branch.width_m))
    if len(keep_clear_m):
        clearance = np.minimum(clearance, bank_distance(points, keep_clear_m, np.full(len(keep_clear_m), 12.0)))
    if len(points) == 0 or clearance.max() < 9.5:
        return None
    best = int(np.argmax(clearance))
    radius = min(clearance[best] - 6.5, 6.5)
    near = int(np.argmin(np.hypot(*(line.position_m - points[best]).T)))
    along = line.tangent[near]
    offsets = np.linspace(-1.0, 1.0, 7)
    position = points[best] + offsets[:, None] * along * 0.55 * radius
    width = 2 * radius * np.array([0.45, 0.55, 0.62, 0.6, 0.5, 0.45, 0.4])
    return Branch(position, width, float(level_m[near]), depth_m=0.8)


def winding(line: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return [P] int the winding number of a closed line [S, 2] around each of `points` [P, 2] (Sunday, 2001)."""
    start, end = line, np.roll(line, -1, axis=0)
    up = (start[None, :, 1] <= points[:, None, 1]) & (end[None, :, 1] > points[:, None, 1])
    down = (start[None, :, 1] > points[:, None, 1]) & (end[None, :, 1] <= points[:, None, 1])
    side = (end[:, 0] - start[:, 0])[None, :] * (points[:, None, 1] - start[None, :, 1]) - (
        points[:, None, 0] - start[None, :, 0]
    ) * (end[:, 1] - start[:, 1])[None, :]
    return (up & (side > 0)).sum(axis=1) - (down & (side < 0)).sum(axis=1)
