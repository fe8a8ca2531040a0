"""GeoJSON files of short lines, for the tests of real rivers."""

import json
from pathlib import Path

import numpy as np

from thalweg.world.real.file_river import read_centerline
from thalweg.world.real.geodesy import local_metres
from thalweg.world.real.reach_line import Centerline

EAST = [[7.0, 45.0], [7.005, 45.0], [7.01, 45.0], [7.015, 45.0], [7.02, 45.0]]
"""1576.937 m along the parallel of 45 degrees, 394.234 m a piece: a hundredth of a degree is 788.468 m there."""


def feature(coordinates, kind: str = "LineString", **properties) -> dict:
    return {
        "type": "Feature",
        "properties": {"width_m": 12} | properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def from_metres(line) -> list[list[float]]:
    """Longitude and latitude of places [K, 2] in metres about 11 degrees east, 48 degrees north, good to a few mm."""
    hundredth = local_metres(np.array([[11.01, 48.01]]), np.array([11.0, 48.0]))[0]
    return (np.array([11.0, 48.0]) + 0.01 * np.asarray(line, dtype=float) / hundredth).tolist()


def written(folder: Path, content) -> Path:
    path = folder / "river.geojson"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def read(folder: Path, content, **options) -> Centerline:
    return read_centerline(written(folder, content), **options)
