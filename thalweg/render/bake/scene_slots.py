"""`SceneSlots`: the tables of K worlds, each of which can be replaced while the others stay where they are."""

from typing import NamedTuple

import numpy as np

from thalweg.render.bake import impostors
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.records.layout import (
    ATLAS_AT,
    BRIDGE_FROM,
    BRIDGE_TO,
    CANOPY_AT,
    CHUNK_AT,
    CLOUD_AT,
    CONE_AT,
    CONSTANT_COLUMNS,
    EXTENT_COLUMNS,
    MAP_AT,
    PAINT_AT,
    PAINT_LEVELS,
    PLANT_FROM,
    PLANT_TO,
    QUAY_AT,
    SHADE_AT,
    SKY_AT,
)
from thalweg.render.records.scene import Scene
from thalweg.world.record import World

COLUMNS = {
    "top": (MAP_AT,),
    "depth": (),
    "cone": (CONE_AT,),
    "paint": (*range(PAINT_AT, PAINT_AT + PAINT_LEVELS), QUAY_AT),
    "canopy": (CANOPY_AT,),
    "canopy_paint": (),
    "plants": (PLANT_FROM, PLANT_TO),
    "chunks": (CHUNK_AT,),
    "bridges": (BRIDGE_FROM, BRIDGE_TO),
    "sky": (SKY_AT,),
    "clouds": (CLOUD_AT,),
}
"""Tables of each world, and the columns of `Scene.extents` that count their rows. `depth` and `canopy_paint` have the
rows of the table before them."""
SHARED = ("ripples", "atlas_level", "autumn")
"""Tables that all worlds share."""
PICTURES = ("atlas", "shade", "outlines")
"""Tables of the pictures of plants, which worlds under suns of about the same height share."""
MARGIN = 1.1
"""Rows of a slot, of those of the largest world so far: worlds of a level differ a little."""


class WorldTables(NamedTuple):
    """The tables of one world."""

    extents: np.ndarray
    """[EXTENT_COLUMNS] int32."""
    constants: np.ndarray
    """[CONSTANT_COLUMNS] float32."""
    tables: dict[str, np.ndarray]
    """Those of `COLUMNS`."""
    shared: dict[str, np.ndarray]
    """Those of `SHARED` and `PICTURES`; empty if the slots have had them for this height of the sun."""
    sun_steps: int
    """Height of the sun, as atlases count it."""

    @property
    def nbytes(self) -> int:
        """Bytes of a slot for the tables that are not shared."""
        return int(MARGIN * sum(table.nbytes for table in self.tables.values()))


class SceneSlots:
    """Tables of up to K worlds."""

    def __init__(self) -> None:
        self._rows: dict[str, int] = {}
        """Rows of a slot in each table."""
        self._shared: dict[str, np.ndarray] = {}
        self._pictures: dict[int, tuple[int, int]] = {}
        """First rows in `atlas` and `shade` of the pictures for each height of the sun."""
        self.scene: Scene | None = None
        """The tables that the kernels read; another record after `put` if a world was too large for its slot."""

    def reserve(self, slots: int) -> None:
        """Set K, before the first `put`."""
        self._extents = np.zeros((slots, EXTENT_COLUMNS), np.int32)
        self._constants = np.zeros((slots, CONSTANT_COLUMNS), np.float32)
        self._tables: dict[str, np.ndarray] = {}

    def bake(self, world: World) -> WorldTables:
        """Return the tables of a world; may be called in another thread."""
        scene = build_scene([world])
        steps = impostors.sun_steps(world.sun_elevation)
        names = () if steps in self._pictures else (*SHARED, *PICTURES)
        tables, shared = ({name: getattr(scene, name) for name in each} for each in (COLUMNS, names))
        return WorldTables(scene.extents[0], scene.constants[0], tables, shared, steps)

    def put(self, slot: int, world: WorldTables) -> None:
        """Replace the tables of a slot; raises `ValueError` for more rows than 32 bits can count."""
        added = world.sun_steps not in self._pictures
        if added:
            self._add_pictures(world)
        grown = [name for name, table in world.tables.items() if len(table) > self._rows.get(name, -1)]
        for name in grown:
            self._grow(name, world)
        extents = world.extents.copy()
        for name, table in world.tables.items():
            begin = slot * self._rows[name]
            self._tables[name][begin : begin + len(table)] = table
            extents[list(COLUMNS[name])] += begin
        extents[[ATLAS_AT, SHADE_AT]] = self._pictures[world.sun_steps]
        self._extents[slot], self._constants[slot] = extents, world.constants
        if grown or added or self.scene is None:
            self.scene = Scene(extents=self._extents, constants=self._constants, **self._tables, **self._shared)

    @property
    def rows(self) -> dict[str, int]:
        """Rows of a slot in each table of `COLUMNS`."""
        return self._rows

    def _add_pictures(self, world: WorldTables) -> None:
        """Add the pictures of plants under a sun of another height to those that are there."""
        if not self._pictures:
            self._shared = dict(world.shared)
            self._pictures[world.sun_steps] = 0, 0
            return
        self._pictures[world.sun_steps] = len(self._shared["atlas"]), len(self._shared["shade"])
        for name in PICTURES:
            self._shared[name] = np.concatenate([self._shared[name], world.shared[name]])

    def _grow(self, name: str, world: WorldTables) -> None:
        """Enlarge each slot of a table so that a world fits, and move what is there."""
        table, old = world.tables[name], self._rows.get(name, 0)
        slots = len(self._extents)
        rows = int(MARGIN * max(len(table), 1)) + 1
        if slots * rows >= 2**31:
            raise ValueError(f"{slots} worlds of {rows} rows of {name} are more than 32 bits can count")
        larger = np.zeros((slots, rows, *table.shape[1:]), table.dtype)
        if name in self._tables:
            larger[:, :old] = self._tables[name].reshape(slots, old, *table.shape[1:])
            columns = list(COLUMNS[name])
            self._extents[:, columns] += (np.arange(slots) * (rows - old))[:, None].astype(np.int32)
        self._rows[name], self._tables[name] = rows, larger.reshape(slots * rows, *table.shape[1:])
