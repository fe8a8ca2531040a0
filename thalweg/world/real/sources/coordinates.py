"""Positions of a file in longitude and latitude on WGS84, whatever coordinate reference system the file has.

Longitude and latitude are taken as they are; other systems, such as UTM or Web Mercator, are converted by pyproj,
without grids from the network.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.extra import need
from thalweg.world.real.sources.json_values import is_number, shortened

WGS84 = re.compile(r"(urn:ogc:def:crs:)?(OGC:[\d.]*:?CRS84h?|EPSG:[\d.]*:?4326)", re.IGNORECASE)
"""Names of longitude and latitude on WGS84."""


def positions(values: Any, where: str) -> np.ndarray:
    """Return [K, 3] float64 the numbers in a list of positions: x, y and the elevation, NaN where there is none."""
    if not isinstance(values, list) or not values:
        raise WorldError(f"the coordinates of {where} are {shortened(values)}; expected a list of positions")
    rows = np.full((len(values), 3), np.nan)
    for index, position in enumerate(values):
        if not isinstance(position, list) or len(position) < 2 or not all(map(is_number, position[:3])):
            raise WorldError(
                f"position {index} of {where} is {shortened(position)}; expected longitude, latitude and perhaps "
                "elevation"
            )
        rows[index, : min(len(position), 3)] = position[:3]
    return rows


class Coordinates:
    """Conversion from a coordinate reference system to longitude and latitude on WGS84."""

    def __init__(self, crs: str | None) -> None:
        """`crs` is a name such as EPSG:25832; None for longitude and latitude. Raises `WorldError` for another name."""
        self.name = crs
        self._transform = None
        if crs is None or WGS84.fullmatch(crs.strip()):
            self.name = None
            return
        pyproj = need("pyproj", f"the coordinate reference system {crs}")
        name = crs.strip()
        try:
            system = pyproj.CRS.from_user_input(f"EPSG:{name}" if name.isdecimal() else name)
            self._transform = pyproj.Transformer.from_crs(system, "EPSG:4326", always_xy=True)
        except (pyproj.exceptions.ProjError, ValueError):  # the latter of text that is not Unicode
            raise WorldError(
                f"the coordinate reference system {crs!r} is unknown; name one such as EPSG:4326 (longitude and "
                "latitude), EPSG:3857 (Web Mercator) or EPSG:32632 (UTM zone 32 north)"
            ) from None
        self._is_projected = bool(system.is_projected)
        if not (system.is_projected or system.is_geographic):
            raise WorldError(
                f"{crs} ({system.type_name}) has no positions on a map; name a projected or geographic system, such as"
                " EPSG:32632 or EPSG:4326"
            )

    def degrees(self, rows: np.ndarray, where: str) -> np.ndarray:
        """Return positions [K, 3] in degrees, with the elevation as it is; raises `WorldError` for one off the Earth.

        `where` names them in messages.
        """
        if self._transform is None:
            self._check_degrees(rows, where)
            return rows
        if not self._is_projected:
            self._check_degrees(rows, where)
        like_degrees = (np.abs(rows[:, 0]) <= 180) & (np.abs(rows[:, 1]) <= 90)
        if self._is_projected and like_degrees.any():
            index = int(np.argmax(like_degrees))
            raise WorldError(
                f"position {index} of {where} is {_pair(rows[index])}, which looks like degrees and not like metres in "
                f"{self.name}: give all positions in one system"
            )
        longitude, latitude = self._transform.transform(rows[:, 0], rows[:, 1])
        converted = np.column_stack([longitude, latitude, rows[:, 2]])
        lost = np.flatnonzero(~np.isfinite(converted[:, :2]).all(axis=1))
        if len(lost):
            raise WorldError(
                f"position {lost[0]} of {where} is {_pair(rows[lost[0]])}, which is no place in {self.name}"
            )
        return converted

    def _check_degrees(self, rows: np.ndarray, where: str) -> None:
        wrong = np.flatnonzero((np.abs(rows[:, 0]) > 180) | (np.abs(rows[:, 1]) > 90))
        if not len(wrong):
            return
        rest = "" if len(wrong) == len(rows) else f" ({len(wrong)} of its {len(rows)} positions are like that)"
        raise WorldError(
            f"position {wrong[0]} of {where} is {_pair(rows[wrong[0]])}, which is no longitude (-180 to 180) and "
            f"latitude (-90 to 90) in degrees{rest}: longitude comes first; for projected coordinates, name their "
            "system, such as by crs=EPSG:32632"
        )


def _pair(row: Sequence[float] | np.ndarray) -> str:
    return f"[{row[0]:.10g}, {row[1]:.10g}]"
