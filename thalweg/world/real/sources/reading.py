"""The features of a file of any known format, which is recognised by its content."""

import json
from pathlib import Path
from typing import Any

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.features import FeatureList
from thalweg.world.real.sources.geojson_features import geojson_features
from thalweg.world.real.sources.gpx import gpx_features
from thalweg.world.real.sources.kml import kml_features
from thalweg.world.real.sources.overpass import is_overpass, overpass_features
from thalweg.world.real.sources.xml_file import UTF_16, local_name, parse_xml

MAX_FILE_BYTES = 64_000_000
"""Maximum size of a file."""
BINARY = (
    (b"PK\x03\x04", "a zip archive, such as KMZ or a zipped shapefile: unpack it first"),
    (b"SQLite format 3", "a database, such as a GeoPackage: convert it with ogr2ogr -f GeoJSON river.geojson {name}"),
    (b"\x00\x00\x27\x0a", "a shapefile: convert it with ogr2ogr -f GeoJSON river.geojson {name}"),
)
"""First bytes of files that are no text, and what to do with them."""
KNOWN = "GeoJSON, Overpass JSON, GPX or KML"


def read_features(path: Path, crs: str | None) -> FeatureList:
    """Return the lines and polygons of a GeoJSON, Overpass JSON, GPX or KML file, in longitude and latitude.

    `crs` is the coordinate reference system of a GeoJSON file that names none, or a wrong one. Raises `WorldError` that
    says what is wrong with the file, without its name.
    """
    content = _read_bytes(path)
    if _is_xml(content):
        found = _xml_features(content)
    else:
        data = _json(content)
        if is_overpass(data):
            found = overpass_features(data)
        else:
            return geojson_features(data, crs)
    if crs is not None:
        raise WorldError(f"crs={crs!r} goes with GeoJSON; GPX, KML and Overpass JSON are in longitude and latitude")
    return found


def _read_bytes(path: Path) -> bytes:
    """Return the content of a file that may hold text."""
    if not path.is_file():
        raise WorldError("there is no such file")
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise WorldError(f"{size / 1e6:.0f} MB; limit {MAX_FILE_BYTES / 1e6:.0f} MB: keep only the river")
    content = path.read_bytes()
    for begin, remedy in BINARY:
        if content.startswith(begin):
            raise WorldError(remedy.format(name=path.name))
    if not content.strip():
        raise WorldError(f"the file is empty; expected {KNOWN}")
    return content


def _is_xml(content: bytes) -> bool:
    """Return whether a text begins as XML does, in UTF-8 or, by its mark, in UTF-16."""
    begin = content[:1024]
    if content[:2] in UTF_16:
        begin = begin.decode("utf-16", "replace").encode("utf-8", "replace")
    return begin.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"<"


def _xml_features(content: bytes) -> FeatureList:
    root = parse_xml(content)
    kind = local_name(root)
    if kind == "gpx":
        return gpx_features(content)
    if kind == "kml":
        return kml_features(root)
    remedy = ": convert it with osmtogeojson river.osm > river.geojson" if kind == "osm" else ""
    raise WorldError(f"XML of the kind <{kind[:40]}>; expected {KNOWN}{remedy}")


def _json(content: bytes) -> Any:
    try:
        encoding = "utf-16" if content[:2] in UTF_16 else "utf-8-sig"
        return json.loads(content.decode(encoding), parse_constant=_refuse_constant)
    except UnicodeDecodeError as reason:
        raise WorldError(f"not text in UTF-8 (byte {reason.start}); expected {KNOWN}") from None
    except ValueError as reason:
        raise WorldError(f"not JSON: {reason}; expected {KNOWN}") from None


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a number")
