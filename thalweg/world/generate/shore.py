"""The distance of each map node from the water's edge, and the point of the course that it belongs to.

The water of the course is everything within half the width of the centre line, measured as the rules measure it: at the
nearest point of the line, on the nearest arm. Side channels are unions of discs along a line.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from thalweg.core.compute.jit import kernel
from thalweg.core.compute.threads import run_in_threads
from thalweg.world.record import Grid, River

f4 = np.float32
BLOCK = 16
"""Nodes along a side of the blocks that share a list of candidate segments."""
WINDOW_M = 13.0
"""Distance up and down an arm within which the nearest point is searched."""


class Shore(NamedTuple):
    """Maps [GY, GX] float32 of the position of each node relative to the course."""

    edge_m: np.ndarray
    """Distance from the bank of the course, negative in its water. It is exact up to 1 m from the bank on land; from
    2.5 m on it is smooth between arms."""
    across: np.ndarray
    """Lateral offset over half the width, positive to the left; ±1 is the bank. Valid within 2.5 m of it."""
    course_index: np.ndarray
    """Nearest point of the course: its sample index plus the share of the segment after that sample."""


@kernel(fastmath=False)
def _block_candidates(centre_x, centre_y, slack, start, step, half, found):
    """Fill `found` with the segments that may be nearest to some node of a block; returns their number."""
    # The distance from the bank at the middle of a segment bounds that of all its points up to `slack`.
    count = len(start)
    best = 1e30
    for j in range(count):
        dx = centre_x - (start[j, 0] + 0.5 * step[j, 0])
        dy = centre_y - (start[j, 1] + 0.5 * step[j, 1])
        reach = np.sqrt(dx * dx + dy * dy) - 0.5 * (half[j, 0] + half[j, 1])
        if reach < best:
            best = reach
    number = 0
    for j in range(count):
        dx = centre_x - (start[j, 0] + 0.5 * step[j, 0])
        dy = centre_y - (start[j, 1] + 0.5 * step[j, 1])
        if np.sqrt(dx * dx + dy * dy) - 0.5 * (half[j, 0] + half[j, 1]) <= best + slack:
            found[number] = j
            number += 1
    return number


@kernel(fastmath=False)
def _foot(x, y, start, step, j):
    """Return the share along segment j of the nearest point to (x, y), and its distance."""
    dx = x - start[j, 0]
    dy = y - start[j, 1]
    t = (dx * step[j, 0] + dy * step[j, 1]) / (step[j, 0] * step[j, 0] + step[j, 1] * step[j, 1])
    t = min(max(t, 0.0), 1.0)
    dx -= t * step[j, 0]
    dy -= t * step[j, 1]
    return t, np.sqrt(dx * dx + dy * dy)


@kernel(fastmath=False)
def _nearest_on_arm(x, y, start, step, arm, window, closed):
    """Return (segment, share, distance) of the nearest point within `window` segments of segment `arm`."""
    count = len(start)
    nearest, share, distance = arm, 0.0, 1e30
    for k in range(arm - window, arm + window + 1):
        if not closed and (k < 0 or k >= count):
            continue
        t, d = _foot(x, y, start, step, k % count)
        if d < distance:
            nearest, share, distance = k % count, t, d
    return nearest, share, distance


@kernel(fastmath=False)
def _measure_node(x, y, start, step, half, closed, window, found, number):
    """Return (edge, across, course_index) of a node.

    The first `number` entries of `found` are the candidate segments.
    """
    # The smallest distance from a bank, interpolating the width at the foot point, selects the arm.
    envelope = 1e30
    arm = 0
    for k in range(number):
        t, d = _foot(x, y, start, step, found[k])
        reach = d - (half[found[k], 0] + t * (half[found[k], 1] - half[found[k], 0]))
        if reach < envelope:
            envelope = reach
            arm = found[k]
    # The rules take the nearest point of the line and its width, which may differ from the point above.
    # Far from the water the difference does not matter, so the search is short there.
    nearest, share, distance = _nearest_on_arm(x, y, start, step, arm, window if envelope < 4.0 else 1, closed)
    width = half[nearest, 0] + share * (half[nearest, 1] - half[nearest, 0])
    exact = distance - width
    # Exact near the bank; further out the envelope, which has no jumps between arms.
    blend = min(max((exact - 1.0) / 1.5, 0.0), 1.0)
    blend = blend * blend * (3.0 - 2.0 * blend)
    # The sign of the cross product says on which side of the segment the node lies.
    turn = step[nearest, 0] * (y - start[nearest, 1]) - step[nearest, 1] * (x - start[nearest, 0])
    across = distance / width if turn >= 0.0 else -distance / width
    return exact + blend * (envelope - exact), across, nearest + share


@kernel(fastmath=False)
def _measure(origin_x, origin_y, cell, course, closed, window, slack, maps, first, last):
    """Fill the maps of `Shore` in the bands of `BLOCK` rows from first to last.

    course: start, step [segments, 2] and half [segments, 2], the half widths at both ends, all float64.
    """
    start, step, half = course
    edge, across, course_index = maps
    rows, columns = edge.shape
    found = np.empty(len(start), np.int64)
    for band in range(first, last):
        top = band * BLOCK
        for left in range(0, columns, BLOCK):
            middle_x, middle_y = (
                origin_x + (left + 0.5 * (BLOCK - 1)) * cell,
                origin_y + (top + 0.5 * (BLOCK - 1)) * cell,
            )
            number = _block_candidates(middle_x, middle_y, slack, start, step, half, found)
            for i in range(top, min(top + BLOCK, rows)):
                for j in range(left, min(left + BLOCK, columns)):
                    node = _measure_node(
                        origin_x + j * cell, origin_y + i * cell, start, step, half, closed, window, found, number
                    )
                    edge[i, j], across[i, j], course_index[i, j] = node


def measure(grid: Grid, shape: tuple[int, int], river: River) -> Shore:
    """Return the maps of `Shore` for the nodes of a grid with this shape."""
    segments = river.segments
    start = np.ascontiguousarray(river.position_m[:segments])
    step = np.ascontiguousarray(np.roll(river.position_m, -1, axis=0)[:segments] - start)
    half = np.stack([river.width_m, np.roll(river.width_m, -1)], axis=1)[:segments] / 2
    longest = float(np.hypot(*step.T).max())
    uneven = float(np.abs(half[:, 1] - half[:, 0]).max())
    # Half the diagonal of a block on either side, plus what lengths and widths of segments add.
    slack = BLOCK * grid.cell_m * np.sqrt(2.0) + longest + uneven
    window = int(np.ceil(WINDOW_M / (river.length_m / segments)))
    maps = Shore(*(np.zeros(shape, np.float32) for _ in range(3)))
    bands = partial(
        _measure,
        grid.origin_x_m,
        grid.origin_y_m,
        grid.cell_m,
        (start, step, half),
        river.closed,
        min(window, segments // 2),
        slack,
        tuple(maps),
    )
    run_in_threads(-(-shape[0] // BLOCK), bands)
    return maps


@kernel(fastmath=False)
def _measure_discs(origin_x, origin_y, cell, line, half, edge, width):
    """Lower `edge` to the distance from a union of discs along a line [K, 2]; `width` becomes the half width there."""
    rows, columns = edge.shape
    for k in range(len(line) - 1):
        step_x = line[k + 1, 0] - line[k, 0]
        step_y = line[k + 1, 1] - line[k, 1]
        length = step_x * step_x + step_y * step_y
        for i in range(rows):
            y = origin_y + i * cell - line[k, 1]
            for j in range(columns):
                x = origin_x + j * cell - line[k, 0]
                t = min(max((x * step_x + y * step_y) / length, 0.0), 1.0)
                w = half[k] + t * (half[k + 1] - half[k])
                d = np.sqrt((x - t * step_x) ** 2 + (y - t * step_y) ** 2) - w
                if d < edge[i, j]:
                    edge[i, j] = d
                    width[i, j] = w


def measure_discs(
    grid: Grid, shape: tuple[int, int], line: np.ndarray, width_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance from the edge of water along a line [K, 2] and its half width, in metres, both [GY, GX]."""
    edge, half = np.full(shape, 1e6, np.float32), np.ones(shape, np.float32)
    _measure_discs(grid.origin_x_m, grid.origin_y_m, grid.cell_m, line, width_m / 2, edge, half)
    return edge, half


@kernel(fastmath=False)
def _weighted_levels(x, y, position, half, level, out):
    """Fill `out` with Shepard's mean (1968) of the levels, weighted by 1 / (distance from the bank)⁴."""
    for i in range(len(y)):
        for j in range(len(x)):
            total = 0.0
            weight = 0.0
            for k in range(len(level)):
                dx = x[j] - position[k, 0]
                dy = y[i] - position[k, 1]
                away = max(np.sqrt(dx * dx + dy * dy) - half[k], 0.5)
                w = 1.0 / (away * away * away * away)
                weight += w
                total += w * level[k]
            out[i, j] = total / weight


def valley_levels(x: np.ndarray, y: np.ndarray, river: River) -> np.ndarray:
    """Return [len(y), len(x)] metres: the water level of the river continued under the land, smooth between arms."""
    out = np.empty((len(y), len(x)))
    _weighted_levels(x, y, river.position_m, river.width_m / 2, river.level_m, out)
    return out
