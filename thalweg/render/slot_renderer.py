"""`SlotRenderer`: a renderer whose worlds are replaced one at a time, for environments that change river."""

from dataclasses import replace
from typing import Any

import numpy as np

from thalweg.render.bake.scene_slots import SceneSlots, WorldTables
from thalweg.render.bake.sunlight import relit
from thalweg.render.errors import RenderError
from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.render.records.view import Output, Views
from thalweg.render.renderer import Renderer
from thalweg.world.record import World


class SlotRenderer(Renderer):
    """Draws the worlds that are in its slots; frames are those of a `Renderer` of these worlds."""

    def __init__(
        self,
        camera: Camera | None = None,
        quality: Quality = "full",
        randomisation: Randomisation | None = None,
        device: str = "cpu",
    ) -> None:
        """Prepare everything but the worlds; raises `RenderError` for an unknown quality, and `DeviceError` for a
        device that can't be used.

        With a `randomisation` that varies suns, each world has one of its own, drawn by its seed. On a GPU, tables are
        held by the host as well, and copied when the next frames are drawn.
        """
        self._set_up(camera, quality, device)
        self._suns = randomisation if randomisation is not None and randomisation.suns else None
        self._slots = SceneSlots()
        self._on_device: Any = None
        if self.device != "cpu":
            from thalweg.render.gpu.slot_drawing import SlotDrawing

            self._on_device = SlotDrawing(self._slots, self._settings, self.device)
        self.count = 0
        """Number of slots that have a world; they are filled in order."""

    def reserve(self, slots: int) -> None:
        """Set the number of slots, before the first `put`."""
        self._slots.reserve(slots)

    def bake(self, world: World) -> WorldTables:
        """Return the tables of a world, under a sun of its own if suns vary; may be called in another thread."""
        if self._suns is not None:
            ((azimuth, elevation),) = replace(self._suns, suns=1).lights(world.seed)
            world = relit(world, azimuth, elevation)
        return self._slots.bake(world)

    def put(self, slot: int, tables: WorldTables) -> None:
        """Replace the world of a slot; raises `RenderError` for more rows than 32 bits can count."""
        try:
            self._slots.put(slot, tables)
        except ValueError as error:
            raise RenderError(str(error)) from error
        scene: Any = self._slots.scene
        self.scene, self.count = scene, max(self.count, slot + 1)
        if self._on_device is not None:
            self._on_device.put(slot)

    def _draw(self, views: Views, wanted: Output, props: np.ndarray) -> None:
        """As the renderer of worlds that stay does."""
        if self._on_device is None:
            super()._draw(views, wanted, props)
        else:
            self._on_device.draw(views, wanted, props)
