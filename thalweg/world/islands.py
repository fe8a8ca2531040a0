"""Geometry of sand islands: ellipses [5] (x, y, semi-axis along, semi-axis across, angle) in the channel."""

import numpy as np

MIN_ARM_M = 3.0
"""Minimum width of the wider channel beside a generated island."""
MIN_BANK_GAP_M = 0.8
"""Minimum water between a generated island and its nearer bank."""


def squared_radius(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return ρ² of points x, y [...]: 0 at the centre of the island, 1 on its edge."""
    cos, sin = np.cos(row[4]), np.sin(row[4])
    dx, dy = x - row[0], y - row[1]
    return ((cos * dx + sin * dy) / row[2]) ** 2 + ((-sin * dx + cos * dy) / row[3]) ** 2


def distance(row: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the approximate distance in metres of points x, y [...] from the edge, negative inside; exact on the edge.

    Taubin's estimate f / |∇f| (1991) with f = ρ - 1, whose gradient is |(u/a², v/b²)| / ρ.
    """
    cos, sin = np.cos(row[4]), np.sin(row[4])
    dx, dy = x - row[0], y - row[1]
    u, v = cos * dx + sin * dy, -sin * dx + cos * dy
    rho = np.sqrt((u / row[2]) ** 2 + (v / row[3]) ** 2)
    gradient = np.sqrt((u / row[2] ** 2) ** 2 + (v / row[3] ** 2) ** 2)
    return np.where(rho > 1e-6, (rho - 1) * rho / np.maximum(gradient, 1e-9), -min(row[2], row[3]))


def outline(row: np.ndarray, points: int = 48) -> np.ndarray:
    """Return [points, 2] positions on the edge in metres."""
    t = np.linspace(0, 2 * np.pi, points, endpoint=False)
    u, v = row[2] * np.cos(t), row[3] * np.sin(t)
    cos, sin = np.cos(row[4]), np.sin(row[4])
    return np.stack([row[0] + cos * u - sin * v, row[1] + sin * u + cos * v], axis=1)


def random_island(
    position: np.ndarray, tangent: np.ndarray, width_m: float, curvature: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Return a random island [5] float64 near `position` [2], off the middle of the channel; None where none fits."""
    across = float(np.clip(rng.uniform(0.09, 0.16) * width_m, 0.8, 2.6))
    water = width_m - 2 * across
    arm = max(rng.uniform(0.55, 0.72) * water, MIN_ARM_M)
    if water - arm < MIN_BANK_GAP_M:
        return None
    along = across * rng.uniform(1.8, 3.4)
    if abs(curvature) > 1e-6:
        along = min(along, np.sqrt(1.0 / abs(curvature)))
    along = float(np.clip(along, 1.3 * across, 7.0))
    offset = (arm - (water - arm)) / 2 * (1 if rng.random() < 0.5 else -1)
    normal = np.array([-tangent[1], tangent[0]])
    centre = position + offset * normal
    angle = float(np.arctan2(tangent[1], tangent[0])) + rng.uniform(-0.08, 0.08)
    return np.array([centre[0], centre[1], along, across, angle])
