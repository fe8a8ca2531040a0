"""The `World` record: a river valley as plain arrays, the same whether it comes from a seed, a line or a file.

Dimension letters: S river samples, M plants, B bridges, I islands, GY x GX grid nodes (row = y, column = x). Metres,
radians; x east, y north, z up; angles counter-clockwise from +x.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from thalweg.world.banks import Banks

if TYPE_CHECKING:
    from pathlib import Path

FORMAT = 1
"""Version of the file format; a file of another version is refused. It does not describe the generator:
`thalweg.world.store.world_cache.GENERATOR_HASH` separates worlds of different generators in the cache."""


@dataclass(frozen=True)
class River:
    """The course: a line of samples about 1.3 m apart with the width, depth and water level at each."""

    closed: bool
    """Whether the last sample is joined to the first. A closed course has S segments, an open one S - 1."""
    position_m: np.ndarray
    """[S, 2] float64, x and y of the centre line."""
    arc_m: np.ndarray
    """[S] float64, arc length at each sample; arc_m[0] = 0."""
    length_m: float
    """Total length: of the loop with its closing segment, or of the open line."""
    tangent: np.ndarray
    """[S, 2] float64, unit vectors in the direction of growing arc length."""
    width_m: np.ndarray
    """[S] float64, from bank to bank across the centre line; the bank is the water's edge."""
    depth_m: np.ndarray
    """[S] float64, depth of the bed below the local water level on the centre line."""
    level_m: np.ndarray
    """[S] float64, height z of the water's surface."""

    @property
    def segments(self) -> int:
        """Number of segments between the samples."""
        return len(self.arc_m) if self.closed else len(self.arc_m) - 1


@dataclass(frozen=True)
class Grid:
    """Map layout: node (row, column) is at x = origin_x_m + column * cell_m, y = origin_y_m + row * cell_m."""

    origin_x_m: float
    origin_y_m: float
    cell_m: float


@dataclass(frozen=True)
class Plants:
    """Everything drawn as an impostor: trees, shrubs, reeds and rocks, one row each, in no particular order."""

    position_m: np.ndarray
    """[M, 3] float32, the foot, which is on the ground."""
    height_m: np.ndarray
    """[M] float32."""
    width_m: np.ndarray
    """[M] float32, full width of the crown."""
    kind: np.ndarray
    """[M] int16, index into `thalweg.world.species.KINDS`."""
    turn: np.ndarray
    """[M] float32, rotation about the vertical axis in radians. The renderer ignores it: it shows each kind from the
    side that the view direction and the sun choose."""
    tint: np.ndarray
    """[M, 3] float32, factors on the reflectance of red, green and blue; about 1."""
    light: np.ndarray
    """[M, 2] float32 in 0..1, the share of direct sun that reaches the foot and the top of the plant."""


@dataclass(frozen=True, repr=False)
class World:
    """A river valley: its course, its solid objects, and maps of its surface with baked light."""

    name: str
    seed: int
    river: River
    islands: np.ndarray
    """[I, 5] float64: ellipses x, y, semi-axis along, semi-axis across, angle of the first one. They are
    outside the flight volume."""
    bridges: np.ndarray
    """[B, 11] float64, columns as in `BRIDGE`."""
    grid: Grid
    ground_m: np.ndarray
    """[GY, GX] float32, height of the ground; under water it is that of the bed."""
    water_m: np.ndarray
    """[GY, GX] float32, height of the water's surface, continued smoothly under dry land; a node is wet where this
    is above `ground_m`."""
    albedo: np.ndarray
    """[GY, GX, 3] uint8, reflectance of the ground, square-root coded: linear = (value / 255)**2."""
    sun: np.ndarray
    """[GY, GX] uint8, share of the direct sun that reaches the upper surface (water or ground), 255 = all."""
    sky: np.ndarray
    """[GY, GX] uint8, share of the sky's light that reaches the upper surface (ambient occlusion), 255 = all."""
    canopy_m: np.ndarray
    """[GY, GX] float32, height of the tops of plants and bridges, or of the ground or water where there are none."""
    plants: Plants
    sun_azimuth: float
    """Direction towards the sun in radians."""
    sun_elevation: float
    """Height of the sun in radians."""
    banks: Banks = ()
    """Reaches whose banks are not forest; the maps and plants show them already."""

    def __repr__(self) -> str:
        river = self.river
        return (
            f"World({self.name!r}, seed {self.seed}: {'a loop' if river.closed else 'an open course'} of"
            f" {river.length_m:.0f} m, {len(self.bridges)} bridges, {len(self.islands)} islands,"
            f" {len(self.plants.kind):,} plants)"
        )

    @property
    def label(self) -> str:
        """Name and seed, such as Medium-1000."""
        return f"{self.name}-{self.seed}"

    def covers(self, x: float, y: float) -> bool:
        """Return whether a position in metres is on the map; False for NaN."""
        grid, (rows, columns) = self.grid, self.ground_m.shape
        across, up = (x - grid.origin_x_m) / grid.cell_m, (y - grid.origin_y_m) / grid.cell_m
        return bool(0 <= across <= columns - 1 and 0 <= up <= rows - 1)

    if TYPE_CHECKING:
        # Bound in `thalweg/world/__init__.py`, so that the record imports nothing that builds, lights or stores worlds.
        @staticmethod
        def from_centerline(
            points: np.ndarray, closed: bool = True, *, seed: int = 0, plants: bool = True, banks: Any = ()
        ) -> "World": ...

        @staticmethod
        def from_file(path: str | Path, *, seed: int = 0, plants: bool = True, **options: Any) -> "World": ...

        @staticmethod
        def from_geojson(path: str | Path, *, seed: int = 0, plants: bool = True, **options: Any) -> "World": ...

        @staticmethod
        def load(path: str | Path) -> "World": ...

        def save(self, /, path: str | Path) -> None: ...

        def relit(self, /, azimuth: float, elevation: float) -> "World": ...


BRIDGE = (
    "x",
    "y",
    "angle",
    "length",
    "width",
    "span",
    "spring_z",
    "rise",
    "deck_z",
    "hump",
    "parapet",
)
"""Columns of `World.bridges`. In the bridge's own frame u runs along its length (direction `angle`, across the river),
v across its deck, z up. It fills |u| <= length/2, |v| <= width/2 from its arch to its deck.
Top of the deck: deck_z - hump * (u / (length/2))**2. Arch: half an ellipse, half axes span/2 and rise, over spring_z.
Parapets 0.3 m thick stand `parapet` metres above the deck's edge."""

PARAPET_THICKNESS_M = 0.3
