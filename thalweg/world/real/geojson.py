"""What is in a GeoJSON file? One line of longitude and latitude with its widths and elevations, or what is wrong.

RFC 7946, as far as a river's centre line needs it, and the `crs` member of its forerunner, which older programs still
write. Nothing here measures; `thalweg.world.real.published_river` makes a course of what is read.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.world.errors import WorldError

MOST_BYTES = 64_000_000
"""Largest file that is read."""
ELEVATION_M = (-500.0, 7000.0)
"""Between these flow all rivers; the usual marks for a missing value lie outside."""
MOST_NAME = 40
"""Letters of a world's name."""
SAME_PLACE = 6
"""Decimals of a degree, 0.1 m, in which the ends of two parts agree where they join."""
LINES = ("LineString", "MultiLineString")
OTHERS = ("Point", "MultiPoint", "Polygon", "MultiPolygon")
WGS84 = re.compile(r"(urn:ogc:def:crs:)?(OGC:[\d.]*:?CRS84h?|EPSG:[\d.]*:?4326)", re.IGNORECASE)
"""Names of longitude and latitude on WGS84, as the `crs` member gives them."""

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


def read_track(path: Path, width_m: float | None) -> Track:
    """The one line in a GeoJSON file; `width_m` serves where the file gives no width.

    Raises `WorldError` that says what is wrong with the file, without its name.
    """
    geometry, properties = only_line(parse(path))
    positions = joined(geometry)
    degrees = np.array([position[:2] for position in positions], dtype=np.float64)
    widths = read_widths(properties, geometry["type"], len(positions), width_m)
    return Track(read_name(properties, path.stem), degrees, widths, read_elevations(positions))


def parse(path: Path) -> Any:
    """The value of a JSON file."""
    if not path.is_file():
        raise WorldError("there is no such file")
    if (size := path.stat().st_size) > MOST_BYTES:
        raise WorldError(f"{size / 1e6:.0f} MB; limit {MOST_BYTES / 1e6:.0f} MB: keep only the river's line")
    try:
        return json.loads(path.read_bytes().decode("utf-8-sig"), parse_constant=_refuse_constant)
    except UnicodeDecodeError as reason:
        raise WorldError(f"not text in UTF-8 (byte {reason.start})") from None
    except ValueError as reason:
        raise WorldError(f"not JSON: {reason}") from None


def _refuse_constant(word: str) -> float:
    raise ValueError(f"{word} is no number")


def only_line(data: Any) -> tuple[dict, dict]:
    """The geometry of the only line and the properties of its feature."""
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
    """Every line geometry in a GeoJSON object with the properties of its feature; other kinds are counted."""
    kind = value.get("type") if isinstance(value, dict) else None
    if not isinstance(value, dict) or not isinstance(kind, str):
        raise WorldError(f"not GeoJSON: {_short(value)} stands where an object with a `type` is expected")
    _check_crs(value.get("crs"))
    if kind in LINES:
        yield value, properties
    elif kind in OTHERS:
        others[kind] += 1
    elif kind == "Feature":
        if value.get("geometry") is None:
            others["Feature without geometry"] += 1
            return
        own = value.get("properties")
        yield from _lines(value["geometry"], own if isinstance(own, dict) else {}, others)
    elif kind in ("FeatureCollection", "GeometryCollection"):
        key = "features" if kind == "FeatureCollection" else "geometries"
        if not isinstance(value.get(key), list):
            raise WorldError(f"not GeoJSON: the {kind} has no list of {key}")
        for member in value[key]:
            yield from _lines(member, properties, others)
    else:
        raise WorldError(
            f"not GeoJSON: the type {_short(kind)} is unknown; expected FeatureCollection, Feature, LineString or "
            "MultiLineString"
        )


def _check_crs(crs: Any) -> None:
    """Raise `WorldError` for coordinates in anything but longitude and latitude on WGS84."""
    if crs is None:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str) or WGS84.fullmatch(name) is None:
        raise WorldError(
            f"its crs is {_short(name if name is not None else crs)}; expected longitude and latitude on WGS84 "
            "(OGC:CRS84 or EPSG:4326): convert it first"
        )


def joined(geometry: dict) -> list[Position]:
    """The positions of a line, or of the parts of a MultiLineString that join end to end, in whatever order."""
    coordinates = geometry.get("coordinates")
    if geometry["type"] == "LineString":
        return _positions(coordinates, "")
    if not isinstance(coordinates, list) or not coordinates:
        raise WorldError(f"the MultiLineString has no parts: its coordinates are {_short(coordinates)}")
    parts = [_positions(part, f" of part {index}") for index, part in enumerate(coordinates)]
    starts: dict[tuple, int] = {}
    for index, part in enumerate(parts):
        if (twin := starts.setdefault(_place(part[0]), index)) != index:
            raise WorldError(f"parts {twin} and {index} of the MultiLineString both begin at {part[0][:2]}: a fork")
    ends = {_place(part[-1]) for part in parts}
    chain = [next((index for place, index in starts.items() if place not in ends), 0)]
    while (following := starts.get(_place(parts[chain[-1]][-1]))) is not None and following not in chain:
        chain.append(following)
    if left := sorted(set(range(len(parts))) - set(chain)):
        raise WorldError(
            f"part {left[0]} of the MultiLineString begins at {parts[left[0]][0][:2]} and does not join the others, "
            f"which end at {parts[chain[-1]][-1][:2]}; each part must begin where another ends"
        )
    return parts[chain[0]] + [position for index in chain[1:] for position in parts[index][1:]]


def _place(position: Position) -> tuple[float, float]:
    return round(position[0], SAME_PLACE), round(position[1], SAME_PLACE)


def _positions(coordinates: Any, where: str) -> list[Position]:
    """Checked positions of a line: longitude, latitude and perhaps elevation; `where` is for the message."""
    if not isinstance(coordinates, list) or len(coordinates) < 2:
        raise WorldError(f"the coordinates{where} are {_short(coordinates)}; expected at least two positions")
    for index, position in enumerate(coordinates):
        if not isinstance(position, list) or len(position) < 2 or not all(map(_is_number, position[:3])):
            raise WorldError(
                f"position {index}{where} is {_short(position)}; expected longitude, latitude and perhaps elevation"
            )
        if abs(position[0]) > 180 or abs(position[1]) > 90:
            raise WorldError(
                f"position {index}{where} is {_short(position[:2])}, which is no longitude (-180 to 180) and latitude "
                "(-90 to 90) in degrees: convert projected coordinates to WGS84, longitude first"
            )
    return coordinates


def _is_number(value: Any) -> bool:
    """Whether a value of JSON is a finite number; true and false are none, and 1e999 is infinite."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf


def read_elevations(positions: list[Position]) -> np.ndarray | None:
    """[K] the third coordinates, or None where there are none."""
    given = [len(position) > 2 for position in positions]
    if not any(given):
        return None
    if not all(given):
        raise WorldError(f"position {given.index(False)} has no elevation, others have: give all of them or none")
    low, high = ELEVATION_M
    for index, position in enumerate(positions):
        if not low <= position[2] <= high:
            raise WorldError(f"the elevation of position {index} is {position[2]:g} m; limit {low:g} to {high:g} m")
    return np.array([position[2] for position in positions], dtype=np.float64)


def read_widths(properties: dict, kind: str, count: int, default: float | None) -> np.ndarray:
    """[count] widths in metres: of the property `width_m` or `width`, else the default."""
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
    """A width in metres; a string of a plain number counts, as map data has it."""
    try:
        number = float(value) if isinstance(value, str) else value
    except ValueError:
        number = None
    if not isinstance(number, int | float) or not _is_number(number) or number <= 0:
        raise WorldError(f"{name} is {_short(value)}; expected a number of metres above 0")
    return float(number)


def read_name(properties: dict, stem: str) -> str:
    """What the river is called: its property `name`, else the file's name."""
    name = properties.get("name")
    words = name.split() if isinstance(name, str) else []
    return " ".join(words)[:MOST_NAME] or stem[:MOST_NAME]


def _short(value: Any) -> str:
    """A value as JSON, cut to fit in a message."""
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
