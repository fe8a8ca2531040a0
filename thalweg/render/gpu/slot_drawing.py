"""`SlotDrawing`: frames of replaceable worlds drawn on a GPU into arrays of the host.

Numbers of frames are rounded up and drawn into the same memory again and again, so that their launches are recorded and
replayed: environments draw a few frames at a time, whose launches would take the host longer than the GPU.
"""

from typing import Any

import numpy as np

from thalweg.core.compute import gpu
from thalweg.render.bake.scene_slots import SceneSlots
from thalweg.render.errors import RenderError
from thalweg.render.gpu.gpu_renderer import MOST_CAMERAS, GpuRenderer, bytes_of
from thalweg.render.gpu.slot_tables import SlotTables
from thalweg.render.records.view import COLOURS, FrameSettings, Output, Views

FEW, MANY = 32, 256
"""Numbers of frames are rounded up to multiples of `FEW`, those above `MANY` to multiples of `MANY`."""


def rounded_up(count: int) -> int:
    """Return the number of frames that are drawn where `count` are wanted."""
    step = FEW if count <= MANY else MANY
    return -(-count // step) * step


class SlotDrawing:
    """Draws the worlds of `SceneSlots` on a device of torch's."""

    def __init__(self, slots: SceneSlots, settings: FrameSettings, device: str) -> None:
        self._slots, self._settings, self.device = slots, settings, device
        self._tables = SlotTables(slots, device)
        self._drawer: Any = None
        """A `GpuRenderer` of the tables where they lie now."""
        self._frames: dict[int, Any] = {}
        """Memory [`MOST_CAMERAS`, H, W, C] uint8 for frames, by C."""

    def put(self, slot: int) -> None:
        """Note that the world of a slot was replaced."""
        self._tables.put(slot)

    def draw(self, views: Views, wanted: Output, props: np.ndarray) -> None:
        """Draw frames into the arrays of an `Output` of the host; raises `RenderError` if the worlds do not fit into
        the memory of the device."""
        self._update()
        if wanted.want_layers or props.shape[1]:
            self._drawer.draw_for_host(views, wanted, props)
            return
        target = wanted.images.view(np.uint8) if wanted.drawn == COLOURS else wanted.masks
        channels = 4 if wanted.drawn == COLOURS else 1
        target = target.reshape(*target.shape[:2], -1, channels)
        for first in range(0, len(target), MOST_CAMERAS):
            part = slice(first, min(first + MOST_CAMERAS, len(target)))
            self._draw_some([values[part] for values in views], target[part])

    def _draw_some(self, views: list[np.ndarray], target: np.ndarray) -> None:
        """Draw up to `MOST_CAMERAS` frames into an array [M, H, W, C] uint8 of the host."""
        import torch

        count, channels = len(target), target.shape[-1]
        more = rounded_up(count) - count
        filled = [np.concatenate([values, np.repeat(values[:1], more, axis=0)]) for values in views]
        if channels not in self._frames:
            shape = MOST_CAMERAS, self._settings.height, self._settings.width, channels
            self._frames[channels] = torch.empty(shape, dtype=torch.uint8, device=self.device)
        frames = self._frames[channels][: count + more]
        self._drawer.draw_tensors([torch.from_numpy(values).to(self.device) for values in filled], frames)
        torch.from_numpy(target).copy_(frames[:count])

    def _update(self) -> None:
        """Bring the tables on the device up to date."""
        scene = self._slots.scene
        assert scene is not None
        if self._drawer is None or self._tables.stale:
            needed, free = bytes_of(scene), gpu.free_bytes(self.device)
            if self._tables.moves and needed > free + self._tables.nbytes:
                raise RenderError(
                    f"the tables of {len(scene.extents)} rivers take {needed / 1e9:.2f} GB of the GPU's memory, of"
                    f" which {free / 1e9:.2f} GB are free: set rivers_in_memory to fewer"
                )
            if self._tables.moves:
                self._drawer = None  # recorded launches read the old memory
            if self._tables.update():
                plants = self._slots.rows["plants"]
                self._drawer = GpuRenderer(scene, self._settings, self.device, tables=self._tables.scene, plants=plants)
