"""Slow geometry of polygons in plain NumPy, by other methods than the kernels', as an oracle."""

import numpy as np


def rectangle(x: float, y: float, yaw: float, half_length: float, half_beam: float) -> np.ndarray:
    """The corners [4, 2] of an oriented rectangle, in order."""
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    return np.array(
        [
            np.array([x, y]) + a * half_length * ahead + b * half_beam * left
            for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
    )


def contains(polygon: np.ndarray, point: np.ndarray) -> bool:
    """Whether a convex polygon [K, 2], counter-clockwise, contains a point [2]: it is to the left of every side."""
    begin, end = polygon, np.roll(polygon, -1, axis=0)
    side, to_point = end - begin, point - begin
    return bool((side[:, 0] * to_point[:, 1] - side[:, 1] * to_point[:, 0] >= 0).all())


def distance(polygon: np.ndarray, point: np.ndarray) -> float:
    """The distance of a point [2] from a convex polygon [K, 2]; 0 inside."""
    if contains(polygon, point):
        return 0.0
    apart = []
    for begin, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        share = np.clip(np.dot(point - begin, end - begin) / np.dot(end - begin, end - begin), 0.0, 1.0)
        apart.append(np.linalg.norm(begin + share * (end - begin) - point))
    return float(min(apart))


def gap(one: np.ndarray, other: np.ndarray) -> float:
    """The distance between two convex polygons; 0 if they meet: a corner of one is in the other, or sides cross."""
    pairs = [(a, b) for a in sides(one) for b in sides(other)]
    if any(crosses(*a, *b) for a, b in pairs):
        return 0.0
    return min([distance(one, corner) for corner in other] + [distance(other, corner) for corner in one])


def sides(polygon: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    return list(zip(polygon, np.roll(polygon, -1, axis=0), strict=True))


def crosses(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> bool:
    """Whether the segments a-b and c-d cross, which lie on different sides of one another."""

    def turn(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0
