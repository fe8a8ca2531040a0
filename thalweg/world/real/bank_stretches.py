"""Kinds of banks in a file of a river: the property `banks` of its ways, placed along the course that comes of them.

What a way says holds from its first position to its last. The course may run the other way, be cut, smoothed or
measured between the banks, so that a stretch is followed as places on the Earth.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thalweg.world.banks import BankReach, Banks, parse_banks
from thalweg.world.errors import WorldError
from thalweg.world.geometry import BLOCK_PAIRS
from thalweg.world.real.geodesy import chord_lengths, local_metres
from thalweg.world.record import River

STEP_M = 4.0
"""Distance between the places by which a stretch is followed."""
SNAP_M = 2.0
"""Distance from the end of a course within which a reach is meant to go to the end."""
BESIDE_M = 2.0
"""Distance from the course, beside its width, within which a place belongs to it."""
AHEAD = 0.5
"""Least distance along the course over that along the way; a way that leaves the course has less."""
OTHER_SIDE = {"left": "right", "right": "left", "both": "both"}


@dataclass(frozen=True)
class Stretch:
    """A reach of banks along a way."""

    kind: str
    side: str
    """As seen in the direction of the way."""
    degrees: np.ndarray
    """[K, 2] float64, longitude and latitude of places from its beginning to its end."""


def stretches_of(degrees: np.ndarray, value: Any, label: str) -> list[Stretch]:
    """Return the stretches of a way [K, 2] in degrees with a property `banks`, None for none.

    On a closed way a reach may lead over its end.

    Raises `WorldError` that names the way, for a value that `thalweg.world.banks.read_banks` does not read, and for a
    reach that is not on the way.
    """
    if value is None:
        return []
    arc = np.concatenate([[0.0], np.cumsum(chord_lengths(degrees))])
    is_ring = bool(np.array_equal(degrees[0], degrees[-1]))
    try:
        reaches = parse_banks(value)
    except WorldError as reason:
        raise WorldError(f"{label}: {reason}") from None
    found = []
    for reach in reaches:
        end = arc[-1] if reach.end_m is None else reach.end_m
        is_on_way = reach.start_m < arc[-1] and end <= arc[-1]
        over_end = is_on_way and is_ring and end < reach.start_m
        if not is_on_way or (end <= reach.start_m and not over_end):
            raise WorldError(f"{label}: banks: {reach.text} is not on the way, which is {arc[-1]:.1f} m long")
        end += arc[-1] if over_end else 0.0
        at = np.linspace(reach.start_m, end, max(int((end - reach.start_m) / STEP_M), 1) + 1)
        at = np.where(at > arc[-1], at - arc[-1], at)
        longitude = np.interp(at, arc, np.unwrap(degrees[:, 0], period=360.0))
        found.append(Stretch(reach.kind, reach.side, np.stack([longitude, np.interp(at, arc, degrees[:, 1])], axis=1)))
    return found


def placed(stretches: Sequence[Stretch], origin_deg: tuple[float, float], river: River) -> Banks:
    """Return the reaches of a river [S] that stretches are; those that are not on its course are left out."""
    found = (_reach(stretch, np.array(origin_deg), river) for stretch in stretches)
    return tuple(reach for reach in found if reach is not None)


def _reach(stretch: Stretch, origin_deg: np.ndarray, river: River) -> BankReach | None:
    degrees = stretch.degrees.copy()
    degrees[:, 0] = origin_deg[0] + (degrees[:, 0] - origin_deg[0] + 180.0) % 360.0 - 180.0
    places = local_metres(degrees, origin_deg)
    # Of a long way only what lies about the course is compared with all of it.
    clear = river.width_m.max() + BESIDE_M
    low, high = river.position_m.min(axis=0) - clear, river.position_m.max(axis=0) + clear
    about = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
    if len(about) < 2:
        return None
    arc, away, width = (np.full(len(places), value) for value in (0.0, np.inf, 0.0))
    size = max(BLOCK_PAIRS // river.segments, 1)
    for first in range(0, len(about), size):
        rows = about[first : first + size]
        arc[rows], away[rows], width[rows] = _along(places[rows], river)
    near = away <= width + BESIDE_M
    if np.count_nonzero(near) < 2:
        return None
    arc = np.unwrap(arc[near], period=river.length_m) if river.closed else arc[near]
    start, end = float(arc[0]), float(arc[-1])
    travelled = float(np.hypot(*np.diff(places[near], axis=0).T).sum())
    if abs(end - start) < max(AHEAD * travelled, 1.0):
        return None
    side = stretch.side
    if end < start:
        start, end, side = end, start, OTHER_SIDE[side]
    if river.closed:
        if end - start > river.length_m - SNAP_M:
            return BankReach(stretch.kind, side=side)
        start, end = (_on_loop(value, river.length_m) for value in (start, end))
        return BankReach(stretch.kind, start, end or None, side)
    start = 0.0 if start < SNAP_M else start
    return BankReach(stretch.kind, start, None if end > river.length_m - SNAP_M else end, side)


def _on_loop(arc_m: float, length_m: float) -> float:
    """Return an arc length from 0 to below that of a loop, in millimetres: rounding may not lead past its end."""
    arc = round(arc_m % length_m, 3)
    return arc if arc < length_m - 1e-3 else 0.0


def _along(places: np.ndarray, river: River) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return arc length, distance and width [K] of the course's points that are nearest to places [K, 2]."""
    begin = river.position_m[: river.segments]
    step = np.roll(river.position_m, -1, axis=0)[: river.segments] - begin
    length = np.hypot(*step.T)
    offset = places[:, None] - begin
    share = np.clip((offset * step).sum(-1) / length**2, 0.0, 1.0)
    away = np.linalg.norm(offset - share[..., None] * step, axis=-1)
    rows, nearest = np.arange(len(places)), away.argmin(axis=1)
    arc = river.arc_m[nearest] + share[rows, nearest] * length[nearest]
    return arc, away[rows, nearest], river.width_m[nearest]
