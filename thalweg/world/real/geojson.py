"""Reader of GeoJSON files with a river's centre line: longitude and latitude, widths and elevations.

It follows RFC 7946 as far as a centre line needs it, and reads the older `crs` member, which some programs still write.
Nothing is measured here; `thalweg.world.real.geojson_river` turns the line into a course.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.real.bank_stretches import Stretch, stretches_of

MAX_FILE_BYTES = 64_000_000
"""Maximum size of a file."""
ELEVATION_M = (-500.0, 7000.0)
"""Range of elevations of rivers; the usual codes for a missing value lie outside."""
MAX_NAME_LENGTH = 40
"""Maximum number of characters of a world's name."""
JOINT_DECIMALS = 6
"""Decimals of a degree (0.1 m) to which the ends of two joined parts must agree."""
LINES = ("LineString", "MultiLineString")
OTHERS = ("Point", "MultiPoint", "Polygon", "MultiPolygon")
WGS84 = re.compile(r"(urn:ogc:def:crs:)?(OGC:[\d.]*:?CRS84h?|EPSG:[\d.]*:?4326)", re.IGNORECASE)
"""Names of longitude and latitude on WGS84 in the `crs` member."""

Position = list[float]


@dataclass(frozen=True)
class Track:
    """A line on the Earth, in the order of its positions."""

    name: str
    degrees: np.ndarray
    """[K, 2] float64, longitude and latitude on WGS84."""
    width_m: np.ndarray
    """[K] float64."""
    elevation_m: np.ndarray | None
    """[K] float64, or None where the file gives none."""
    stretches: tuple[Stretch, ...] = ()
    """What the file says of the kinds of banks."""


def read_track(path: Path, width_m: float | None) -> Track:
    """Return the only line in a GeoJSON file; `width_m` is used where the file gives no width.

    Raises `WorldError` that says what is wrong with the file, without its name.
    """
    geometry, properties = find_line(read_json(path))
    positions = join_lines(geometry)
    degrees = np.array([position[:2] for position in positions], dtype=np.float64)
    widths = read_widths(properties, geometry["type"], len(positions), width_m)
    stretches = tuple(stretches_of(degrees, properties.get("banks"), "the line"))
    return Track(read_name(properties, path.stem), degrees, widths, read_elevations(positions), stretches)


def read_json(path: Path) -> Any:
    """Return the value of a JSON file."""
    if not path.is_file():
        raise WorldError("there is no such file")
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        raise WorldError(f"{size / 1e6:.0f} MB; limit {MAX_FILE_BYTES / 1e6:.0f} MB: keep only the river's line")
    try:
        return json.loads(path.read_bytes().decode("utf-8-sig"), parse_constant=_refuse_constant)
    except UnicodeDecodeError as reason:
        raise WorldError(f"not text in UTF-8 (byte {reason.start})") from None
    except ValueError as reason:
        raise WorldError(f"not JSON: {reason}") from None


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is not a number")


def find_line(data: Any) -> tuple[dict, dict]:
    """Return the geometry of the only line and the properties of its feature."""
    others: Counter[str] = Counter()
    found = list(_lines(data, {}, others))
    if not found:
        seen = ", ".join(f"{count} {kind}" for kind, count in others.items()) or "nothing"
        raise WorldError(f"no line in it, but {seen}; expected one LineString or MultiLineString")
    if len(found) > 1:
        raise WorldError(
            f"{len(found)} lines in it; expected one: keep the reach to fly, or make the parts one MultiLineString"
        )
    return found[0]


def _lines(value: Any, properties: dict, others: Counter[str]) -> Iterator[tuple[dict, dict]]:
    """Yield every line geometry of an object with the properties of its feature; count other kinds in `others`."""
    kind = value.get("type") if isinstance(value, dict) else None
    if not isinstance(value, dict) or not isinstance(kind, str):
        raise WorldError(f"not GeoJSON: {shortened(value)} stands where an object with a `type` is expected")
    _check_crs(value.get("crs"))
    if kind in LINES:
        yield value, properties
    elif kind in OTHERS:
        others[kind] += 1
    elif kind == "Feature":
        if value.get("geometry") is None:
            others["Feature without geometry"] += 1
            return
        attributes = value.get("properties")
        yield from _lines(value["geometry"], attributes if isinstance(attributes, dict) else {}, others)
    elif kind in ("FeatureCollection", "GeometryCollection"):
        key = "features" if kind == "FeatureCollection" else "geometries"
        if not isinstance(value.get(key), list):
            raise WorldError(f"not GeoJSON: the {kind} has no list of {key}")
        for member in value[key]:
            yield from _lines(member, properties, others)
    else:
        raise WorldError(
            f"not GeoJSON: the type {shortened(kind)} is unknown; expected FeatureCollection, Feature, LineString or "
            "MultiLineString"
        )


def _check_crs(crs: Any) -> None:
    """Raise `WorldError` for coordinates that are not longitude and latitude on WGS84."""
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or WGS84.fullmatch(name) is None:
        raise WorldError(
            f"its crs is {shortened(name if name is not None else crs)}; expected longitude and latitude on WGS84 "
            "(OGC:CRS84 or EPSG:4326): convert it first"
        )


def join_lines(geometry: dict) -> list[Position]:
    """Return the positions of a line, or of the parts of a MultiLineString that join end to end, in any order."""
    coordinates = geometry.get("coordinates")
    if geometry["type"] == "LineString":
        return _positions(coordinates, "")
    if not isinstance(coordinates, list) or not coordinates:
        raise WorldError(f"the MultiLineString has no parts: its coordinates are {shortened(coordinates)}")
    parts = [_positions(part, f" of part {index}") for index, part in enumerate(coordinates)]
    starts: dict[tuple, int] = {}
    for index, part in enumerate(parts):
        if (other := starts.setdefault(_joint(part[0]), index)) != index:
            raise WorldError(f"parts {other} and {index} of the MultiLineString both begin at {part[0][:2]}: a fork")
    ends = {_joint(part[-1]) for part in parts}
    # The chain begins with the part that follows no other; a ring may begin anywhere.
    chain = [next((index for joint, index in starts.items() if joint not in ends), 0)]
    while (following := starts.get(_joint(parts[chain[-1]][-1]))) is not None and following not in chain:
        chain.append(following)
    if unjoined := sorted(set(range(len(parts))) - set(chain)):
        raise WorldError(
            f"part {unjoined[0]} of the MultiLineString begins at {parts[unjoined[0]][0][:2]} and does not join the "
            f"others, which end at {parts[chain[-1]][-1][:2]}; each part must begin where another ends"
        )
    return parts[chain[0]] + [position for index in chain[1:] for position in parts[index][1:]]


def _joint(position: Position) -> tuple[float, float]:
    """Return a position rounded so that the ends of joined parts are equal."""
    return round(position[0], JOINT_DECIMALS), round(position[1], JOINT_DECIMALS)


def _positions(coordinates: Any, context: str) -> list[Position]:
    """Return the checked positions of a line; `context` is used in messages."""
    if not isinstance(coordinates, list) or len(coordinates) < 2:
        raise WorldError(f"the coordinates{context} are {shortened(coordinates)}; expected at least two positions")
    for index, position in enumerate(coordinates):
        if not isinstance(position, list) or len(position) < 2 or not all(map(is_number, position[:3])):
            raise WorldError(
                f"position {index}{context} is {shortened(position)}; expected longitude, latitude and perhaps "
                "elevation"
            )
        if abs(position[0]) > 180 or abs(position[1]) > 90:
            raise WorldError(
                f"position {index}{context} is {shortened(position[:2])}, which is no longitude (-180 to 180) and "
                "latitude (-90 to 90) in degrees: convert projected coordinates to WGS84, longitude first"
            )
    return coordinates


def is_number(value: Any) -> bool:
    """Return whether a JSON value is a number that a float holds; true and false are not, and 1e999 is infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def read_elevations(positions: list[Position]) -> np.ndarray | None:
    """Return [K] the third coordinates, or None if there are none."""
    has_elevation = [len(position) > 2 for position in positions]
    if not any(has_elevation):
        return None
    if not all(has_elevation):
        raise WorldError(
            f"position {has_elevation.index(False)} has no elevation, but others have: give all of them or none"
        )
    low, high = ELEVATION_M
    for index, position in enumerate(positions):
        if not low <= position[2] <= high:
            raise WorldError(f"the elevation of position {index} is {position[2]:g} m; limit {low:g} to {high:g} m")
    return np.array([position[2] for position in positions], dtype=np.float64)


def read_widths(properties: dict, kind: str, count: int, default: float | None) -> np.ndarray:
    """Return [count] widths in metres: from the property `width_m` or `width`, else the default."""
    key = next((key for key in ("width_m", "width") if properties.get(key) is not None), None)
    if key is None and default is None:
        raise WorldError(
            "no width: give the property width_m, a number of metres or a list of one for each position, or pass "
            "width_m"
        )
    value = properties[key] if key is not None else default
    if isinstance(value, list):
        if kind != "LineString":
            raise WorldError(f"{key} is a list, which needs a LineString; a MultiLineString has one width")
        if len(value) != count:
            raise WorldError(f"{key} has {len(value)} numbers for {count} positions; expected one for each")
        return np.array([_width(f"{key}[{index}]", one) for index, one in enumerate(value)])
    return np.full(count, _width(key or "width_m", value))


def _width(name: str, value: Any) -> float:
    """Return a width in metres; a string with a plain number is accepted, because map data has it."""
    try:
        number = float(value) if isinstance(value, str) else value
    except ValueError:
        number = None
    if not isinstance(number, int | float) or not is_number(number) or number <= 0:
        raise WorldError(f"{name} is {shortened(value)}; expected a number of metres above 0")
    return float(number)


def read_name(properties: dict, stem: str) -> str:
    """Return the river's name: its property `name`, else the file's name."""
    name = properties.get("name")
    # JSON can hold halves of characters, which nothing can print.
    words = name.encode("utf-8", "replace").decode().split() if isinstance(name, str) else []
    return " ".join(words)[:MAX_NAME_LENGTH] or stem[:MAX_NAME_LENGTH]


def shortened(value: Any) -> str:
    """Return a value as JSON, cut to fit in a message."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
