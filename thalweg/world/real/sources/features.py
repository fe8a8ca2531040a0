"""Lines and polygons of a file with their tags, in longitude and latitude, before they are read as a river."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from thalweg.world.errors import WorldError

MAX_POSITIONS = 500_000
"""Maximum number of positions in a file."""
ELEVATION_M = (-500.0, 7000.0)
"""Range of elevations of rivers; the usual codes for a missing value lie outside."""


@dataclass(frozen=True)
class Feature:
    """A line, or a polygon, with its tags."""

    kind: Literal["line", "polygon"]
    rings: tuple[np.ndarray, ...]
    """[K, 3] float64 each: longitude and latitude in degrees on WGS84, and the elevation in metres, NaN where there is
    none. A line has one; a polygon has its outer ring, then its holes, each with the first position repeated."""
    tags: Mapping[str, Any]
    label: str
    """Its name in messages, such as `way/4711` or `feature 3`."""


@dataclass
class FeatureList:
    """The features of a file, as a reader finds them."""

    features: list[Feature] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)
    """Number of features of other kinds, such as points."""
    positions: int = 0
    """Number of positions so far."""

    def add(self, kind: Literal["line", "polygon"], rings: list[np.ndarray], tags: Mapping[str, Any], label: str):
        """Add a feature; raises `WorldError` for one that is no line or polygon, or for a file with too many places."""
        self.positions += sum(map(len, rings))
        if self.positions > MAX_POSITIONS:
            raise WorldError(f"more than {MAX_POSITIONS} positions: keep only the river, its bridges and islands")
        for ring in rings:
            self._check_ring(kind, ring, label)
        self.features.append(Feature(kind, tuple(rings), tags, label))

    @staticmethod
    def _check_ring(kind: str, ring: np.ndarray, label: str) -> None:
        if kind == "line" and len(ring) < 2:
            raise WorldError(f"{label} is a line of {len(ring)} positions; at least 2 are needed")
        if kind == "polygon" and (len(ring) < 4 or not np.array_equal(ring[0, :2], ring[-1, :2])):
            raise WorldError(
                f"{label}: a ring of a polygon has {len(ring)} positions, which "
                f"{'are too few' if len(ring) < 4 else 'do not end where they begin'}; expected at least 4, with the "
                "first one repeated at the end"
            )
        low, high = ELEVATION_M
        wrong = np.flatnonzero((ring[:, 2] < low) | (ring[:, 2] > high))
        if len(wrong):
            raise WorldError(
                f"{label}: the elevation of position {wrong[0]} is {ring[wrong[0], 2]:g} m; limit {low:g} to {high:g} m"
            )
