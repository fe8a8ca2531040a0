"""The plan of a river: its course and the positions of islands, bridges and side channels, before any terrain.

Lines are drawn until one has room for everything the level asks for: straight narrow positions for bridges, wide ones
for islands, space for side channels. Each attempt has its own random stream, so a level and a seed always give the same
plan.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from thalweg.world import bridges, islands
from thalweg.world import validation as checks
from thalweg.world.banks import check_banks
from thalweg.world.errors import WorldError
from thalweg.world.generate import hydrology, meander, side_channels
from thalweg.world.generate.hydrology import Line
from thalweg.world.generate.side_channels import Branch
from thalweg.world.levels import Level
from thalweg.world.record import River

ATTEMPTS = 3000
"""Number of draws after which a level counts as impossible; the built-in levels need about a hundred."""
EXTENT_M = 140.0
"""Side of the square that a generated course fits in; it grows in proportion for a longer course."""
EXTENT_COURSE_M = 425.0
"""Length above which the square grows."""
WIDE_REACH_M = 3.0
"""Half length of a wide position before the banks narrow."""


@dataclass(frozen=True)
class Plan:
    """The course and everything in or beside it."""

    river: River
    islands: np.ndarray
    """[I, 5] as in `World.islands`."""
    bridges: np.ndarray
    """[B, 11] as in `World.bridges`."""
    branches: tuple[Branch, ...]
    """Tributaries first, then ponds."""


def random_stream(level: Level, seed: int, purpose: int) -> np.random.Generator:
    """Return the random stream of one purpose of one world; different purposes never share numbers."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([level.key, seed, purpose])))


def plan(level: Level, seed: int) -> Plan:
    """Return the validated plan of a level and a seed >= 0.

    Raises `WorldError` for a level that cannot be met, and for banks that are not on the course.
    """
    for attempt in range(ATTEMPTS):
        rng = random_stream(level, seed, 1000 + attempt)
        line = draw_course(level, rng)
        planned = place_features(level, line, rng) if line is not None else None
        if planned is None:
            continue
        try:
            checks.check_world(planned.river, planned.islands, planned.bridges)
            checks.check_arms(planned.river, hydrology.MIN_LAND_M - 1.0)
        except WorldError:
            continue
        check_banks(level.banks, planned.river.length_m, planned.river.closed)
        return planned
    raise WorldError(f"no river of level {level.name!r} was found for seed {seed} in {ATTEMPTS} attempts")


def draw_course(level: Level, rng: np.random.Generator) -> Line | None:
    """Return a random closed line with room for the level's narrowest river, or None if the draw failed."""
    position = meander.draw_line(level, rng)
    if position is None or np.ptp(position, axis=0).max() > max(EXTENT_M * level.length_m / EXTENT_COURSE_M, EXTENT_M):
        return None
    line = hydrology.describe_line(position)
    limit = hydrology.width_limit(line, level)
    if limit.min() < level.width_m[0] + 0.3 or limit.max() < level.width_m[1]:
        return None
    return line


def choose_samples(
    allowed: np.ndarray,
    line: Line,
    occupied: list[tuple[int, float]],
    count: int,
    half_extent_m: float,
    rng: np.random.Generator,
) -> list[int]:
    """Return up to `count` random samples among `allowed` [S] bool, clear of `occupied` and of one another.

    Each new sample occupies `half_extent_m` metres of arc on either side; each entry of `occupied` is a sample with the
    same.
    """
    chosen: list[int] = []
    for sample in rng.permutation(np.flatnonzero(allowed)):
        if len(chosen) == count:
            break
        away = line.arc_distance_from(int(sample))
        blocked = occupied + [(c, half_extent_m) for c in chosen]
        if all(away[other] >= reach + half_extent_m for other, reach in blocked):
            chosen.append(int(sample))
    return chosen


@dataclass(frozen=True)
class FeatureSamples:
    """The samples of the course at which features are placed."""

    rapid: int | None
    """Middle of the rapid."""
    islands: list[int]
    """Wide positions: for islands, and on a level without islands one for its maximum width."""
    bridges: list[int]
    """Straight positions."""
    occupied: list[tuple[int, float]]
    """All of them, each with the arc length in metres that it occupies on either side."""


def choose_feature_samples(level: Level, line: Line, rng: np.random.Generator) -> FeatureSamples | None:
    """Return samples for rapid, islands and bridges, clear of one another; None if the line has too few."""
    limit = hydrology.width_limit(line, level)
    low, high = level.width_m
    occupied: list[tuple[int, float]] = []
    rapid: list[int] = []
    if level.fall_m > 0:
        rapid = choose_samples(
            (line.max_curvature_within(9.0) < 1 / 22.0) & (limit > low + 2), line, occupied, 1, 9.0, rng
        )
        if not rapid:
            return None
        occupied.append((rapid[0], 9.0))

    roomy = scipy.ndimage.minimum_filter1d(limit, 11, mode="wrap")
    wide = choose_samples((roomy >= high) & (line.max_curvature_within(5.0) < 1 / 14.0), line, occupied, 1, 13.0, rng)
    if not wide:
        return None
    occupied.append((wide[0], 13.0))
    if level.islands > 1:
        spots = (roomy > max(9.0, 0.5 * high)) & (line.max_curvature_within(5.0) < 1 / 13.0)
        wide += choose_samples(spots, line, occupied, level.islands - 1, 10.5, rng)
        occupied += [(sample, 10.5) for sample in wide[1:]]

    spots = (line.max_curvature_within(5.0) < 1 / 28.0) & (line.other_arm_distance_m > low + 24.0)
    crossings = choose_samples(spots, line, occupied, level.bridges, 11.0, rng)
    occupied += [(sample, 11.0) for sample in crossings]
    if len(wide) < max(level.islands, 1) or len(crossings) < level.bridges:
        return None
    return FeatureSamples(rapid[0] if rapid else None, wide, crossings, occupied)


def draw_river(level: Level, line: Line, samples: FeatureSamples, rng: np.random.Generator) -> River | None:
    """Return the river on a line, wide and narrow where its features need it; None if it misses its width range."""
    low, high = level.width_m
    narrow = [(sample, low + rng.uniform(0.0, 0.3) * (high - low)) for sample in samples.bridges]
    narrowest = choose_samples(np.ones(level.samples, bool), line, samples.occupied, 1, 8.0, rng)
    if not narrowest and not samples.bridges:
        return None
    narrow.append(((narrowest or samples.bridges)[0], low))
    rapid = 0
    if samples.rapid is not None:
        narrow.append((samples.rapid, low + 0.35 * (high - low)))
        rapid = (samples.rapid - round(hydrology.RAPID_M / 2 * level.samples / line.length_m)) % level.samples
    width = hydrology.widths(line, level, [(sample, WIDE_REACH_M) for sample in samples.islands], narrow, rng)
    if not hydrology.spans_width_range(width, level):
        return None
    depth = hydrology.depths(line, width, level, rng)
    return hydrology.make_river(line.position_m, True, width, depth, hydrology.water_levels(line, level, rapid))


def place_features(level: Level, line: Line, rng: np.random.Generator) -> Plan | None:
    """Return the plan of a line with all its features, or None if one does not fit."""
    samples = choose_feature_samples(level, line, rng)
    river = draw_river(level, line, samples, rng) if samples is not None else None
    if samples is None or river is None:
        return None
    position, tangent, width, water = river.position_m, river.tangent, river.width_m, river.level_m
    island_rows = [
        islands.random_island(position[i], tangent[i], float(width[i]), float(line.curvature[i]), rng)
        for i in samples.islands[: level.islands]
    ]
    bridge_rows = [
        bridges.bridge_across(position[i], tangent[i], float(width[i]), float(water[i]), rng) for i in samples.bridges
    ]
    if any(row is None or not fits_channel(row, river) for row in island_rows):
        return None
    bridge_array = np.array(bridge_rows, dtype=np.float64).reshape(-1, 11)
    branches = _draw_side_channels(level, line, river, samples.occupied, bridge_array, rng)
    if branches is None:
        return None
    island_array = np.array(island_rows, dtype=np.float64).reshape(-1, 5)
    return Plan(river, island_array, bridge_array, tuple(branches))


def fits_channel(row: np.ndarray, river: River) -> bool:
    """Return whether an island keeps its distance from both banks and leaves a wide enough arm beside it."""
    near = np.hypot(*(river.position_m - row[:2]).T) < 25.0
    start = river.position_m[near]
    gap = islands.outline(row)[:, None, :] - start[None, :, :]
    off = np.hypot(gap[..., 0], gap[..., 1])
    nearest = np.argmin(off, axis=1)
    if np.any(river.width_m[near][nearest] / 2 - off.min(axis=1) < islands.MIN_BANK_GAP_M - 0.3):
        return False
    gaps = checks.widest_free_gaps(river, row[None], 0.0)[near]
    return bool(np.all(gaps[:, 1] - gaps[:, 0] >= np.minimum(islands.MIN_ARM_M - 0.2, river.width_m[near] - 0.2)))


def _draw_side_channels(
    level: Level,
    line: Line,
    river: River,
    occupied: list[tuple[int, float]],
    bridge_rows: np.ndarray,
    rng: np.random.Generator,
) -> list[Branch] | None:
    """Return the tributaries and ponds of a level; None if a tributary does not fit."""
    branches: list[Branch] = []
    occupied = list(occupied)
    ends = np.array(
        [
            [b[0] + k * np.cos(b[2]) * b[3] / 2, b[1] + k * np.sin(b[2]) * b[3] / 2]
            for b in bridge_rows
            for k in (-2.0, -1.0, 1.0, 2.0)
        ]
    ).reshape(-1, 2)
    for _ in range(level.tributaries):
        mouths = choose_samples(line.max_curvature_within(3.0) < 1 / 12.0, line, occupied, 6, 6.0, rng)
        for mouth in mouths:
            side = -1.0 if _is_counter_clockwise(line.position_m) else 1.0
            branch = side_channels.tributary(line, river.width_m, mouth, float(river.level_m[mouth]), side, rng)
            if branch is not None and _is_clear(branch, branches, ends):
                branches.append(branch)
                occupied.append((mouth, 6.0))
                break
        else:
            return None
    for _ in range(level.ponds):
        pond = side_channels.pond(line, river.width_m, branches, ends, river.level_m)
        if pond is not None:
            branches.append(pond)
    return branches


def _is_clear(branch: Branch, others: list[Branch], ends: np.ndarray) -> bool:
    """Return whether a branch keeps its distance from other branches and from the ways to bridges."""
    keep = [(other.position_m, other.width_m) for other in others]
    if len(ends):
        keep.append((ends, np.full(len(ends), 6.0)))
    return all(
        np.all(side_channels.bank_distance(branch.position_m, line, width) > branch.width_m / 2 + 4.0)
        for line, width in keep
    )


def _is_counter_clockwise(line: np.ndarray) -> bool:
    """Return whether a closed line [S, 2] runs counter-clockwise (the sign of the shoelace area)."""
    x, y = line.T
    return bool(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0)
