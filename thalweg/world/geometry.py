"""What is the length, the direction, the bend of a line, and where does it cross itself?

Pure functions on polylines [S, 2] in metres. `closed` says whether the last vertex joins the first. Nothing here
knows of water.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter1d

BEND_SMOOTHING_M = 4.0
"""Standard deviation of the Gaussian along the line before bends are counted: shorter wiggles are no bends."""
STRAIGHT_RADIUS_M = 40.0
"""A stretch whose radius of curvature is larger than this counts as straight and separates bends."""

BLOCK_PAIRS = 4_000_000
"""About so many pairs of samples are looked at together: 32 MB an array."""


def blocks(count: int) -> Iterator[slice]:
    """Slices that cover `count` rows, each of about `BLOCK_PAIRS` pairs with all of them."""
    size = max(BLOCK_PAIRS // max(count, 1), 1)
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


def edges(line: np.ndarray, closed: bool) -> np.ndarray:
    """[segments, 2] float64: the vectors from each vertex to the next."""
    return np.roll(line, -1, axis=0) - line if closed else np.diff(line, axis=0)


def arc_length(line: np.ndarray, closed: bool) -> tuple[np.ndarray, float]:
    """Arc length [S] at each vertex, and the whole length: the sum of |Pᵢ₊₁ - Pᵢ|, the closing segment included."""
    steps = np.hypot(*edges(line, closed).T)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return total[: len(line)], float(total[-1])


def tangents(line: np.ndarray, closed: bool) -> np.ndarray:
    """[S, 2] unit vectors along (Pᵢ₊₁ - Pᵢ₋₁), one-sided at the ends of an open line."""
    if closed:
        direction = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    else:
        inner = line[2:] - line[:-2]
        direction = np.concatenate([line[1:2] - line[:1], inner, line[-1:] - line[-2:-1]])
    return direction / np.hypot(*direction.T)[:, None]


def normals(tangent: np.ndarray) -> np.ndarray:
    """[S, 2] unit vectors to the left of the tangents [S, 2]."""
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def curvature(line: np.ndarray, closed: bool) -> np.ndarray:
    """[S] signed curvature in 1/m, positive where the line turns left; 0 at the ends of an open line.

    The circle through three successive vertices (Menger): κ = 2 (a × b) / (|a| |b| |a + b|), exact on a circle.
    """
    if closed:
        before, after = line - np.roll(line, 1, axis=0), np.roll(line, -1, axis=0) - line
    else:
        before, after = line[1:-1] - line[:-2], line[2:] - line[1:-1]
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    size = np.hypot(*before.T) * np.hypot(*after.T) * np.hypot(*(before + after).T)
    kappa = 2 * cross / np.maximum(size, 1e-12)
    return kappa if closed else np.concatenate([[0.0], kappa, [0.0]])


def turning(line: np.ndarray, closed: bool) -> np.ndarray:
    """[S] signed angle in radians by which the line turns left at each vertex; 0 at the ends of an open line."""
    step = edges(line, closed)
    heading = np.arctan2(step[:, 1], step[:, 0])
    before = np.roll(heading, 1) if closed else heading[:-1]
    after = heading if closed else heading[1:]
    turn = (after - before + np.pi) % (2 * np.pi) - np.pi
    return turn if closed else np.concatenate([[0.0], turn, [0.0]])


def bends(line: np.ndarray, closed: bool) -> np.ndarray:
    """Signed turning of each bend, in radians and in their order along the line.

    A bend is a maximal run of vertices with the same sign of curvature and a radius under `STRAIGHT_RADIUS_M`, after
    smoothing the line by a Gaussian of `BEND_SMOOTHING_M`. The vertices must be about evenly spaced.
    """
    length = arc_length(line, closed)[1]
    spacing = length / (len(line) if closed else len(line) - 1)
    smooth = gaussian_filter1d(line, BEND_SMOOTHING_M / spacing, axis=0, mode="wrap" if closed else "nearest")
    turn = turning(smooth, closed)
    sign = np.where(np.abs(turn) > spacing / STRAIGHT_RADIUS_M, np.sign(turn), 0.0)
    starts = np.flatnonzero(sign != np.roll(sign, 1))
    if len(starts) == 0:
        return np.array([turn.sum()]) if sign[0] != 0 else np.zeros(0)
    run = np.zeros(len(line), dtype=np.int64)
    run[starts] = 1
    run = (np.cumsum(run) - 1) % len(starts)
    total = np.bincount(run, weights=turn, minlength=len(starts))
    return total[sign[starts] != 0]


def bend_count(line: np.ndarray, closed: bool, over_deg: float = 30.0) -> int:
    """How many bends turn by more than `over_deg` in either direction."""
    return int(np.sum(np.abs(bends(line, closed)) > np.radians(over_deg)))


def self_crossings(line: np.ndarray, closed: bool) -> np.ndarray:
    """[K, 2] int: pairs (i, j), i < j, of segments that properly cross; segments that share a vertex never count.

    Two segments cross where the ends of each lie on different sides of the other (de Berg and others, 2008, 2.1).
    """
    start = line if closed else line[:-1]
    end = start + edges(line, closed)
    count = len(start)

    def side(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        along = (b - a)[:, None, :]
        to_point = p[None, :, :] - a[:, None, :]
        return along[..., 0] * to_point[..., 1] - along[..., 1] * to_point[..., 0]

    found = []
    for rows in blocks(count):
        separates = (side(start[rows], end[rows], start) > 0) != (side(start[rows], end[rows], end) > 0)
        separated = (side(start, end, start[rows]) > 0) != (side(start, end, end[rows]) > 0)
        later = np.arange(count)[None, :] >= np.arange(count)[rows, None] + 2
        found.append(np.argwhere(separates & separated.T & later) + np.array([rows.start, 0]))
    i, j = np.concatenate(found).T
    keep = ~((i == 0) & (j == count - 1)) if closed else np.ones(len(i), bool)
    return np.stack([i[keep], j[keep]], axis=1)


def arc_between(arc_m: np.ndarray, length_m: float, closed: bool, rows: slice = slice(None)) -> np.ndarray:
    """[S, S] the arc length from each vertex to each other one, the shorter way round on a closed line.

    `rows` chooses the vertices from which.
    """
    apart = np.abs(arc_m[rows, None] - arc_m[None, :])
    return np.minimum(apart, length_m - apart) if closed else apart


def distances(line: np.ndarray, rows: slice = slice(None)) -> np.ndarray:
    """[S, S] straight distances between all vertices; `rows` chooses those from which."""
    delta = line[rows, None, :] - line[None, :, :]
    return np.hypot(delta[..., 0], delta[..., 1])


def nearby(arc_m: np.ndarray, length_m: float, closed: bool, centre_m: float) -> np.ndarray:
    """[S] arc distance from the place `centre_m` on the line, the shorter way round."""
    apart = np.abs(arc_m - centre_m)
    return np.minimum(apart, length_m - apart) if closed else apart
