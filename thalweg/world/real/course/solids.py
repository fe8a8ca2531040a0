"""Islands and bridges of a file, placed on a river: ellipses for outlines, arch bridges for ways that cross the course.

The simulator knows islands as ellipses and bridges as straight stone arches of one span; what a file draws is replaced
by the nearest of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from thalweg.world import bridges as bridge_shapes
from thalweg.world.bridges import Bridge
from thalweg.world.real.geodesy import local_metres
from thalweg.world.real.sources.features import Feature
from thalweg.world.real.sources.tags import deck_width
from thalweg.world.record import River

MIN_SEMI_AXIS_M = 0.5
"""Least semi-axis of an island; smaller ones are left out."""
SAME_AREA = 1.25
"""Greatest ratio of the areas of two islands in one place that are taken for one."""
END_M = 2.0
"""Least course between an open end and an island or a bridge."""
DECK_RANGE_M = (2.0, 15.0)
"""Least and greatest width of a deck."""
MIN_CROSSING = 0.5
"""Least sine of the angle between a bridge and the river, 30 degrees; one that runs along the river is left out."""
BETWEEN_M = 1.0
"""Least water between two decks; bridges that are nearer to one another become one."""
HUMP_M, PARAPET_M, SPRING_M, BANK_M = 0.3, 0.65, 0.1, 0.2
"""Middle of the deck above its ends, height of the parapets, spring of the arch above the water, and its distance from
the bank."""


@dataclass(frozen=True)
class Solids:
    """What stands in a river."""

    islands: np.ndarray
    """[I, 5] as in `World.islands`."""
    bridges: np.ndarray
    """[B, 11] as in `World.bridges`."""
    outside: int
    """Number of islands and bridges of the file that are not on the course, or too small, or run along it; an island
    that the file has twice counts once."""


def place_solids(
    outlines: Sequence[np.ndarray], lines: Sequence[Feature], origin_deg: tuple[float, float], river: River
) -> Solids:
    """Return the islands of outlines [K, 2] in degrees, and the bridges of lines, that lie on a river [S]."""
    origin = np.array(origin_deg)
    rows = [ellipse_of(local_metres(_near(ring, origin), origin)) for ring in outlines]
    islands: list[np.ndarray] = []
    beside: list[np.ndarray] = []
    for row in rows:
        if row is not None:
            # Maps have an island as a hole of the water and as an area of its own.
            group = islands if _is_in_channel(row, river) else beside
            if not _is_among(row, group):
                group.append(row)
    left_out = sum(row is None for row in rows) + sum(not _is_among(row, islands) for row in beside)
    crossings: list[Crossing] = []
    crossing_lines = 0
    for feature in lines:
        metres = local_metres(_near(feature.rings[0][:, :2], origin), origin)
        width = float(np.clip(deck_width(feature.tags, feature.label), *DECK_RANGE_M))
        found = crossings_of(metres, width, river)
        crossing_lines += bool(found)
        crossings += found
    bridges = [bridge_at(each, river) for each in merged(crossings, river.length_m if river.closed else None)]
    return Solids(
        np.array(islands, dtype=np.float64).reshape(-1, 5),
        np.array(bridges, dtype=np.float64).reshape(-1, 11),
        left_out + len(lines) - crossing_lines,
    )


def _near(degrees: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return longitudes and latitudes [K, 2] with each longitude within half a turn of the origin's."""
    turned = degrees.copy()
    turned[:, 0] = origin[0] + (degrees[:, 0] - origin[0] + 180.0) % 360.0 - 180.0
    return turned


def ellipse_of(ring: np.ndarray) -> np.ndarray | None:
    """Return the island [5] of an outline [K, 2] in metres; None for one that is too small.

    It has the outline's middle, its area, and the directions and proportions of its second moments: a semi-axis is
    twice the root of the variance along it, as for an ellipse (area and moments of a polygon: Steger, 1996).
    """
    middle = ring.mean(axis=0)
    x, y = (ring - middle).T
    after_x, after_y = np.roll(x, -1), np.roll(y, -1)
    cross = x * after_y - after_x * y
    area = cross.sum() / 2
    if abs(area) < np.pi * MIN_SEMI_AXIS_M**2:
        return None
    centre = np.array([((x + after_x) * cross).sum(), ((y + after_y) * cross).sum()]) / (6 * area)
    xx = ((x**2 + x * after_x + after_x**2) * cross).sum() / (12 * area) - centre[0] ** 2
    yy = ((y**2 + y * after_y + after_y**2) * cross).sum() / (12 * area) - centre[1] ** 2
    xy = ((x * after_y + 2 * x * y + 2 * after_x * after_y + after_x * y) * cross).sum() / (24 * area)
    variance, axes = np.linalg.eigh([[xx, xy - centre[0] * centre[1]], [xy - centre[0] * centre[1], yy]])
    across, along = 2 * np.sqrt(np.maximum(variance, 1e-9))
    scale = np.sqrt(abs(area) / (np.pi * along * across))
    if across * scale < MIN_SEMI_AXIS_M:
        return None
    angle = np.arctan2(axes[1, 1], axes[0, 1]) % np.pi
    return np.array([*(middle + centre), along * scale, across * scale, angle])


def _is_among(row: np.ndarray, others: Sequence[np.ndarray]) -> bool:
    """Return whether an island [5] is one of others, as `_is_same` compares them."""
    return any(_is_same(row, other) for other in others)


def _is_same(row: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two islands [5] are one: either's middle lies well within the other, and their areas agree."""
    apart = np.hypot(*(row[:2] - other[:2]))
    sizes = sorted((row[2] * row[3], other[2] * other[3]))
    return bool(apart < min(row[3], other[3]) / 2 and sizes[1] <= SAME_AREA * sizes[0])


def _is_in_channel(row: np.ndarray, river: River) -> bool:
    """Return whether an island's middle lies in the water of a river, and all of it clear of the course's open ends."""
    away = np.hypot(*(river.position_m - row[:2]).T)
    nearest = int(np.argmin(away))
    if away[nearest] > river.width_m[nearest] / 2:
        return False
    arc, clear = river.arc_m[nearest], row[2] + END_M
    return bool(river.closed or clear <= arc <= river.length_m - clear)


@dataclass(frozen=True)
class Crossing:
    """A place at which a bridge crosses a course."""

    arc_m: float
    """Arc length of the course there."""
    width_m: float
    """Width of the deck."""
    angle: float
    """Direction of the bridge in radians."""
    sine: float
    """Sine of its angle to the course, positive."""


def crossings_of(line: np.ndarray, width_m: float, river: River) -> list[Crossing]:
    """Return the crossings of a line [K, 2] in metres with a river [S], those at its open ends left out."""
    course = np.concatenate([river.position_m, river.position_m[:1]]) if river.closed else river.position_m
    start, step = course[:-1], np.diff(course, axis=0)
    found = []
    for one, other in pairwise(line):
        way = other - one
        across = step[:, 0] * way[1] - step[:, 1] * way[0]
        gap = one - start
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (gap[:, 0] * way[1] - gap[:, 1] * way[0]) / across
            share = (gap[:, 0] * step[:, 1] - gap[:, 1] * step[:, 0]) / across
        for segment in np.flatnonzero((along >= 0) & (along < 1) & (share >= 0) & (share < 1)):
            arc = float(river.arc_m[segment] + along[segment] * np.hypot(*step[segment]))
            sine = float(abs(across[segment]) / (np.hypot(*step[segment]) * np.hypot(*way)))
            clear = width_m / (2 * sine) + END_M
            if sine >= MIN_CROSSING and (river.closed or clear <= arc <= river.length_m - clear):
                found.append(Crossing(arc, width_m, float(np.arctan2(way[1], way[0]) % np.pi), sine))
    return found


def merged(crossings: Sequence[Crossing], around_m: float | None = None) -> list[Crossing]:
    """Return the crossings in the order of the course, with those that would overlap as one: a road and its pavements.

    It is as wide as all together, and has the direction of the widest. `around_m`: length of a closed course, on which
    crossings beside its seam may overlap too.
    """
    found: list[Crossing] = []
    for each in _from_the_widest_gap(sorted(crossings, key=lambda crossing: crossing.arc_m), around_m):
        if not found or _start(each) - _end(found[-1]) >= BETWEEN_M:
            found.append(each)
            continue
        last = found.pop()
        start, end = min(_start(last), _start(each)), max(_end(last), _end(each))
        widest = max(last, each, key=lambda crossing: crossing.width_m)
        width = float(np.clip((end - start) * widest.sine, *DECK_RANGE_M))
        found.append(Crossing((start + end) / 2, width, widest.angle, widest.sine))
    if around_m is None:
        return found
    on_course = (replace(each, arc_m=each.arc_m % around_m) if each.arc_m >= around_m else each for each in found)
    return sorted(on_course, key=lambda crossing: crossing.arc_m)


def _from_the_widest_gap(crossings: list[Crossing], around_m: float | None) -> list[Crossing]:
    """Return sorted crossings of a closed course from that after the widest gap on, those before it a round later."""
    if around_m is None or len(crossings) < 2:
        return crossings
    again = [replace(each, arc_m=each.arc_m + around_m) for each in crossings]
    gaps = [_start(after) - _end(before) for before, after in pairwise([*crossings, again[0]])]
    first = (int(np.argmax(gaps)) + 1) % len(crossings)
    return crossings[first:] + again[:first]


def _start(crossing: Crossing) -> float:
    return crossing.arc_m - crossing.width_m / (2 * crossing.sine)


def _end(crossing: Crossing) -> float:
    return crossing.arc_m + crossing.width_m / (2 * crossing.sine)


def bridge_at(crossing: Crossing, river: River) -> np.ndarray:
    """Return the bridge [11] at a crossing; its span reaches from bank to bank in its own direction."""
    closing = [river.length_m] if river.closed else []
    arc = np.append(river.arc_m, closing)

    def at(values: np.ndarray) -> float:
        return float(np.interp(crossing.arc_m, arc, np.append(values, values[:1] if river.closed else [])))

    across, level = at(river.width_m) / crossing.sine, at(river.level_m)
    deck, spring = level + bridge_shapes.DECK_ABOVE_WATER_M, level + SPRING_M
    return np.array(
        Bridge(
            x=at(river.position_m[:, 0]),
            y=at(river.position_m[:, 1]),
            angle=crossing.angle,
            length=across + 2 * bridge_shapes.LANDING_M,
            width=crossing.width_m,
            span=max(across - 2 * BANK_M, 1.0),
            spring_z=spring,
            rise=deck - bridge_shapes.ARCH_THICKNESS_M - spring,
            deck_z=deck,
            hump=HUMP_M,
            parapet=PARAPET_M,
        )
    )
