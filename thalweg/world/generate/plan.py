"""Where does everything lie along the course? The river of a level and seed, before any terrain is built.

Lines are drawn until one carries all that the level asks for: straight narrow places for bridges, wide ones for
islands, room for side channels. Each attempt has its own stream of random numbers, so the same level and seed always
end with the same plan.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from thalweg.world import bridges, islands
from thalweg.world import validation as checks
from thalweg.world.errors import WorldError
from thalweg.world.generate import hydrology, meander
from thalweg.world.generate import side_channels as sidewater
from thalweg.world.generate.hydrology import Line
from thalweg.world.generate.side_channels import Branch
from thalweg.world.levels import Level
from thalweg.world.record import River

ATTEMPTS = 3000
"""Draws after which a level is said to be impossible; the built-in ones need about a hundred."""
EXTENT_M = 140.0
"""A generated course fits in a square of this side; a longer one gets more room in proportion."""
EXTENT_COURSE_M = 425.0
"""From this length on a course counts as a longer one."""
WIDE_REACH_M = 3.0
"""A wide place is so long to either side of its middle before the banks draw in."""


@dataclass(frozen=True)
class Plan:
    """The course and everything that stands in or beside it."""

    river: River
    islands: np.ndarray
    """[I, 5] as in `World.islands`."""
    bridges: np.ndarray
    """[B, 11] as in `World.bridges`."""
    branches: tuple[Branch, ...]
    """Tributaries first, then ponds."""


def stream(level: Level, seed: int, purpose: int) -> np.random.Generator:
    """The random numbers of one purpose of one world; different purposes never share numbers."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([level.key, seed, purpose])))


def plan(level: Level, seed: int) -> Plan:
    """The plan of a level and a seed >= 0, checked; raises `WorldError` for a level that can't be met."""
    for attempt in range(ATTEMPTS):
        rng = stream(level, seed, 1000 + attempt)
        line = draw_course(level, rng)
        drawn = furnish(level, line, rng) if line is not None else None
        if drawn is None:
            continue
        try:
            checks.check_world(drawn.river, drawn.islands, drawn.bridges)
            checks.check_arms(drawn.river, hydrology.LAND_BETWEEN_M - 1.0)
        except WorldError:
            continue
        return drawn
    raise WorldError(f"no river of level {level.name!r} was found for seed {seed} in {ATTEMPTS} attempts")


def draw_course(level: Level, rng: np.random.Generator) -> Line | None:
    """A closed line on which even the narrowest river of the level has room; None if this draw gave none."""
    position = meander.draw_line(level, rng)
    if position is None or np.ptp(position, axis=0).max() > max(EXTENT_M * level.length_m / EXTENT_COURSE_M, EXTENT_M):
        return None
    line = hydrology.describe(position)
    limit = hydrology.width_limit(line, level)
    if limit.min() < level.width_m[0] + 0.3 or limit.max() < level.width_m[1]:
        return None
    return line


def choose(
    allowed: np.ndarray,
    line: Line,
    taken: list[tuple[int, float]],
    count: int,
    own_m: float,
    rng: np.random.Generator,
) -> list[int]:
    """Up to `count` random samples among `allowed` [S] bool, clear of what is taken and of one another.

    Each new place occupies `own_m` metres of arc to either side; each entry of `taken` is a sample with what it does.
    """
    chosen: list[int] = []
    for sample in rng.permutation(np.flatnonzero(allowed)):
        if len(chosen) == count:
            break
        away = line.from_place(int(sample))
        places = taken + [(c, own_m) for c in chosen]
        if all(away[other] >= reach + own_m for other, reach in places):
            chosen.append(int(sample))
    return chosen


@dataclass(frozen=True)
class Places:
    """The samples of the course at which things are put."""

    rapid: int | None
    """The middle of the rapid."""
    islands: list[int]
    """Where the river is wide: for islands, and on a level without any for its widest place."""
    bridges: list[int]
    """Where it is straight."""
    taken: list[tuple[int, float]]
    """All of them, each with the arc length in metres that it occupies to either side."""


def find_places(level: Level, line: Line, rng: np.random.Generator) -> Places | None:
    """Places for rapid, islands and bridges, clear of one another; None if the line has not enough of them."""
    limit = hydrology.width_limit(line, level)
    low, high = level.width_m
    taken: list[tuple[int, float]] = []
    rapid: list[int] = []
    if level.fall_m > 0:
        rapid = choose((line.tightest_near(9.0) < 1 / 22.0) & (limit > low + 2), line, taken, 1, 9.0, rng)
        if not rapid:
            return None
        taken.append((rapid[0], 9.0))

    roomy = minimum_filter1d(limit, 11, mode="wrap")
    wide = choose((roomy >= high) & (line.tightest_near(5.0) < 1 / 14.0), line, taken, 1, 13.0, rng)
    if not wide:
        return None
    taken.append((wide[0], 13.0))
    if level.islands > 1:
        spots = (roomy > max(9.0, 0.5 * high)) & (line.tightest_near(5.0) < 1 / 13.0)
        wide += choose(spots, line, taken, level.islands - 1, 10.5, rng)
        taken += [(sample, 10.5) for sample in wide[1:]]

    spots = (line.tightest_near(5.0) < 1 / 28.0) & (line.other_arm_m > low + 24.0)
    crossings = choose(spots, line, taken, level.bridges, 11.0, rng)
    taken += [(sample, 11.0) for sample in crossings]
    if len(wide) < max(level.islands, 1) or len(crossings) < level.bridges:
        return None
    return Places(rapid[0] if rapid else None, wide, crossings, taken)


def draw_river(level: Level, line: Line, places: Places, rng: np.random.Generator) -> River | None:
    """The river on a line, wide and narrow where its places ask for it; None if it does not use its range of widths."""
    low, high = level.width_m
    narrow = [(sample, low + rng.uniform(0.0, 0.3) * (high - low)) for sample in places.bridges]
    narrowest = choose(np.ones(level.samples, bool), line, places.taken, 1, 8.0, rng)
    if not narrowest and not places.bridges:
        return None
    narrow.append(((narrowest or places.bridges)[0], low))
    rapid = 0
    if places.rapid is not None:
        narrow.append((places.rapid, low + 0.35 * (high - low)))
        rapid = (places.rapid - round(hydrology.RAPID_M / 2 * level.samples / line.length_m)) % level.samples
    width = hydrology.widths(line, level, [(sample, WIDE_REACH_M) for sample in places.islands], narrow, rng)
    if not hydrology.uses_range(width, level):
        return None
    depth = hydrology.depths(line, width, level, rng)
    return hydrology.river_of(line.position_m, True, width, depth, hydrology.water_levels(line, level, rapid))


def furnish(level: Level, line: Line, rng: np.random.Generator) -> Plan | None:
    """Everything that lies along a line; None if something does not fit."""
    places = find_places(level, line, rng)
    river = draw_river(level, line, places, rng) if places is not None else None
    if places is None or river is None:
        return None
    position, tangent, width, water = river.position_m, river.tangent, river.width_m, river.level_m
    island_rows = [
        islands.draw(position[i], tangent[i], float(width[i]), float(line.curvature[i]), rng)
        for i in places.islands[: level.islands]
    ]
    bridge_rows = [
        bridges.across(position[i], tangent[i], float(width[i]), float(water[i]), rng) for i in places.bridges
    ]
    if any(row is None or not fits_channel(row, river) for row in island_rows):
        return None
    spans = np.array(bridge_rows, dtype=np.float64).reshape(-1, 11)
    branches = _side_water(level, line, river, places.taken, spans, rng)
    if branches is None:
        return None
    sands = np.array(island_rows, dtype=np.float64).reshape(-1, 5)
    return Plan(river, sands, spans, tuple(branches))


def fits_channel(row: np.ndarray, river: River) -> bool:
    """Whether an island keeps its distance from both banks and leaves an arm of the least width beside it."""
    near = np.hypot(*(river.position_m - row[:2]).T) < 25.0
    start = river.position_m[near]
    gap = islands.outline(row)[:, None, :] - start[None, :, :]
    off = np.hypot(gap[..., 0], gap[..., 1])
    nearest = np.argmin(off, axis=1)
    if np.any(river.width_m[near][nearest] / 2 - off.min(axis=1) < islands.LEAST_SIDE_M - 0.3):
        return False
    gaps = checks.free_lateral(river, row[None], 0.0)[near]
    return bool(np.all(gaps[:, 1] - gaps[:, 0] >= np.minimum(islands.LEAST_ARM_M - 0.2, river.width_m[near] - 0.2)))


def _side_water(
    level: Level,
    line: Line,
    river: River,
    taken: list[tuple[int, float]],
    bridge_rows: np.ndarray,
    rng: np.random.Generator,
) -> list[Branch] | None:
    """The tributaries and ponds of a level; None if a tributary finds no place."""
    branches: list[Branch] = []
    taken = list(taken)
    ends = np.array(
        [
            [b[0] + k * np.cos(b[2]) * b[3] / 2, b[1] + k * np.sin(b[2]) * b[3] / 2]
            for b in bridge_rows
            for k in (-2.0, -1.0, 1.0, 2.0)
        ]
    ).reshape(-1, 2)
    for _ in range(level.tributaries):
        mouths = choose(line.tightest_near(3.0) < 1 / 12.0, line, taken, 6, 6.0, rng)
        for mouth in mouths:
            side = -1.0 if _is_counter_clockwise(line.position_m) else 1.0
            branch = sidewater.tributary(line, river.width_m, mouth, float(river.level_m[mouth]), side, rng)
            if branch is not None and _is_clear(branch, branches, ends):
                branches.append(branch)
                taken.append((mouth, 6.0))
                break
        else:
            return None
    for _ in range(level.ponds):
        still = sidewater.pond(line, river.width_m, branches, ends, river.level_m)
        if still is not None:
            branches.append(still)
    return branches


def _is_clear(branch: Branch, others: list[Branch], ends: np.ndarray) -> bool:
    """Whether a branch keeps its distance from other branches and from the ways to bridges."""
    keep = [(other.position_m, other.width_m) for other in others]
    if len(ends):
        keep.append((ends, np.full(len(ends), 6.0)))
    return all(
        np.all(sidewater.bank_distance(branch.position_m, line, width) > branch.width_m / 2 + 4.0)
        for line, width in keep
    )


def _is_counter_clockwise(line: np.ndarray) -> bool:
    """Whether a closed line [S, 2] goes round counter-clockwise (the sign of the shoelace area)."""
    x, y = line.T
    return bool(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0)
