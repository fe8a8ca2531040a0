"""Features of Overpass JSON, as its output mode `out geom` gives them: ways, and the rings of multipolygons."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.coordinates import Coordinates, positions
from thalweg.world.real.sources.features import FeatureList
from thalweg.world.real.sources.json_values import shortened

AREAS = ("natural", "place", "water", "landuse", "leisure", "building")
"""Keys of closed ways that are areas; a closed way with another key is a line."""


def is_overpass(data: Any) -> bool:
    """Return whether a JSON value is the answer of an Overpass server."""
    return isinstance(data, dict) and isinstance(data.get("elements"), list)


def overpass_features(data: dict) -> FeatureList:
    """Return the ways and multipolygons of an answer; raises `WorldError` for ways without geometry, and for an answer
    that its server did not finish."""
    found = FeatureList()
    remark = data.get("remark")
    if isinstance(remark, str) and "error" in remark:
        raise WorldError(f"the Overpass server gave up, so that parts are missing: {shortened(remark)}; ask it again")
    for element in data["elements"]:
        if not isinstance(element, dict) or not isinstance(element.get("type"), str):
            raise WorldError(f"not Overpass JSON: {shortened(element)} stands where an element is expected")
        tags = element["tags"] if isinstance(element.get("tags"), dict) else {}
        label = f"{element['type']}/{element.get('id')}"
        if element["type"] == "way":
            _add_way(element, tags, label, found)
        elif element["type"] == "relation" and tags.get("type") == "multipolygon":
            _add_multipolygon(element, tags, label, found)
        else:
            found.others[element["type"]] += 1
    return found


def _add_way(element: dict, tags: Mapping[str, Any], label: str, found: FeatureList) -> None:
    line = _places(element, label)
    closed = len(line) > 3 and np.array_equal(line[0, :2], line[-1, :2])
    area = any(key in tags for key in AREAS) or tags.get("area") == "yes" or tags.get("waterway") == "riverbank"
    found.add("polygon" if closed and area else "line", [line], tags, label)


def _places(element: dict, label: str) -> np.ndarray:
    """Return [K, 3] the geometry of a way; places beyond its ends that are outside the query's box, which are null, are
    left out. Raises `WorldError` for such places between others, over which the way would be a straight line."""
    geometry = element.get("geometry")
    if not isinstance(geometry, list):
        raise WorldError(f"{label} has no geometry: end the query with `out geom;`")
    inside = [index for index, place in enumerate(geometry) if isinstance(place, dict)]
    if inside and len(inside) <= inside[-1] - inside[0]:
        raise WorldError(
            f"{label} leaves the query's box and comes back: end the query with `out geom;`, without a box"
        )
    rows = [[geometry[index].get("lon"), geometry[index].get("lat")] for index in inside]
    return Coordinates(None).degrees(positions(rows, label), label)


def _add_multipolygon(relation: dict, tags: Mapping[str, Any], label: str, found: FeatureList) -> None:
    """Add the polygons of a relation; each hole goes with the outer ring that its first place lies in."""
    members = relation["members"] if isinstance(relation.get("members"), list) else []
    lines: dict[str, list[np.ndarray]] = {"outer": [], "inner": []}
    for member in members:
        if isinstance(member, dict) and member.get("type") == "way":
            role = "inner" if member.get("role") == "inner" else "outer"
            lines[role].append(_places(member, f"{label}, way/{member.get('ref')}"))
    outer, inner = (assemble_rings(parts, label) for parts in (lines["outer"], lines["inner"]))
    for ring in outer:
        holes = [hole for hole in inner if contains(ring, hole[0])]
        found.add("polygon", [ring, *holes], tags, label)


def assemble_rings(parts: list[np.ndarray], label: str) -> list[np.ndarray]:
    """Return the closed rings [K, 3] that lines [K, 3] make up end to end, each turned as it must be.

    Raises `WorldError` for lines that do not close, as where a query's box cuts them.
    """
    rest, rings = list(parts), []
    while rest:
        ring = rest.pop(0)
        while not np.array_equal(ring[0, :2], ring[-1, :2]):
            joined = next((i for i, part in enumerate(rest) if _meets(ring[-1], part)), None)
            if joined is None:
                raise WorldError(
                    f"{label}: a ring of the multipolygon is open at {ring[-1, :2].tolist()}: end the query with "
                    "`out geom;`, without a box"
                )
            part = rest.pop(joined)
            ring = np.concatenate([ring, (part if np.array_equal(part[0, :2], ring[-1, :2]) else part[::-1])[1:]])
        rings.append(ring)
    return rings


def _meets(place: np.ndarray, part: np.ndarray) -> bool:
    return np.array_equal(part[0, :2], place[:2]) or np.array_equal(part[-1, :2], place[:2])


def contains(ring: np.ndarray, place: np.ndarray) -> bool:
    """Return whether a place lies inside a ring [K, 2 or more]: a ray to the east crosses it an odd number of times."""
    x, y = ring[:, 0], ring[:, 1]
    above = y > place[1]
    crosses = np.flatnonzero(above[1:] != above[:-1])
    share = (place[1] - y[crosses]) / (y[crosses + 1] - y[crosses])
    return int(np.count_nonzero(x[crosses] + share * (x[crosses + 1] - x[crosses]) > place[0])) % 2 == 1
