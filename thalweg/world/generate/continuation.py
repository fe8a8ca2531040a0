"""The channel of an open river beyond both ends of its course: it winds on until it leaves the map.

Only the terrain follows the continuation. The course, and with it starts, progress and every other rule, ends where it
did. Where no way out keeps clear of the river itself, the channel ends with the course, as in a pond.
"""

from collections.abc import Iterator

import numpy as np

from thalweg.world import geometry
from thalweg.world.generate.hydrology import MIN_INNER_BANK_M, MIN_LAND_M, make_river
from thalweg.world.record import Grid, River

WAVE_M = 75.0
"""Least length of a bend to either side and back."""
SWINGS = (0.75, 0.4, 0.0)
"""Greatest angles in radians by which the continuation swings to either side, in the order in which they are tried."""
TURNS = (0.0, 0.7, 1.4, 2.1)
"""Angles in radians by which it turns off from the end of the course altogether, in the same order."""
TURN_M = 45.0
"""Least length over which it turns off."""
LONGEST = 4.0
"""Greatest length of a continuation, in half perimeters of the map."""


def continued(river: River, grid: Grid, shape: tuple[int, int]) -> River:
    """Return the river [S] with its open ends continued to the edge of a map, [S + more]; a closed one as it is.

    Width, depth and level stay those of the end. The arc length begins at the start of the continuation.
    """
    if river.closed:
        return river
    after = way_out(river, grid, shape, river.position_m)
    # The second way keeps clear of the first one, too.
    back = _reversed(river)
    before = way_out(back, grid, shape, np.concatenate([back.position_m, after]))[::-1]
    counts = (len(before), len(after))
    profiles = (np.pad(values, counts, mode="edge") for values in (river.width_m, river.depth_m, river.level_m))
    return make_river(np.concatenate([before, river.position_m, after]), False, *profiles)


def way_out(river: River, grid: Grid, shape: tuple[int, int], keep: np.ndarray) -> np.ndarray:
    """Return points [K, 2] from beyond the last sample of a river [S] to outside the map; none where there is no way.

    keep [N, 2]: points from which the banks keep their distance, the river's own first.
    """
    low = np.array([grid.origin_x_m, grid.origin_y_m])
    high = low + grid.cell_m * np.array([shape[1] - 1, shape[0] - 1])
    width = float(river.width_m[-1])
    spacing = river.length_m / river.segments
    steps = int(LONGEST * (high - low).sum() / spacing)
    direction = river.position_m[-1] - river.position_m[-2]
    heading = float(np.arctan2(direction[1], direction[0]))
    widest = np.pad(river.width_m, (0, len(keep) - len(river.width_m)), mode="edge")
    for bends in _headings(spacing * (np.arange(steps) + 0.5), width):
        ways = []
        for bend in bends:
            step = spacing * np.stack([np.cos(heading + bend), np.sin(heading + bend)], axis=1)
            line = river.position_m[-1] + np.cumsum(step, axis=0)
            # Its round end lies outside the map, too.
            outside = np.any((line < low - 0.5 * width) | (line > high + 0.5 * width), axis=1)
            line = line[: int(np.argmax(outside)) + 1]
            if outside.any() and _is_clear(line, spacing, width, keep, widest, len(river.position_m)):
                ways.append(line)
        if ways:
            # The shorter of two mirror images leaves the map more squarely.
            return min(ways, key=len)
    return np.zeros((0, 2))


def _headings(arc_m: np.ndarray, width_m: float) -> Iterator[list[np.ndarray]]:
    """Yield the headings [K] of each way to be tried, and of its mirror image, in radians from the course's end."""
    # A bend's inner bank needs a radius: the greatest curvature is the angle times 2 pi over the wave's length.
    tightest = 0.5 * width_m + 2 * MIN_INNER_BANK_M
    for turn in TURNS:
        length = max(TURN_M, 1.5 * abs(turn) * tightest)
        t = np.clip(arc_m / length, 0.0, 1.0)
        turned = turn * t * t * (3 - 2 * t)
        for swing in SWINGS:
            wave = max(WAVE_M, 4 * np.pi * swing * tightest)
            swung = swing * np.sin(2 * np.pi * arc_m / wave)
            yield [turned + swung, -turned - swung]


def _is_clear(
    line: np.ndarray, spacing: float, width: float, keep: np.ndarray, widest: np.ndarray, samples: int
) -> bool:
    """Return whether a way [K, 2] leaves `MIN_LAND_M` to points [N, 2] with their widths, and does not cross itself.

    The first `samples` of the points are those of the course, from whose end the way begins.
    """
    if len(geometry.self_crossings(line, closed=False)):
        return False
    along = spacing * (np.arange(len(line)) + 1)
    before = np.where(np.arange(len(keep)) < samples, spacing * (samples - 1 - np.arange(len(keep))), np.inf)
    for rows in geometry.blocks(max(len(line), len(keep))):
        apart = np.hypot(*np.moveaxis(line[rows, None, :] - keep[None, :, :], -1, 0))
        needed = 0.5 * (width + widest[None, :]) + MIN_LAND_M
        # As between two arms of a course: the way along the line is longer than a half circle over that distance.
        other = along[rows, None] + before[None, :] > 1.6 * needed
        if np.any(other & (apart < needed)):
            return False
    return True


def _reversed(river: River) -> River:
    """Return an open river from its last sample to its first."""
    profiles = (values[::-1] for values in (river.position_m, river.width_m, river.depth_m, river.level_m))
    position, width, depth, level = profiles
    return make_river(position, False, width, depth, level)
