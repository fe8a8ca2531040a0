"""Files of rivers with several ways, banks, bridges and islands, in metres about 11 degrees east, 48 degrees north."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.world.real.file_river import RiverPlan, plan_file
from thalweg.world.real.geodesy import degrees_of
from thalweg.world.real.selection import Selection


def from_metres(places) -> list[list[float]]:
    """Longitude and latitude of places [K, 2]."""
    return degrees_of(np.asarray(places, dtype=float), np.array([11.0, 48.0])).tolist()


def line(metres, **tags: Any) -> dict:
    return _feature("LineString", from_metres(metres), tags)


def polygon(*rings, **tags: Any) -> dict:
    return _feature("Polygon", [from_metres(ring) for ring in rings], tags)


def box(west: float, south: float, east: float, north: float) -> list[tuple[float, float]]:
    return [(west, south), (east, south), (east, north), (west, north), (west, south)]


def _feature(kind: str, coordinates: Any, tags: dict) -> dict:
    return {"type": "Feature", "properties": tags, "geometry": {"type": kind, "coordinates": coordinates}}


def write(folder: Path, *features: dict, name: str = "river.geojson", **members: Any) -> Path:
    path = folder / name
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features), **members}))
    return path


def planned(path: Path, **options: Any) -> RiverPlan:
    return plan_file(path, Selection(**options))


def straight(start: float = 0.0, stop: float = 200.0, count: int = 9, y: float = 0.0) -> np.ndarray:
    """Places [count, 2] along the x axis, or beside it."""
    return np.column_stack([np.linspace(start, stop, count), np.full(count, y)])
