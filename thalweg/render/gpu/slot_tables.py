"""`SlotTables`: the tables of replaceable worlds on a GPU, brought up to date before each draw."""

from typing import Any

import numpy as np

from thalweg.core.compute import gpu
from thalweg.render.bake.scene_slots import COLUMNS, PICTURES, SHARED, SceneSlots
from thalweg.render.records.scene import Scene

OF_WORLDS = ("extents", "constants")
"""Tables with a row of each world."""


class SlotTables:
    """Copies on a device of the tables of `SceneSlots`; only slots that were filled are copied."""

    def __init__(self, slots: SceneSlots, device: Any) -> None:
        """Copy nothing yet."""
        self._slots, self._device = slots, device
        self._copied: Scene | None = None
        """The host's record that `scene` is a copy of."""
        self._filled: set[int] = set()
        self._stale: set[int] = set()
        self.scene: Any = None
        """The tables on the device, a `Scene`; another record when they moved."""

    def put(self, slot: int) -> None:
        """Note that the world of a slot was replaced."""
        self._filled.add(slot)
        self._stale.add(slot)

    @property
    def stale(self) -> bool:
        """Whether the device's tables are out of date."""
        return bool(self._stale)

    @property
    def moves(self) -> bool:
        """Whether the next `update` allocates all tables anew: some world was too large for its slot."""
        return self._slots.scene is not self._copied

    @property
    def nbytes(self) -> int:
        """Bytes of the tables on the device."""
        return 0 if self._copied is None else sum(table.nbytes for table in self._copied)

    def update(self) -> bool:
        """Bring the device's tables up to date; returns whether they moved."""
        scene = self._slots.scene
        assert scene is not None
        moved = self.moves
        if moved:
            self.scene = None  # its memory is released first, so that both are never held at once
            self.scene = self._made(scene)
            self._copied, self._stale = scene, set(self._filled)
        for slot in self._stale:
            self._copy(scene, slot)
        self._stale.clear()
        return moved

    def _made(self, scene: Scene) -> Scene:
        """Return the tables on the device, those of the worlds still empty."""
        made = {name: gpu.to_device(getattr(scene, name), self._device) for name in (*SHARED, *PICTURES)}
        for name in (*OF_WORLDS, *COLUMNS):
            table: np.ndarray = getattr(scene, name)
            made[name] = gpu.zeros(table.shape, table.dtype, self._device)
        return Scene(**made)

    def _copy(self, scene: Scene, slot: int) -> None:
        """Copy the rows of a slot."""
        for name in OF_WORLDS:
            gpu.overwrite(getattr(self.scene, name), slot, getattr(scene, name)[slot : slot + 1], self._device)
        for name, rows in self._slots.rows.items():
            begin = slot * rows
            gpu.overwrite(getattr(self.scene, name), begin, getattr(scene, name)[begin : begin + rows], self._device)
