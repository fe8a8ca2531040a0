"""Profiles of width, depth and water level along a course.

They are drawn at random within the level's limits and below what the shape of the line allows: a bank must neither fold
on the inside of a bend nor come near another arm.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.world import geometry
from thalweg.world.levels import Level
from thalweg.world.record import River

MIN_LAND_M = 7.0
"""Minimum land between the banks of two arms of a generated river."""
MIN_INNER_BANK_M = 2.5
"""Minimum radius of the inner bank of a bend of a generated river."""
MAX_WIDTH_SLOPE = 0.55
"""Maximum change of width per metre along the course."""
MAX_DEPTH_TO_WIDTH = 0.24
"""Maximum depth as a share of the width."""
RAPID_M = 12.0
"""Length of the rapid in which the water level is regained."""


@dataclass(frozen=True)
class Line:
    """A closed centre line with its derived quantities."""

    position_m: np.ndarray
    """[S, 2] float64."""
    arc_m: np.ndarray
    """[S] float64."""
    length_m: float
    """Length of the loop."""
    tangent: np.ndarray
    """[S, 2] float64."""
    curvature: np.ndarray
    """[S] float64 in 1/m, lightly smoothed, positive in left turns."""
    other_arm_distance_m: np.ndarray
    """[S] float64, distance to the nearest sample that belongs to another arm."""

    def arc_distance_from(self, sample: int) -> np.ndarray:
        """Return [S] the arc distance from a sample, the shorter way round."""
        return geometry.arc_distance_from(self.arc_m, self.length_m, True, float(self.arc_m[sample]))

    def max_curvature_within(self, reach_m: float) -> np.ndarray:
        """Return [S] the largest absolute curvature in 1/m within `reach_m` up or down the course."""
        size = 2 * round(reach_m * len(self.arc_m) / self.length_m) + 1
        return -scipy.ndimage.minimum_filter1d(-np.abs(self.curvature), size, mode="wrap")


def describe_line(position_m: np.ndarray) -> Line:
    """Return the `Line` of a closed line [S, 2] of evenly spaced vertices."""
    arc, length = geometry.arc_length(position_m, True)
    kappa = scipy.ndimage.gaussian_filter1d(geometry.curvature(position_m, True), 1.0, mode="wrap")
    other = np.empty(len(arc))
    for rows in geometry.blocks(len(arc)):
        apart = geometry.distances(position_m, rows)
        # Another arm: the way along the line is longer than a half circle over the straight distance.
        is_other = geometry.arc_between(arc, length, True, rows) > 1.6 * apart
        other[rows] = np.where(is_other, apart, np.inf).min(axis=1)
    return Line(position_m, arc, length, geometry.tangents(position_m, True), kappa, other)


def width_limit(line: Line, level: Level) -> np.ndarray:
    """Return [S] the maximum width of the water in metres at each sample."""
    inner = 2 * (1 / np.maximum(line.max_curvature_within(5.0), 1e-6) - MIN_INNER_BANK_M)
    return np.minimum(np.minimum(inner, line.other_arm_distance_m - MIN_LAND_M), level.width_m[1])


def smooth_noise(line: Line, scale_m: float, rng: np.random.Generator) -> np.ndarray:
    """Return [S] periodic noise along the course with minimum 0 and maximum 1."""
    spacing = line.length_m / len(line.arc_m)
    noise = scipy.ndimage.gaussian_filter1d(rng.standard_normal(len(line.arc_m)), scale_m / spacing, mode="wrap")
    return (noise - noise.min()) / (noise.max() - noise.min())


def widths(
    line: Line,
    level: Level,
    wide: list[tuple[int, float]],
    narrow: list[tuple[int, float]],
    rng: np.random.Generator,
) -> np.ndarray:
    """Return [S] the width along the course in metres.

    `wide` lists samples with the half length over which the river widens there; the first widens to the level's
    maximum. `narrow` lists samples with the maximum width there.
    """
    low, high = level.width_m
    limit = width_limit(line, level)
    noise = smooth_noise(line, 9.0, rng)
    usual = 1.0 if not wide else 0.38
    width = low + (high - low) * usual * (noise if not wide else noise**1.3)
    for i, (sample, reach) in enumerate(wide):
        target = high if i == 0 else min(limit[sample], rng.uniform(0.6, 0.95) * high)
        width = np.maximum(width, target - MAX_WIDTH_SLOPE * np.maximum(line.arc_distance_from(sample) - reach, 0.0))
    for sample, most in narrow:
        width = np.minimum(width, most + 0.4 * np.maximum(line.arc_distance_from(sample) - 4.0, 0.0))
    width = np.minimum(width, limit)
    # The lower envelope of cones of slope MAX_WIDTH_SLOPE limits how fast the width changes.
    envelope = [
        (width[None, :] + MAX_WIDTH_SLOPE * geometry.arc_between(line.arc_m, line.length_m, True, rows)).min(axis=1)
        for rows in geometry.blocks(len(width))
    ]
    width = np.concatenate(envelope)
    spacing = line.length_m / len(line.arc_m)
    width = scipy.ndimage.gaussian_filter1d(width, 2.0 / spacing, mode="wrap")
    return np.clip(np.minimum(width, limit), low, high)


def spans_width_range(width_m: np.ndarray, level: Level) -> bool:
    """Return whether a river comes near both the minimum and the maximum width of its level."""
    low, high = level.width_m
    return bool(width_m.min() <= low + 0.06 * (high - low) and width_m.max() >= high - 0.1 * (high - low))


def depths(line: Line, width_m: np.ndarray, level: Level, rng: np.random.Generator) -> np.ndarray:
    """Return [S] the depth in metres on the centre line: pools in bends and narrows, shallows in wide reaches."""
    bend = scipy.ndimage.gaussian_filter1d(np.abs(line.curvature), 4.0, mode="wrap")
    shape = 1.2 * smooth_noise(line, 7.0, rng) + 0.8 * bend / bend.max() - 0.6 * width_m / width_m.max()
    shape = scipy.ndimage.gaussian_filter1d(shape, 2.0, mode="wrap")
    shape = 2 * (shape - shape.min()) / (shape.max() - shape.min()) - 1
    return np.minimum(level.depth_m * (1 + level.depth_variation * shape), MAX_DEPTH_TO_WIDTH * width_m)


def water_levels(line: Line, level: Level, rapid: int) -> np.ndarray:
    """Return [S] the water level in metres: an even fall, regained in the rapid that starts at sample `rapid`."""
    if level.fall_m == 0:
        return np.zeros(len(line.arc_m))
    since = (line.arc_m - line.arc_m[rapid]) % line.length_m
    t = np.clip(since / RAPID_M, 0.0, 1.0)
    fall = np.clip((since - RAPID_M) / (line.length_m - RAPID_M), 0.0, 1.0)
    return level.fall_m * (t * t * (3 - 2 * t) - fall)


def make_river(
    position_m: np.ndarray, closed: bool, width_m: np.ndarray, depth_m: np.ndarray, level_m: np.ndarray
) -> River:
    """Return the river with these profiles [S] on a line [S, 2]."""
    arc, length = geometry.arc_length(position_m, closed)
    tangent = geometry.tangents(position_m, closed)
    return River(closed, position_m, arc, length, tangent, width_m, depth_m, level_m)
