"""Polygons of banks: united, with their holes as islands, and turned into a centre line with widths.

The width at a place is twice the distance of the medial axis from the nearer bank, so that side arms and harbours do
not count. The axis follows every corner of the banks; a Gaussian rounds both line and widths.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thalweg.world import geometry
from thalweg.world.errors import WorldError
from thalweg.world.real.course.medial_axis import medial_axis
from thalweg.world.real.geodesy import degrees_of, local_metres
from thalweg.world.real.reach_line import smooth_line
from thalweg.world.real.sources.extra import need
from thalweg.world.real.sources.features import Feature
from thalweg.world.validation import CLEARANCE_M

SLIVER_M = 0.5
"""Gaps between polygons up to this width are closed: data of different days do not meet exactly."""
MIN_HOLE_M2 = 2.0
"""Least area of a hole that is an island."""
MIN_ELONGATION = 3.0
"""Least length of a river relative to its median width."""
ROUNDING = 0.35
"""Standard deviation of the Gaussian along the axis, relative to the median width."""
AROUND_M = 150.0
"""Water this far around the box of the ways counts."""
MAX_SPAN_M = 60_000.0
"""Maximum extent of all banks: plane metres serve no longer beyond it."""
LEAST_WIDTH_M = 2 * CLEARANCE_M + 0.2
"""Width below which an end that tapers off is cut."""


@dataclass(frozen=True)
class Banks:
    """The water of a file as one polygon, in plane metres."""

    origin_deg: np.ndarray
    """[2] longitude and latitude of the origin."""
    pieces: tuple[Any, ...]
    """Polygons of shapely without holes, the largest first."""
    holes: tuple[np.ndarray, ...]
    """[K, 2] each, the outlines of the islands in degrees."""
    first_m: np.ndarray
    """[2] the first position in the file."""

    def metres(self, degrees: np.ndarray) -> np.ndarray:
        """Return [K, 2] plane metres of longitude and latitude [K, 2]."""
        return local_metres(degrees, self.origin_deg)


@dataclass(frozen=True)
class Axis:
    """A centre line with widths."""

    degrees: np.ndarray
    """[K, 2] longitude and latitude."""
    width_m: np.ndarray
    """[K]."""


def unite(polygons: Sequence[Feature], along: np.ndarray | None = None) -> Banks:
    """Return the water of polygons; raises `WorldError` for one that crosses itself, or that are far apart.

    Along a line [K, 2] in degrees, only the water in the box around it counts: maps have polygons of whole rivers.
    """
    shapely = need("shapely", "a polygon of banks")
    places = along if along is not None else np.concatenate([ring[:, :2] for each in polygons for ring in each.rings])
    origin = _origin(places)
    shapes = [_shape(feature, origin) for feature in polygons]
    if along is not None:
        metres = local_metres(along, origin)
        around = shapely.box(*(metres.min(axis=0) - AROUND_M), *(metres.max(axis=0) + AROUND_M))
        shapes = [shape.intersection(around) for shape in shapes]
    united = shapely.union_all(shapes)
    if len(shapes) > 1:
        united = united.buffer(SLIVER_M / 2, join_style="mitre").buffer(-SLIVER_M / 2, join_style="mitre")
    parts = [part for part in shapely.get_parts(united) if part.geom_type == "Polygon" and not part.is_empty]
    parts.sort(key=lambda part: -part.area)
    holes = [hole for part in parts for hole in part.interiors if shapely.Polygon(hole).area >= MIN_HOLE_M2]
    return Banks(
        origin,
        tuple(shapely.Polygon(part.exterior) for part in parts),
        tuple(degrees_of(shapely.get_coordinates(hole)[:, :2], origin) for hole in holes),
        local_metres(polygons[0].rings[0][:1, :2], origin)[0],
    )


def _origin(places: np.ndarray) -> np.ndarray:
    """Return the middle [2] of places [K, 2] in degrees; raises `WorldError` for places that are far apart."""
    low, high = places.min(axis=0), places.max(axis=0)
    if high[0] - low[0] > 180:
        raise WorldError("its banks lie on both sides of 180 degrees of longitude: draw a line of the river instead")
    middle = (low + high) / 2
    span = np.ptp(local_metres(np.array([low, high]), middle), axis=0).max() if high[0] - low[0] < 2 else np.inf
    if span > MAX_SPAN_M:
        raise WorldError(f"its banks extend over more than {MAX_SPAN_M / 1000:.0f} km: cut them to the reach")
    return middle


def _shape(feature: Feature, origin: np.ndarray) -> Any:
    """Return the polygon of a feature in plane metres; raises `WorldError` for one that crosses itself."""
    shapely = need("shapely", "a polygon of banks")
    rings = [local_metres(ring[:, :2], origin) for ring in feature.rings]
    shape = shapely.Polygon(rings[0], rings[1:])
    if not shape.is_valid:
        raise WorldError(_what_is_wrong(shape, origin, feature.label))
    return shape


def _what_is_wrong(shape: Any, origin: np.ndarray, label: str) -> str:
    """Return the message for a polygon that is not valid, with the place."""
    shapely = need("shapely", "a polygon of banks")
    reason, _, place = shapely.is_valid_reason(shape).partition("[")
    words = {"Self-intersection": "crosses itself", "Ring Self-intersection": "touches itself"}
    at = ""
    if place:
        longitude, latitude = degrees_of(np.array([[float(part) for part in place.rstrip("]").split()[:2]]]), origin)[0]
        at = f" at longitude {longitude:.6f}, latitude {latitude:.6f}"
    return f"{label}: the polygon {words.get(reason.strip(), 'is not valid (' + reason.strip() + ')')}{at}"


def share_inside(banks: Banks, degrees: np.ndarray) -> np.ndarray:
    """Return [P] the share of a line [K, 2] in degrees that lies in each piece of water."""
    shapely = need("shapely", "a polygon of banks")
    line = shapely.LineString(banks.metres(degrees))
    inside = [line.intersection(piece).length for piece in banks.pieces] or [0.0]
    return np.array(inside) / max(line.length, 1e-9)


def axis_of(banks: Banks, along: np.ndarray | None) -> Axis:
    """Return the centre line of the largest piece of water, or of that which a line [K, 2] in degrees runs through.

    It runs as the line does, and from one end of it to the other; without one, it begins at the end that is nearer to
    the file's first position. Raises `WorldError` for water in several pieces, with the gap in metres, if there is no
    line, and for a polygon without length.
    """
    guide = None if along is None else banks.metres(along)
    if along is None:
        _check_one_piece(banks)
        piece = banks.pieces[0]
    else:
        piece = banks.pieces[int(np.argmax(share_inside(banks, along)))]
    ends = (None, None) if guide is None else _ends_inside(piece, guide)
    line, clearance = medial_axis(piece, *ends)
    line, clearance = _without_tapers(line, clearance)
    length, width = geometry.arc_length(line, False)[1], 2 * float(np.median(clearance))
    if length < MIN_ELONGATION * width:
        raise WorldError(
            f"the polygon of the banks is {length:.0f} m long and {width:.0f} m wide, which is no river; expected at "
            f"least {MIN_ELONGATION:g} times as long as wide"
        )
    if guide is None and np.hypot(*(line[-1] - banks.first_m)) < np.hypot(*(line[0] - banks.first_m)):
        line, clearance = line[::-1], clearance[::-1]
    points = np.column_stack([line, np.zeros(len(line)), 2 * clearance])
    points = smooth_line(points, False, ROUNDING * width)
    return Axis(degrees_of(points[:, :2], banks.origin_deg), points[:, 3])


def _check_one_piece(banks: Banks) -> None:
    if len(banks.pieces) > 1:
        gap = min(banks.pieces[0].distance(other) for other in banks.pieces[1:])
        raise WorldError(
            f"{len(banks.pieces)} polygons of water that do not join: the largest lies {gap:.1f} m from the next one; "
            f"limit {SLIVER_M:g} m: draw what is missing, leave the others out, or add a line of the river"
        )


def _ends_inside(piece: Any, guide: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last place [2] of a line [K, 2] that lies in a piece of water."""
    shapely = need("shapely", "a polygon of banks")
    fine = shapely.get_coordinates(shapely.segmentize(shapely.LineString(guide), 2.0))
    inside = np.flatnonzero(shapely.contains_xy(piece, fine))
    return fine[inside[0]], fine[inside[-1]]


def _without_tapers(line: np.ndarray, clearance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line without those ends of it that are too narrow to be flown."""
    wide = np.flatnonzero(2 * clearance >= LEAST_WIDTH_M)
    if len(wide) < 2:
        raise WorldError(
            f"the banks are at most {2 * clearance.max():.2f} m apart; at least {LEAST_WIDTH_M:.2f} m are needed"
        )
    return line[wide[0] : wide[-1] + 1], clearance[wide[0] : wide[-1] + 1]
