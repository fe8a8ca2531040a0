"""Worlds of real rivers from files of several formats: ways are joined, banks become a centre line with widths."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.world import validation as checks
from thalweg.world.banks import Banks, check_banks, read_banks, text_of
from thalweg.world.errors import WorldError, WorldFileError
from thalweg.world.real.bank_stretches import Stretch, placed, stretches_of
from thalweg.world.real.centerline import read_river, world_around
from thalweg.world.real.course import banks as bank_polygons
from thalweg.world.real.course.drawing import Drawing, name_of, sort_features
from thalweg.world.real.course.solids import Solids, place_solids
from thalweg.world.real.course.ways import Stem, Way, join_ways
from thalweg.world.real.geodesy import chord_lengths
from thalweg.world.real.reach_line import Centerline, ElevationError, Track, cut_reach, errors_naming, project
from thalweg.world.real.selection import Selection
from thalweg.world.real.sources.features import Feature
from thalweg.world.real.sources.reading import read_features
from thalweg.world.real.sources.tags import metres, width_value
from thalweg.world.record import River, World

COVERED = 0.8
"""Least share of the ways that must lie in one piece of the banks, for the banks to give the course."""
MAX_NAME_LENGTH = 40
"""Maximum number of characters of a world's name."""


@dataclass(frozen=True)
class RiverPlan:
    """The river of a file before its valley is built, and what was done to get it."""

    name: str
    river: River
    solids: Solids
    banks: Banks
    notes: tuple[str, ...]
    """Sentences about what was joined, turned, measured or left out."""


def from_file(path: str | Path, *, seed: int = 0, plants: bool = True, **options: Any) -> World:
    """Return the world around a river in a GeoJSON, Overpass JSON, GPX or KML file.

    Args:
        path: The file. Several lines are joined, and turned where they run against the others. Polygons of banks give
            the centre line and the width; their holes, and polygons with `place=islet`, are islands. Lines with
            `bridge=*` that cross the course are bridges. Widths are properties, such as `width=14 m`.
        seed: Seed of the land and the plants.
        plants: False leaves out plants and baked light, which is faster; for tests.
        **options: Fields of `thalweg.world.real.selection.Selection`, such as `start_m`, `length_m` or `width_m`.

    Raises `WorldFileError` for a file from which no safe river can be made, with the position and what would be right,
    and `WorldError` for an option out of its range.
    """
    selection = Selection(**options)
    plan = plan_file(path, selection)
    solids = plan.solids
    world = world_around(plan.river, solids.islands, solids.bridges, seed, plants=plants, banks=plan.banks)
    return replace(world, name=plan.name)


def plan_file(path: str | Path, selection: Selection) -> RiverPlan:
    """Return the validated river of a file with its islands and bridges; raises as `from_file`."""
    reach = _read_reach(path, selection)
    origin_deg = reach.line.origin_deg
    with errors_naming(path, selection.smooth_m):
        river = read_river(_at_least_four(reach.line.points), reach.line.closed, plant_density=1.0)
        solids = place_solids(reach.islands, reach.bridges, origin_deg, river)
        try:
            checks.check_safe_poses(river, solids.islands, solids.bridges)
        except WorldError as reason:
            raise WorldError(f"{reason}; open_water leaves bridges and islands out") from None
        banks = read_banks([placed(reach.stretches, origin_deg, river), selection.banks or None])
        check_banks(banks, river.length_m, river.closed)
    notes = (*reach.notes, *_of_solids(solids), *_of_banks(banks))
    return RiverPlan(reach.line.name, river, solids, banks, notes)


def read_centerline(path: str | Path, **options: Any) -> Centerline:
    """Return the line of a file's river in local metres; arguments and errors are those of `from_file`."""
    return _read_reach(path, Selection(**options)).line


@dataclass(frozen=True)
class _Reach:
    """What a file says of the reach that is taken from it."""

    line: Centerline
    islands: list[np.ndarray]
    """Outlines [K, 2] in degrees; none with `open_water`."""
    bridges: Sequence[Feature]
    stretches: list[Stretch]
    """What the file says of the kinds of banks."""
    notes: list[str]


def _read_reach(path: str | Path, selection: Selection) -> _Reach:
    """Return the reach of a file; raises as `from_file`."""
    selection.check_options()
    try:
        drawing = sort_features(read_features(Path(path), selection.crs), selection.river_name)
        stretches = [stretch for way in drawing.ways for stretch in _stretches(way)]
        track, outlines, notes = _course(drawing, selection, Path(path).stem)
        is_complete = selection.start_m == 0.0 and selection.length_m is None
        closed = is_complete and bool(np.array_equal(track.degrees[0], track.degrees[-1]))
        line = project(cut_reach(track, selection.start_m, selection.length_m), closed, selection.smooth_m)
    except ElevationError as reason:
        raise WorldFileError(f"{path}: {reason} Else pass flat_water") from None
    except WorldError as reason:
        raise WorldFileError(f"{path}: {reason}") from None
    except RecursionError:
        raise WorldFileError(f"{path}: not GeoJSON: nested too deep") from None
    if selection.open_water:
        return _Reach(line, [], (), stretches, notes)
    return _Reach(line, outlines, drawing.bridges, stretches, notes)


def _at_least_four(points: np.ndarray) -> np.ndarray:
    """Return points [K, 4], with the middles of the pieces between two or three of them: a spline needs four."""
    while 2 <= len(points) < 4:
        between = np.empty((2 * len(points) - 1, points.shape[1]))
        between[::2], between[1::2] = points, (points[1:] + points[:-1]) / 2
        points = between
    return points


def _course(drawing: Drawing, selection: Selection, stem_name: str) -> tuple[Track, list[np.ndarray], list[str]]:
    """Return the line of a drawing, the outlines [K, 2] of its islands in degrees, and notes."""
    outlines = [feature.rings[0][:, :2] for feature in drawing.islands]
    notes: list[str] = []
    stem = join_ways([_way(feature) for feature in drawing.ways]) if drawing.ways else None
    if stem is not None and len(drawing.ways) > 1:
        notes.append(
            f"{stem.joined} way{'' if stem.joined == 1 else 's'} joined, {stem.turned} of them turned"
            + (f"; {stem.left_out} beside the main stem left out" if stem.left_out else "")
        )
    axis = None
    if drawing.banks:
        axis, holes, note = _axis(drawing, stem)
        notes.append(note)
        outlines += holes
    if axis is not None:
        places = np.column_stack([axis.degrees, np.full(len(axis.degrees), np.nan)])
        width = axis.width_m
        if stem is not None and not selection.flat_water and np.isfinite(stem.places[:, 2]).any():
            notes.append("elevations of the ways left out: the water between measured banks is level")
    else:
        assert stem is not None
        places, width = stem.places, _filled(stem, selection.width_m)
    if selection.reverse:
        places, width = places[::-1], width[::-1]
    elevation = None if selection.flat_water else _elevations(places)
    name = (drawing.name or stem_name)[:MAX_NAME_LENGTH]
    return Track(name, np.ascontiguousarray(places[:, :2]), np.ascontiguousarray(width), elevation), outlines, notes


def _axis(drawing: Drawing, stem: Stem | None) -> tuple[bank_polygons.Axis | None, list[np.ndarray], str]:
    """Return the centre line of the banks, the outlines of their islands, and a note.

    Ways of which too little lies in one piece of the banks, or which make a ring, are the course themselves: there is
    no line then.
    """
    along = None if stem is None else stem.places[:, :2]
    banks = bank_polygons.unite(drawing.banks, along)
    if along is not None:
        share = float(bank_polygons.share_inside(banks, along).max())
        if np.array_equal(along[0], along[-1]):
            return None, list(banks.holes), "the banks are not measured: the ways make a ring"
        if share < COVERED:
            return (
                None,
                list(banks.holes),
                f"no piece of the banks covers more than {share:.0%} of the ways: widths are those of the ways",
            )
    axis = bank_polygons.axis_of(banks, along)
    low, high = axis.width_m.min(), axis.width_m.max()
    return axis, list(banks.holes), f"centre line and widths of {low:.1f} to {high:.1f} m measured between the banks"


def _way(feature: Feature) -> Way:
    """Return a line of water with its widths."""
    places = feature.rings[0]
    width = np.full(len(places), np.nan)
    if (given := width_value(feature.tags)) is not None:
        key, value = given
        if isinstance(value, list):
            if len(value) != len(places):
                raise WorldError(
                    f"{feature.label}: {key} has {len(value)} numbers for {len(places)} positions; expected one for "
                    "each"
                )
            width = np.array([metres(one, f"{key}[{index}] of {feature.label}") for index, one in enumerate(value)])
        else:
            width[:] = metres(value, f"{key} of {feature.label}")
    return Way(places, width, name_of(feature), feature.label)


def _stretches(feature: Feature) -> list[Stretch]:
    """Return the stretches whose kinds of banks a way names."""
    return stretches_of(feature.rings[0][:, :2], feature.tags.get("banks"), feature.label)


def _filled(stem: Stem, default_m: float | None) -> np.ndarray:
    """Return [K] widths, where there is none the default, or else that of the neighbours along the line."""
    width = stem.width_m
    known = np.isfinite(width)
    if known.all():
        return width
    if default_m is not None:
        return np.where(known, width, default_m)
    if not known.any():
        raise WorldError(
            "no width: give the line the property width_m, in metres, or width, such as 14 m, or draw polygons of the "
            "banks, or pass width_m"
        )
    arc = np.concatenate([[0.0], np.cumsum(chord_lengths(stem.places[:, :2]))])
    return np.where(known, width, np.interp(arc, arc[known], width[known]))


def _elevations(places: np.ndarray) -> np.ndarray | None:
    """Return [K] the elevations of places [K, 3], None if there are none."""
    known = np.isfinite(places[:, 2])
    if not known.any():
        return None
    if not known.all():
        raise WorldError(
            f"position {int(np.argmin(known))} of the line has no elevation, but others have: give all of them or "
            "none, or pass flat_water"
        )
    return np.ascontiguousarray(places[:, 2])


def _of_banks(banks: Banks) -> list[str]:
    """Return what to say about banks."""
    return [f"banks: {text_of(banks)}"] if banks else []


def _of_solids(solids: Solids) -> list[str]:
    """Return what to say about islands and bridges."""
    counts = [
        f"{len(rows)} {word}{'' if len(rows) == 1 else 's'}"
        for rows, word in ((solids.bridges, "bridge"), (solids.islands, "island"))
        if len(rows)
    ]
    if solids.outside:
        counts.append(f"{solids.outside} bridges or islands not on the course, too small or along it left out")
    return [", ".join(counts)] if counts else []
