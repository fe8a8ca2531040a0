"""How wide, deep and high is the water along the course?

Profiles per river sample, drawn at random within the level's limits and held below what the shape of the line allows:
a bank must not fold on the inside of a bend nor come near another arm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from thalweg.world import geometry
from thalweg.world.levels import Level
from thalweg.world.record import River

LAND_BETWEEN_M = 7.0
"""Least land between the banks of two arms of a generated river."""
INNER_BANK_M = 2.5
"""Least radius of the inner bank of a bend of a generated river."""
WIDTH_SLOPE = 0.55
"""Largest change of width per metre along the course."""
STEEPEST_BED = 0.24
"""Greatest depth as a share of the width."""
RAPID_M = 12.0
"""Length of the rapid in which the level is regained."""


@dataclass(frozen=True)
class Line:
    """A closed centre line with what is often asked of it."""

    position_m: np.ndarray
    """[S, 2] float64."""
    arc_m: np.ndarray
    """[S] float64."""
    length_m: float
    """Whole length of the loop."""
    tangent: np.ndarray
    """[S, 2] float64."""
    curvature: np.ndarray
    """[S] float64 1/m, lightly smoothed, positive to the left."""
    other_arm_m: np.ndarray
    """[S] float64, distance to the nearest part of the course that is another arm."""

    def from_place(self, sample: int) -> np.ndarray:
        """[S] arc distance from a sample, the shorter way round."""
        return geometry.nearby(self.arc_m, self.length_m, True, float(self.arc_m[sample]))

    def tightest_near(self, reach_m: float) -> np.ndarray:
        """[S] the largest curvature in 1/m within `reach_m` up or down the course."""
        size = 2 * round(reach_m * len(self.arc_m) / self.length_m) + 1
        return -minimum_filter1d(-np.abs(self.curvature), size, mode="wrap")


def describe(position_m: np.ndarray) -> Line:
    """The record of a closed line [S, 2] of evenly spaced vertices."""
    arc, length = geometry.arc_length(position_m, True)
    kappa = gaussian_filter1d(geometry.curvature(position_m, True), 1.0, mode="wrap")
    other = np.empty(len(arc))
    for rows in geometry.blocks(len(arc)):
        apart = geometry.distances(position_m, rows)
        is_other = geometry.arc_between(arc, length, True, rows) > 1.6 * apart
        other[rows] = np.where(is_other, apart, np.inf).min(axis=1)
    return Line(position_m, arc, length, geometry.tangents(position_m, True), kappa, other)


def width_limit(line: Line, level: Level) -> np.ndarray:
    """[S] metres: the widest the water may be at each sample."""
    inner = 2 * (1 / np.maximum(line.tightest_near(5.0), 1e-6) - INNER_BANK_M)
    return np.minimum(np.minimum(inner, line.other_arm_m - LAND_BETWEEN_M), level.width_m[1])


def smooth_noise(line: Line, scale_m: float, rng: np.random.Generator) -> np.ndarray:
    """[S] periodic noise along the course, from 0 to 1, both reached."""
    spacing = line.length_m / len(line.arc_m)
    noise = gaussian_filter1d(rng.standard_normal(len(line.arc_m)), scale_m / spacing, mode="wrap")
    return (noise - noise.min()) / (noise.max() - noise.min())


def widths(
    line: Line,
    level: Level,
    wide: list[tuple[int, float]],
    narrow: list[tuple[int, float]],
    rng: np.random.Generator,
) -> np.ndarray:
    """[S] metres: the width along the course.

    `wide` lists samples with the length over which the river widens there (the first one to the level's utmost);
    `narrow` lists samples with the width that must not be passed there.
    """
    low, high = level.width_m
    limit = width_limit(line, level)
    noise = smooth_noise(line, 9.0, rng)
    usual = 1.0 if not wide else 0.38
    width = low + (high - low) * usual * (noise if not wide else noise**1.3)
    for i, (sample, reach) in enumerate(wide):
        target = high if i == 0 else min(limit[sample], rng.uniform(0.6, 0.95) * high)
        width = np.maximum(width, target - WIDTH_SLOPE * np.maximum(line.from_place(sample) - reach, 0.0))
    for sample, most in narrow:
        width = np.minimum(width, most + 0.4 * np.maximum(line.from_place(sample) - 4.0, 0.0))
    width = np.minimum(width, limit)
    reached = [
        (width[None, :] + WIDTH_SLOPE * geometry.arc_between(line.arc_m, line.length_m, True, rows)).min(axis=1)
        for rows in geometry.blocks(len(width))
    ]
    width = np.concatenate(reached)
    spacing = line.length_m / len(line.arc_m)
    width = gaussian_filter1d(width, 2.0 / spacing, mode="wrap")
    return np.clip(np.minimum(width, limit), low, high)


def uses_range(width_m: np.ndarray, level: Level) -> bool:
    """Whether a river comes near both the narrowest and the widest that its level allows."""
    low, high = level.width_m
    return bool(width_m.min() <= low + 0.06 * (high - low) and width_m.max() >= high - 0.1 * (high - low))


def depths(line: Line, width_m: np.ndarray, level: Level, rng: np.random.Generator) -> np.ndarray:
    """[S] metres on the centre line: pools in bends and narrows, shallows where the river is wide."""
    bend = gaussian_filter1d(np.abs(line.curvature), 4.0, mode="wrap")
    shape = 1.2 * smooth_noise(line, 7.0, rng) + 0.8 * bend / bend.max() - 0.6 * width_m / width_m.max()
    shape = gaussian_filter1d(shape, 2.0, mode="wrap")
    shape = 2 * (shape - shape.min()) / (shape.max() - shape.min()) - 1
    return np.minimum(level.depth_m * (1 + level.depth_variation * shape), STEEPEST_BED * width_m)


def water_levels(line: Line, level: Level, rapid: int) -> np.ndarray:
    """[S] metres: falls evenly along the course and is regained in the rapid that starts at sample `rapid`."""
    if level.fall_m == 0:
        return np.zeros(len(line.arc_m))
    since = (line.arc_m - line.arc_m[rapid]) % line.length_m
    t = np.clip(since / RAPID_M, 0.0, 1.0)
    fall = np.clip((since - RAPID_M) / (line.length_m - RAPID_M), 0.0, 1.0)
    return level.fall_m * (t * t * (3 - 2 * t) - fall)


def river_of(
    position_m: np.ndarray, closed: bool, width_m: np.ndarray, depth_m: np.ndarray, level_m: np.ndarray
) -> River:
    """The river with these profiles [S] on a line [S, 2]."""
    arc, length = geometry.arc_length(position_m, closed)
    tangent = geometry.tangents(position_m, closed)
    return River(closed, position_m, arc, length, tangent, width_m, depth_m, level_m)
