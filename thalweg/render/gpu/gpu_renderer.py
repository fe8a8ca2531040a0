"""How are many frames drawn on a GPU? Five kernels a pass: cameras, plants in view, pixels, light added up, picture.

A pass draws as many cameras as the scratch has room for. Everything lies in torch's memory on the device, and is made
once; nothing waits for the device, and nothing is copied from it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from thalweg.core import gpu
from thalweg.render.errors import RenderError
from thalweg.render.gpu import pixel
from thalweg.render.gpu import postprocess as develop
from thalweg.render.gpu import visible_plants as visible
from thalweg.render.kernels.shading.tone import CODE_TABLE
from thalweg.render.records.scene import PLANT_FROM, PLANT_TO, Scene

MOST_CAMERAS = 1024
"""Cameras of a pass: more do not make a GPU faster, but take memory."""
PLANE_BYTES = 6 * 4 + 1
"""Of a pixel: depth, three colours, light, solid; and kind."""


class Views(NamedTuple):
    """What to draw, on the device."""

    world_index: Any
    """[N] int64."""
    poses: Any
    """[N, 4] float64: x, y, z in metres, yaw in radians."""
    times: Any
    """[N] float64, seconds."""
    looks: Any
    """[N, LOOK_COLUMNS] float32."""


def bytes_of(scene: Scene) -> int:
    """Memory that a scene's tables take on a device."""
    return sum(table.nbytes for table in scene)


def bytes_each(scene: Scene, height: int, width: int, fast: bool) -> int:
    """Scratch that a camera of a pass takes on a device."""
    plants = most_plants(scene)
    planes = height * width * (PLANE_BYTES + (0 if fast else 3 * 4))
    return planes + plants * (4 + 4 + 4 * 2) + 4 * (visible.EYE + 4)


def most_plants(scene: Scene) -> int:
    """Plants of the world that has most, at least one."""
    return max(1, int((scene.place[:, PLANT_TO] - scene.place[:, PLANT_FROM]).max()))


def check_memory(scene: Scene, each: int, free: int) -> None:
    """Raise `RenderError` unless the tables of a scene and the scratch of one camera fit into the free bytes of a
    device, saying what is needed and how many worlds fit."""
    tables, worlds = bytes_of(scene), len(scene.place)
    if tables + each > free:
        fitting = max(0, (free - each) * worlds // tables)
        raise RenderError(
            f"the tables of {worlds} worlds take {tables / 1e9:.2f} GB and a camera {each / 1e6:.1f} MB of the GPU's"
            f" memory, of which {free / 1e9:.2f} GB are free: {fitting} worlds of this size fit"
        )


def cameras_of_a_pass(free: int, each: int) -> int:
    """How many cameras of `each` bytes of scratch fit into the free ones: one at least, at most `MOST_CAMERAS`."""
    return max(1, min(MOST_CAMERAS, free // each))


class Painter:
    """Draws the worlds of a scene on a device of torch's; its scratch is used anew by each call."""

    def __init__(self, scene: Scene, camera: tuple[int, int, np.float32, bool], device: str) -> None:
        """Copy the tables there; camera: as of `batch.draw`. Raises `RenderError` if they and the scratch of one camera
        do not fit."""
        self.device, self._camera = device, camera
        height, width, _, self.fast = camera
        self.each = bytes_each(scene, height, width, self.fast)
        """Bytes of scratch for a camera of a pass."""
        check_memory(scene, self.each, gpu.free_bytes(device))
        self._scene = Scene(*(gpu.to_device(table, device) for table in scene))
        self._codes = gpu.to_device(CODE_TABLE, device)
        self._plants = most_plants(scene)
        self.cameras = 0
        """Cameras that a pass may have, set at the first draw, when frames already have their memory; 0 before."""
        self._room = 0
        self._scratch: dict[str, Any] = {}

    def draw(self, views: Views, images: Any = None, layers: tuple[Any, Any, Any] | None = None) -> None:
        """Draw one frame per view into arrays on the device.

        Args:
            views: N of them.
            images: [N, H, W] uint32, red, green, blue from the lowest byte up and the water mask on top; None for none:
                then nothing is shaded.
            layers: [N, H, W] each: float32 depths, uint8 classes, and uint8 masks of 0 or 255; None for none.
        """
        count = len(views.poses)
        if not count:
            return
        if not self.cameras:
            self.cameras = cameras_of_a_pass(gpu.free_bytes(self.device), self.each)
        self._make_room(min(count, self.cameras))
        for first in range(0, count, self._room):
            part = slice(first, min(first + self._room, count))
            some = Views(*(values[part] for values in views))
            self._draw(
                some,
                None if images is None else images[part],
                None if layers is None else tuple(layer[part] for layer in layers),
            )

    def draw_tensors(self, views: Sequence[Any], out: Any) -> None:
        """Draw frames from torch's tensors into one [N, H, W, 4] uint8, all on this device."""
        images = gpu.as_kernel_array(out, np.uint32).reshape(out.shape[:3])
        self.draw(Views(*(gpu.as_kernel_array(tensor) for tensor in views)), images)

    def draw_for_host(
        self,
        world_index: np.ndarray,
        poses: np.ndarray,
        times: np.ndarray,
        looks: np.ndarray,
        images: np.ndarray,
        layers: tuple[np.ndarray, np.ndarray] | None,
    ) -> None:
        """Draw frames into arrays of the host: images [N, H, W] uint32, and depths and classes where wanted."""
        views = Views(*(gpu.to_device(values, self.device) for values in (world_index, poses, times, looks)))
        shape = images.shape
        drawn = gpu.empty(shape, np.uint32, self.device)
        found = tuple(gpu.empty(shape, kind, self.device) for kind in (np.float32, np.uint8, np.uint8))
        self.draw(views, drawn, found if layers else None)
        images[...] = gpu.to_host(drawn, self.device)
        for place, values in zip(layers or (), found, strict=False):
            place[...] = gpu.to_host(values, self.device)

    def _make_room(self, cameras: int) -> None:
        """Scratch for so many cameras of a pass."""
        if cameras <= self._room:
            return
        height, width = self._camera[:2]
        self._scratch.clear()
        makes = {
            "eyes": ((cameras, visible.EYE), np.float32),
            "moments": ((cameras,), np.float32),
            "keys": ((cameras,), np.uint32),
            "counts": ((cameras,), np.int32),
            "gains": ((cameras,), np.float32),
            "order": ((cameras, self._plants), np.int32),
            "distance": ((cameras, self._plants), np.float32),
            "boxes": ((cameras, self._plants, 4), np.int16),
            "kind": ((cameras, height, width), np.uint8),
            "softened": ((3, 1, 1, 1) if self.fast else (3, cameras, height, width), np.float32),
        }
        planes = ("depth", "red", "green", "blue", "light", "solid")
        makes |= dict.fromkeys(planes, ((cameras, height, width), np.float32))
        self._scratch = {name: gpu.empty(shape, kind, self.device) for name, (shape, kind) in makes.items()}
        self._room = cameras

    def _draw(self, views: Views, images: Any, layers: Any) -> None:
        """One pass."""
        count, (height, width, _, fast) = len(views.poses), self._camera
        eyes, moments, keys, counts, gains, order, distance, boxes = (
            self._scratch[name] for name in ("eyes", "moments", "keys", "counts", "gains", "order", "distance", "boxes")
        )
        planes = tuple(self._scratch[name] for name in ("depth", "kind", "red", "green", "blue", "light", "solid"))
        depth, kind, red, green, blue, light, solid = planes
        scene, device = self._scene, self.device
        pixels = -(-height * width // develop.THREADS), count
        gpu.launch(
            visible.place_cameras, -(-count // visible.THREADS), visible.THREADS, device,
            views.poses, views.times, views.looks, self._camera, eyes, moments, keys,
        )  # fmt: skip
        gpu.launch(
            visible.find, count, visible.THREADS, device,
            scene, views.world_index, views.looks, self._camera, eyes, order, distance, boxes, counts,
        )  # fmt: skip
        tiles = -(-height // pixel.SIDE) * -(-width // pixel.SIDE)
        gpu.launch(
            pixel.tracer(fast, images is not None), (tiles, count), pixel.THREADS, device,
            scene, views.world_index, moments, views.looks, eyes, order, distance, boxes, counts, planes,
        )  # fmt: skip
        if images is not None:
            softened = self._scratch["softened"]
            gpu.launch(
                develop.adder(fast), count, develop.THREADS, device,
                scene, views.world_index, views.looks, eyes, planes, softened, gains,
            )  # fmt: skip
            colours = (red, green, blue) if fast else (softened[0], softened[1], softened[2])
            gpu.launch(
                develop.develop, pixels, develop.THREADS, device,
                *colours, kind, light, views.looks, keys, gains, self._codes, images,
            )  # fmt: skip
        if layers is not None:
            gpu.launch(develop.layers, pixels, develop.THREADS, device, depth, kind, light, solid, *layers)
