"""`SlotRenderer`: a renderer whose worlds are replaced one at a time, for environments that change river."""

from dataclasses import replace
from typing import Any

from thalweg.render.bake.scene_slots import SceneSlots, WorldTables
from thalweg.render.errors import RenderError
from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import Quality
from thalweg.render.records.randomisation import Randomisation
from thalweg.render.renderer import Renderer
from thalweg.world.record import World


class SlotRenderer(Renderer):
    """Draws the worlds that are in its slots, on the CPU; frames are those of a `Renderer` of these worlds."""

    def __init__(
        self, camera: Camera | None = None, quality: Quality = "full", randomisation: Randomisation | None = None
    ) -> None:
        """Prepare everything but the worlds; raises `RenderError` for an unknown quality.

        With a `randomisation` that varies suns, each world has one of its own, drawn by its seed.
        """
        self._set_up(camera, quality, "cpu")
        self._suns = randomisation if randomisation is not None and randomisation.suns else None
        self._slots = SceneSlots()
        self.count = 0
        """Number of slots that have a world; they are filled in order."""

    def reserve(self, slots: int) -> None:
        """Set the number of slots, before the first `put`."""
        self._slots.reserve(slots)

    def bake(self, world: World) -> WorldTables:
        """Return the tables of a world, under a sun of its own if suns vary; may be called in another thread."""
        if self._suns is not None:
            ((azimuth, elevation),) = replace(self._suns, suns=1).lights(world.seed)
            world = world.relit(azimuth, elevation)
        return self._slots.bake(world)

    def put(self, slot: int, tables: WorldTables) -> None:
        """Replace the world of a slot; raises `RenderError` for more rows than 32 bits can count."""
        try:
            self._slots.put(slot, tables)
        except ValueError as error:
            raise RenderError(str(error)) from error
        scene: Any = self._slots.scene
        self.scene, self.count = scene, max(self.count, slot + 1)
