"""Features of GeoJSON: all lines and polygons of a file, with their properties."""

import re
from collections.abc import Mapping
from typing import Any

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.coordinates import Coordinates, positions
from thalweg.world.real.sources.features import FeatureList
from thalweg.world.real.sources.json_values import shortened

HSTORE = re.compile(r'"((?:[^"\\]|\\.)*)"\s*=>\s*"((?:[^"\\]|\\.)*)"')
"""A pair in the property `other_tags`, in which ogr2ogr puts tags that have no column of their own."""
IDENTIFIERS = ("@id", "id", "osm_id", "osm_way_id", "fid")
"""Properties that may name a feature."""


def geojson_features(data: Any, crs: str | None) -> FeatureList:
    """Return the lines and polygons of a GeoJSON value; `crs` replaces the system that the file names.

    Raises `WorldError` for anything that is not GeoJSON.
    """
    found = FeatureList()
    coordinates = Coordinates(crs if crs is not None else _crs_of(data))
    _walk(data, {}, None, coordinates, found)
    return found


def _crs_of(data: Any) -> str | None:
    """Return the name in the `crs` member of the outermost object, which older GeoJSON has; None if there is none."""
    crs = data.get("crs") if isinstance(data, dict) else None
    if crs is None:
        return None
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise WorldError(f"its crs is {shortened(crs)}; expected a name: give it, such as by crs=EPSG:25832")
    return name


def _walk(value: Any, tags: Mapping[str, Any], label: str | None, coordinates: Coordinates, found: FeatureList) -> None:
    """Add the lines and polygons of an object, with the tags of its feature."""
    kind = value.get("type") if isinstance(value, dict) else None
    if not isinstance(value, dict) or not isinstance(kind, str):
        raise WorldError(f"not GeoJSON: {shortened(value)} stands where an object with a `type` is expected")
    if kind in ("FeatureCollection", "GeometryCollection"):
        key = "features" if kind == "FeatureCollection" else "geometries"
        if not isinstance(value.get(key), list):
            raise WorldError(f"not GeoJSON: the {kind} has no list of {key}")
        for index, member in enumerate(value[key]):
            _walk(member, tags, label if kind == "GeometryCollection" else f"feature {index}", coordinates, found)
    elif kind == "Feature":
        own = tags_of(value.get("properties"))
        if value.get("geometry") is None:
            found.others["empty Feature"] += 1
        else:
            _walk(value["geometry"], own, _label(value, own) or label, coordinates, found)
    elif kind in ("LineString", "MultiLineString", "Polygon", "MultiPolygon"):
        _add_geometry(kind, value.get("coordinates"), tags, label or f"the {kind}", coordinates, found)
    elif kind in ("Point", "MultiPoint"):
        found.others[kind] += 1
    else:
        raise WorldError(
            f"not GeoJSON: the type {shortened(kind)} is unknown; expected FeatureCollection, Feature, LineString, "
            "MultiLineString, Polygon or MultiPolygon"
        )


def _add_geometry(
    kind: str, parts: Any, tags: Mapping[str, Any], label: str, coordinates: Coordinates, found: FeatureList
) -> None:
    """Add the lines or polygons of one geometry."""
    several = kind.startswith("Multi")
    if several and (not isinstance(parts, list) or not parts):
        raise WorldError(f"{label} has no parts: its coordinates are {shortened(parts)}")
    if several and isinstance(tags.get("width_m", tags.get("width")), list):
        raise WorldError(f"{label}: a list of widths needs a LineString; a {kind} has one width")
    for index, part in enumerate(parts if several else [parts]):
        where = f"part {index} of {label}" if several and len(parts) > 1 else label
        if kind.endswith("LineString"):
            found.add("line", [coordinates.degrees(positions(part, where), where)], tags, where)
        else:
            if not isinstance(part, list) or not part:
                raise WorldError(f"{where} has no rings: its coordinates are {shortened(part)}")
            rings = [coordinates.degrees(positions(ring, where), where) for ring in part]
            found.add("polygon", rings, tags, where)


def tags_of(properties: Any) -> dict[str, Any]:
    """Return properties as flat tags: those of osmtogeojson stand under `tags`, some of ogr2ogr's in `other_tags`."""
    own = dict(properties) if isinstance(properties, dict) else {}
    nested = own.pop("tags", None)
    if isinstance(nested, dict):
        own = {**own, **nested}
        # What osmtogeojson puts beside the tags is no tag, and its `type` is that of the element.
        own.pop("type", None)
    packed = own.pop("other_tags", None)
    if isinstance(packed, str):
        own = {**{key: text.replace('\\"', '"') for key, text in HSTORE.findall(packed)}, **own}
    return {key: value for key, value in own.items() if value is not None}


def _label(feature: dict, tags: Mapping[str, Any]) -> str | None:
    """Return the identifier of a feature, if it has one."""
    values = [feature.get("id"), *(tags.get(key) for key in IDENTIFIERS)]
    found = next((value for value in values if isinstance(value, str | int) and not isinstance(value, bool)), None)
    return None if found is None else str(found)[:40]
