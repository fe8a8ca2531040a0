"""Geometry of polylines: arc length, tangents, curvature, bends and self-crossings.

Pure functions on polylines [S, 2] in metres. `closed` says whether the last vertex is joined to the first. Nothing here
knows of water.
"""

from collections.abc import Iterator

import numpy as np
import scipy

BEND_SMOOTHING_M = 4.0
"""Standard deviation of the Gaussian that smooths a line before its bends are counted."""
STRAIGHT_RADIUS_M = 40.0
"""A stretch with a larger radius of curvature counts as straight and separates bends."""

BLOCK_PAIRS = 4_000_000
"""Pairs of samples that are compared at a time: 32 MB per array."""


def blocks(count: int) -> Iterator[slice]:
    """Yield slices that cover `count` rows, so that each row block has about `BLOCK_PAIRS` pairs with all rows."""
    size = max(BLOCK_PAIRS // max(count, 1), 1)
    for first in range(0, count, size):
        yield slice(first, min(first + size, count))


def edges(line: np.ndarray, closed: bool) -> np.ndarray:
    """Return [segments, 2] float64 the vectors from each vertex to the next."""
    return np.roll(line, -1, axis=0) - line if closed else np.diff(line, axis=0)


def arc_length(line: np.ndarray, closed: bool) -> tuple[np.ndarray, float]:
    """Return the arc length [S] at each vertex and the total length, with the closing segment of a closed line."""
    steps = np.hypot(*edges(line, closed).T)
    total = np.concatenate([[0.0], np.cumsum(steps)])
    return total[: len(line)], float(total[-1])


def tangents(line: np.ndarray, closed: bool) -> np.ndarray:
    """Return [S, 2] unit vectors along Pᵢ₊₁ - Pᵢ₋₁, one-sided at the ends of an open line."""
    if closed:
        direction = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    else:
        inner = line[2:] - line[:-2]
        direction = np.concatenate([line[1:2] - line[:1], inner, line[-1:] - line[-2:-1]])
    return direction / np.hypot(*direction.T)[:, None]


def normals(tangent: np.ndarray) -> np.ndarray:
    """Return [S, 2] unit vectors to the left of the tangents [S, 2]."""
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


def curvature(line: np.ndarray, closed: bool) -> np.ndarray:
    """Return [S] the signed curvature in 1/m, positive in left turns; 0 at the ends of an open line.

    The curvature of the circle through three successive vertices (Menger): κ = 2 (a × b) / (|a| |b| |a + b|). It is
    exact on a circle.
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
    """Return [S] the signed left turn in radians at each vertex; 0 at the ends of an open line."""
    step = edges(line, closed)
    heading = np.arctan2(step[:, 1], step[:, 0])
    before = np.roll(heading, 1) if closed else heading[:-1]
    after = heading if closed else heading[1:]
    turn = (after - before + np.pi) % (2 * np.pi) - np.pi
    return turn if closed else np.concatenate([[0.0], turn, [0.0]])


def bends(line: np.ndarray, closed: bool) -> np.ndarray:
    """Return the signed turning of each bend in radians, in order along the line.

    A bend is a maximal run of vertices with the same sign of curvature and a radius under `STRAIGHT_RADIUS_M`, after
    smoothing the line by a Gaussian of `BEND_SMOOTHING_M`. The vertices must be about evenly spaced.
    """
    length = arc_length(line, closed)[1]
    spacing = length / (len(line) if closed else len(line) - 1)
    smooth = scipy.ndimage.gaussian_filter1d(
        line, BEND_SMOOTHING_M / spacing, axis=0, mode="wrap" if closed else "nearest"
    )
    turn = turning(smooth, closed)
    # Vertices of a straight stretch get sign 0, so that a run of equal signs is a bend or a straight.
    sign = np.where(np.abs(turn) > spacing / STRAIGHT_RADIUS_M, np.sign(turn), 0.0)
    starts = np.flatnonzero(sign != np.roll(sign, 1))  # the roll joins a bend across the end of a closed line
    if len(starts) == 0:
        return np.array([turn.sum()]) if sign[0] != 0 else np.zeros(0)
    run = np.zeros(len(line), dtype=np.int64)
    run[starts] = 1
    run = (np.cumsum(run) - 1) % len(starts)
    total = np.bincount(run, weights=turn, minlength=len(starts))
    return total[sign[starts] != 0]


def bend_count(line: np.ndarray, closed: bool, over_deg: float = 30.0) -> int:
    """Return the number of bends that turn by more than `over_deg` in either direction."""
    return int(np.sum(np.abs(bends(line, closed)) > np.radians(over_deg)))


def overlapping(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the pairs i < j of boxes that overlap or touch, as two arrays, about `BLOCK_PAIRS` candidates at a time.

    A box reaches from `low` [K, 2] to `high` [K, 2]. Candidates overlap along the axis on which the boxes are spread
    most: they follow each other in the order of their lower ends (sweep and prune; Cohen et al., 1995), so that few of
    all pairs are looked at on a line that leads somewhere.
    """
    axis = int(np.argmax(np.ptp(low, axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    place = np.arange(len(order))
    counts = np.searchsorted(low[order, axis], high[order, axis], side="right") - place - 1
    block = np.cumsum(counts) // BLOCK_PAIRS
    for rows in np.split(place, np.flatnonzero(np.diff(block)) + 1):
        one = np.repeat(rows, counts[rows])
        begin = np.cumsum(counts[rows]) - counts[rows]
        other = one + 1 + np.arange(len(one)) - np.repeat(begin, counts[rows])
        i, j = order[one], order[other]
        i, j = np.minimum(i, j), np.maximum(i, j)
        across = (low[i, 1 - axis] <= high[j, 1 - axis]) & (low[j, 1 - axis] <= high[i, 1 - axis])
        yield i[across], j[across]


def self_crossings(line: np.ndarray, closed: bool) -> np.ndarray:
    """Return [K, 2] int the pairs (i, j), i < j, of segments that cross, in order; segments that share a vertex never
    do.

    Two segments cross where the ends of each lie on different sides of the other (de Berg et al., 2008, section 2.1),
    and their boxes overlap: of segments on one straight line the sides are rounding noise.
    """
    start = line if closed else line[:-1]
    end = start + edges(line, closed)

    def side(a: np.ndarray, p: np.ndarray) -> np.ndarray:
        along, to_point = end[a] - start[a], p - start[a]
        return along[:, 0] * to_point[:, 1] - along[:, 1] * to_point[:, 0] > 0

    found = [np.zeros((0, 2), dtype=np.int64)]
    for i, j in overlapping(np.minimum(start, end), np.maximum(start, end)):
        apart = j >= i + 2
        if closed:
            apart &= (i > 0) | (j < len(start) - 1)
        i, j = i[apart], j[apart]
        cross = (side(i, start[j]) != side(i, end[j])) & (side(j, start[i]) != side(j, end[i]))
        found.append(np.stack([i[cross], j[cross]], axis=1))
    pairs = np.concatenate(found)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def arc_between(arc_m: np.ndarray, length_m: float, closed: bool, rows: slice = slice(None)) -> np.ndarray:
    """Return [S, S] the arc length between vertices, the shorter way round on a closed line.

    `rows` selects the first vertex of each pair.
    """
    return arc_apart(arc_m[rows, None], arc_m[None, :], length_m, closed)


def arc_apart(one_m: np.ndarray, other_m: np.ndarray | float, length_m: float, closed: bool) -> np.ndarray:
    """Return the arc length between positions on the line, element by element, the shorter way round on a closed
    line."""
    apart = np.abs(one_m - other_m)
    return np.minimum(apart, length_m - apart) if closed else apart


def distances(line: np.ndarray, rows: slice = slice(None)) -> np.ndarray:
    """Return [S, S] the straight distances between vertices; `rows` selects the first vertex of each pair."""
    delta = line[rows, None, :] - line[None, :, :]
    return np.hypot(delta[..., 0], delta[..., 1])


def arc_distance_from(arc_m: np.ndarray, length_m: float, closed: bool, centre_m: float) -> np.ndarray:
    """Return [S] the arc distance from the position `centre_m` on the line, the shorter way round on a closed line."""
    return arc_apart(arc_m, centre_m, length_m, closed)
