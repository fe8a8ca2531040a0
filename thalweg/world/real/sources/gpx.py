"""Features of GPX: the segments of its tracks, and its routes."""

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.coordinates import Coordinates
from thalweg.world.real.sources.extra import need
from thalweg.world.real.sources.features import FeatureList
from thalweg.world.real.sources.xml_file import text_of_xml


def gpx_features(content: bytes) -> FeatureList:
    """Return the segments and routes of a GPX document, which `parse_xml` has found safe; waypoints are counted only.

    Raises `WorldError` for a document that is not GPX.
    """
    gpxpy = need("gpxpy", "a GPX file")
    try:
        gpx = gpxpy.parse(text_of_xml(content))
    except (gpxpy.gpx.GPXException, ValueError, TypeError, LookupError) as reason:
        raise WorldError(f"not GPX: {' '.join(str(reason).split())}") from None
    found = FeatureList()
    for index, track in enumerate(gpx.tracks):
        for part, segment in enumerate(track.segments):
            _add(found, segment.points, track.name, f"segment {part} of track {track.name or index}")
    for index, route in enumerate(gpx.routes):
        _add(found, route.points, route.name, f"route {route.name or index}")
    if gpx.waypoints:
        found.others["waypoint"] += len(gpx.waypoints)
    return found


def _add(found: FeatureList, points: list, name: str | None, label: str) -> None:
    """Add a line of GPX points; one without points is counted."""
    if not points:
        found.others["empty segment"] += 1
        return
    rows = np.array(
        [[point.longitude, point.latitude, np.nan if point.elevation is None else point.elevation] for point in points],
        dtype=np.float64,
    )
    if not np.isfinite(rows[:, :2]).all():
        raise WorldError(f"{label} has a position that is not a number")
    found.add("line", [Coordinates(None).degrees(rows, label)], {"name": name} if name else {}, label)
