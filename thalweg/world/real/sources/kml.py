"""Features of KML: the lines and polygons of its placemarks, with their extended data as tags.

Altitudes count only where `altitudeMode` is `absolute`; elsewhere KML says that they are relative to the ground.
"""

import math
from typing import Any

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.coordinates import Coordinates
from thalweg.world.real.sources.features import FeatureList
from thalweg.world.real.sources.json_values import shortened
from thalweg.world.real.sources.xml_file import local_name


def kml_features(root: Any) -> FeatureList:
    """Return the lines and polygons of a KML document; points and other geometries are counted."""
    found = FeatureList()
    for index, placemark in enumerate(each for each in root.iter() if local_name(each) == "Placemark"):
        tags = _tags(placemark)
        label = f"placemark {tags.get('name', index)}"
        for element in placemark.iter():
            name = local_name(element)
            if name == "LineString":
                found.add("line", [_coordinates(element, element, label)], tags, label)
            elif name == "Polygon":
                outer, inner = ([*_rings(element, kind, label)] for kind in ("outerBoundaryIs", "innerBoundaryIs"))
                if len(outer) != 1:
                    raise WorldError(f"{label}: a Polygon has {len(outer)} outer boundaries; expected one")
                found.add("polygon", [*outer, *inner], tags, label)
            elif name in ("Point", "Track", "Model"):
                found.others[name] += 1
    return found


def _tags(placemark: Any) -> dict[str, Any]:
    """Return the name and the extended data of a placemark."""
    tags: dict[str, Any] = {}
    for element in placemark.iter():
        name, key = local_name(element), element.get("name")
        if name == "Data" and key:
            tags[key] = " ".join("".join(child.itertext()) for child in element if local_name(child) == "value").strip()
        elif name == "SimpleData" and key:
            tags[key] = "".join(element.itertext()).strip()
    names = [(child.text or "").strip() for child in placemark if local_name(child) == "name"]
    if names and names[0]:
        tags.setdefault("name", names[0])
    return tags


def _rings(polygon: Any, boundary: str, label: str) -> list[np.ndarray]:
    return [
        _coordinates(ring, polygon, label)
        for child in polygon
        if local_name(child) == boundary
        for ring in child.iter()
        if local_name(ring) == "LinearRing"
    ]


def _coordinates(element: Any, geometry: Any, label: str) -> np.ndarray:
    """Return [K, 3] the places of an element; its geometry says whether the altitudes are elevations."""
    modes = [child.text for child in geometry if local_name(child) == "altitudeMode"]
    absolute = modes[:1] == ["absolute"]
    texts = [child.text or "" for child in element if local_name(child) == "coordinates"]
    rows = []
    for word in " ".join(texts).split():
        parts = word.split(",")
        try:
            numbers = [float(part) for part in parts]
        except ValueError:
            numbers = []
        if len(numbers) < 2 or not all(map(math.isfinite, numbers)):
            raise WorldError(f"{label}: {shortened(word)} is no position; expected longitude,latitude,altitude")
        rows.append([*numbers[:2], numbers[2] if absolute and len(numbers) > 2 else np.nan])
    if not rows:
        raise WorldError(f"{label} has no coordinates")
    return Coordinates(None).degrees(np.array(rows), label)
