"""`GpuRenderer`: frames drawn on a GPU by five to eight kernels a pass.

They place cameras, find the plants in view, walk over the ground in vertical planes, pose props if there are any, and
draw pixels; with colours they add up the light for the exposure and map tones; at last they write layers or masks. A
pass draws as many cameras as the scratch is large enough for. Everything lies in torch's memory on the device and is
allocated once; nothing waits for the device, and nothing is copied from it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from thalweg.core.compute import gpu
from thalweg.core.compute.launch_graphs import LaunchGraphs
from thalweg.render.errors import RenderError
from thalweg.render.gpu import ground_profiles, pixel, posed_props, postprocess, tile, visible_plants
from thalweg.render.kernels.camera_rays import Radiance
from thalweg.render.kernels.props import models
from thalweg.render.kernels.props.pose import PART_COLUMNS
from thalweg.render.kernels.shading.tone import CODE_TABLE
from thalweg.render.kernels.terrain.azimuth_planes import most_planes
from thalweg.render.records.layout import PLANT_FROM, PLANT_TO
from thalweg.render.records.props import NO_PROPS
from thalweg.render.records.scene import Scene
from thalweg.render.records.view import COLOURS, LAYERS, MASK, Buffers, FrameSettings, Output, Views

MOST_CAMERAS = 1024
"""Most cameras of a pass: more do not make a GPU faster, but take memory."""
BUFFER_BYTES = 6 * 4 + 1
"""Bytes of a pixel's buffers: six of float32, and the kind."""


def bytes_of(scene: Scene) -> int:
    """Memory that a scene's tables take on a device."""
    return sum(table.nbytes for table in scene)


def bytes_of_props(count: int) -> int:
    """Scratch that a camera of a pass with so many props takes on a device."""
    # Parts of float32, two numbers, and three rectangles of four.
    return count * (models.MOST_PARTS * PART_COLUMNS + 2 + 12) * 4 + 4


def bytes_each(plants: int, height: int, width: int, reduced: bool) -> int:
    """Scratch that a camera of a pass takes on a device, without props, in worlds of up to so many plants."""
    # Order and distance take four bytes each, a box four times two.
    buffers = height * width * (BUFFER_BYTES + (0 if reduced else 3 * 4)) + height * most_planes(width) * 4
    return buffers + plants * (4 + 4 + 4 * 2) + 4 * (visible_plants.CAMERA_COLUMNS + 4)


def most_plants(scene: Scene) -> int:
    """Plants of the world that has most, at least one."""
    return max(1, int((scene.extents[:, PLANT_TO] - scene.extents[:, PLANT_FROM]).max()))


def check_memory(scene: Scene, each: int, free: int) -> None:
    """Raise `RenderError` unless the tables of a scene and the scratch of one camera fit into the free bytes of a
    device, saying what is needed and how many worlds fit."""
    tables, worlds = bytes_of(scene), len(scene.extents)
    if tables + each > free:
        # An estimate that takes all worlds to be of the same size.
        fitting = max(0, (free - each) * worlds // tables)
        raise RenderError(
            f"the tables of {worlds} worlds take {tables / 1e9:.2f} GB and a camera {each / 1e6:.1f} MB of the GPU's"
            f" memory, of which {free / 1e9:.2f} GB are free: {fitting} worlds of this size fit"
        )


def cameras_of_a_pass(free: int, each: int) -> int:
    """How many cameras of `each` bytes of scratch fit into the free ones: one at least, at most `MOST_CAMERAS`."""
    return max(1, min(MOST_CAMERAS, free // each))


class GpuRenderer:
    """Draws the worlds of a scene on a device of torch's; each call uses the same scratch again."""

    def __init__(
        self, scene: Scene, settings: FrameSettings, device: str, *, tables: Any = None, plants: int | None = None
    ) -> None:
        """Copy the tables to the device. Raises `RenderError` if they and the scratch of one camera do not fit.

        Args:
            scene: The tables on the host.
            settings: What all frames share.
            device: A device of torch's.
            tables: The `Scene` on the device, for worlds that are replaced; None: it is copied.
            plants: Most plants that a world will have; None: those of the world that has most.
        """
        self.device, self._settings = device, settings
        self._plants = most_plants(scene) if plants is None else plants
        self.scratch_bytes = bytes_each(self._plants, settings.height, settings.width, settings.reduced)
        """Bytes of scratch for a camera of a pass."""
        if tables is None:
            check_memory(scene, self.scratch_bytes, gpu.free_bytes(device))
            tables = Scene(*(gpu.to_device(table, device) for table in scene))
        self._scene = tables
        self._codes = gpu.to_device(CODE_TABLE, device)
        self.cameras = 0
        """Cameras that a pass may have, set at the first draw, when frames already have their memory; 0 before."""
        self._capacity = 0
        self._scratch: dict[str, Any] = {}
        self._inputs: list[Any] = []
        """Tensors [M, ...] that hold the views and props of `draw_tensors`; M as many as were ever drawn at once."""
        self._props: dict[str, Any] = {}
        """Scratch for the props of a pass."""
        self._graphs = LaunchGraphs(device)

    def draw(
        self,
        views: Views,
        images: Any = None,
        layers: Sequence[Any] | None = None,
        masks: Any = None,
        props: Any = None,
    ) -> None:
        """Draw one frame per view into arrays on the device; what is not asked for is not computed.

        Args:
            views: N of them, on the device.
            images: [N, H, W] uint32, red, green, blue from the lowest byte up and the water mask on top; if None,
                nothing is shaded.
            layers: [N, H, W] each: float32 depths, uint8 classes, and uint8 masks of 0 or 255, or None in place of
                masks that are not wanted; None for none.
            masks: [N, H, W] uint8, for masks without images and layers.
            props: [N, P, PROP_COLUMNS] float32 of `thalweg.render.records.props`, P at least 1; None for none.
        """
        count = len(views.poses)
        if not count:
            return
        # Measured here and not before: by now torch has allocated the frames, and what is free is free for scratch.
        if not self.cameras:
            each = self.scratch_bytes + bytes_of_props(1 if props is None else props.shape[1])
            self.cameras = cameras_of_a_pass(gpu.free_bytes(self.device), each)
        self._allocate(min(count, self.cameras))
        self._allocate_props(1 if props is None else props.shape[1])
        for first in range(0, count, self._capacity):
            part = slice(first, min(first + self._capacity, count))
            self._draw_pass(
                Views(*(values[part] for values in views)),
                None if images is None else images[part],
                None if layers is None else tuple(None if layer is None else layer[part] for layer in layers),
                None if masks is None else masks[part],
                None if props is None else props[part],
            )

    def draw_tensors(
        self, views: Sequence[Any], out: Any, layers: tuple[Any, Any] | None = None, props: Any = None
    ) -> None:
        """Draw frames from torch's tensors into one [N, H, W, 4] uint8, or masks into one [N, H, W, 1], and depths
        and classes into `layers`, [N, H, W] float32 and uint8, all on this device; props: as of `draw`.

        Launches into the same memory are recorded and replayed, so that they cost the host little. Whoever records a
        CUDA graph of their own draws as many frames before, so that there is scratch, and never more afterwards.
        """
        if not len(out):
            return
        inputs = [*views] if props is None or not props.shape[1] else [*views, props]
        if self._graphs.caller_records:
            self._draw_into(inputs, out, layers)
            return
        self._hold(inputs, len(out))
        self._graphs.run(
            (out.data_ptr(), tuple(out.shape), *(layer.data_ptr() for layer in layers or ())),
            lambda: self._draw_into([held[: len(out)] for held in self._inputs], out, layers),
        )

    def _hold(self, inputs: Sequence[Any], count: int) -> None:
        """Copy views and props to `_inputs`, whose place in memory recorded launches know."""
        import torch

        same = [held.shape[1:] for held in self._inputs] == [tensor.shape[1:] for tensor in inputs]
        if not same or len(self._inputs[0]) < count:
            self._graphs.clear()
            # Tensors of an inference mode could not be written to outside it.
            with torch.inference_mode(False):
                self._inputs = [torch.empty_like(tensor) for tensor in inputs]
        for held, tensor in zip(self._inputs, inputs, strict=True):
            held[:count].copy_(tensor)

    def _draw_into(self, inputs: Sequence[Any], out: Any, layers: tuple[Any, Any] | None) -> None:
        """As `draw_tensors`, by launches; inputs: the views, and the props if there are any."""
        arrays = [gpu.as_kernel_array(tensor) for tensor in inputs]
        props = arrays.pop() if len(arrays) > len(Views._fields) else None
        views, shape, pair = Views(*arrays), out.shape[:3], None
        if layers is not None:
            pair = gpu.as_kernel_array(layers[0]), gpu.as_kernel_array(layers[1], np.uint8)
        if out.shape[-1] == 1:
            masks = gpu.as_kernel_array(out, np.uint8).reshape(shape)
            both = None if pair is None else (*pair, masks)
            self.draw(views, layers=both, masks=masks if pair is None else None, props=props)
        else:
            image = gpu.as_kernel_array(out, np.uint32).reshape(shape)
            self.draw(views, image, None if pair is None else (*pair, None), props=props)

    def draw_for_host(self, views: Views, output: Output, props: np.ndarray = NO_PROPS) -> None:
        """Draw frames into the arrays of an `Output` on the host."""
        shape = len(views.poses), self._settings.height, self._settings.width
        views = Views(*(gpu.to_device(values, self.device) for values in views))
        images, depths, classes, masks = (
            gpu.empty(shape, kind, self.device) if wanted else None
            for kind, wanted in (
                (np.uint32, output.drawn == COLOURS),
                (np.float32, output.want_layers),
                (np.uint8, output.want_layers),
                (np.uint8, output.drawn != COLOURS or output.want_layers),
            )
        )
        layers = (depths, classes, masks) if output.want_layers else None
        own_props = gpu.to_device(props, self.device) if props.shape[1] else None
        self.draw(views, images, layers, masks if output.drawn == MASK else None, own_props)
        targets = [(output.images, images), (output.depths, depths), (output.classes, classes)]
        if output.drawn != COLOURS:
            targets.append((output.masks, masks))
        for target, values in targets:
            if values is not None:
                target[...] = gpu.to_host(values, self.device)

    def _allocate(self, cameras: int) -> None:
        """Make scratch for so many cameras of a pass, unless there is enough."""
        if cameras <= self._capacity:
            return
        height, width = self._settings.height, self._settings.width
        self._graphs.clear()
        # The old scratch is released first, so that both are never held at once.
        self._scratch.clear()
        shapes = {
            "cameras": ((cameras, visible_plants.CAMERA_COLUMNS), np.float32),
            "moments": ((cameras,), np.float32),
            "nearness": ((cameras, height, most_planes(width)), np.float32),
            "keys": ((cameras,), np.uint32),
            "counts": ((cameras,), np.int32),
            "gains": ((cameras,), np.float32),
            "order": ((cameras, self._plants), np.int32),
            "distance": ((cameras, self._plants), np.float32),
            "boxes": ((cameras, self._plants, 4), np.int16),
            # The reduced quality softens no edges, but the kernel needs an array to be given.
            "softened": ((3, 1, 1, 1) if self._settings.reduced else (3, cameras, height, width), np.float32),
        }
        shapes |= dict.fromkeys(Buffers._fields, ((cameras, height, width), np.float32))
        shapes["kind"] = (cameras, height, width), np.uint8
        # A thread keeps the water of its pixel to itself.
        shapes["water"] = (cameras, 1, 1), np.float32
        self._scratch = {name: gpu.empty(shape, kind, self.device) for name, (shape, kind) in shapes.items()}
        self._capacity = cameras
        self._props.clear()

    def _allocate_props(self, count: int) -> None:
        """Make scratch for so many props of each camera of a pass, unless it is of this size."""
        if self._props and self._props["numbers"].shape[1] == count:
            return
        self._graphs.clear()
        self._props.clear()
        cameras = self._capacity
        shapes = {
            "parts": ((cameras, count * models.MOST_PARTS, PART_COLUMNS), np.float32),
            "numbers": ((cameras, count, 2), np.int32),
            "boxes": ((cameras, count, 4), np.int32),
            "zones": ((cameras, count, 8), np.int32),
            "counts": ((cameras,), np.int32),
        }
        self._props = {name: gpu.empty(shape, kind, self.device) for name, (shape, kind) in shapes.items()}

    def _draw_pass(self, views: Views, images: Any, layers: Any, masks: Any, props: Any) -> None:
        count, (height, width, _, reduced) = len(views.poses), self._settings
        cameras, moments, keys, gains = (self._scratch[name] for name in ("cameras", "moments", "keys", "gains"))
        plants = tuple(self._scratch[name] for name in ("order", "distance", "boxes", "counts"))
        buffers = Buffers(*(self._scratch[name] for name in Buffers._fields))
        scene, device, settings = self._scene, self.device, self._settings
        drawn = COLOURS if images is not None else LAYERS if layers is not None else MASK
        # Rounded up: the last block of a camera may have idle threads.
        pixels = -(-height * width // postprocess.THREADS), count
        gpu.launch(
            visible_plants.place_cameras, -(-count // visible_plants.THREADS), visible_plants.THREADS, device,
            views, settings, cameras, moments, keys,
        )  # fmt: skip
        gpu.launch(
            visible_plants.find, count, visible_plants.THREADS, device, scene, views, settings, cameras, *plants
        )  # fmt: skip
        nearness = self._scratch["nearness"]
        gpu.launch(
            ground_profiles.find_nearness, count, ground_profiles.THREADS, device,
            scene, views, settings, cameras, nearness,
        )  # fmt: skip
        posed = tuple(self._props.values())
        if props is not None:
            gpu.launch(
                posed_props.pose, count, posed_props.THREADS, device,
                scene, views, settings, cameras, moments, props, *posed,
            )  # fmt: skip
        tiles = -(-height // tile.TILE) * -(-width // tile.TILE)
        gpu.launch(
            pixel.tracer(reduced, drawn, props is not None), (tiles, count), tile.THREADS, device,
            scene, views, cameras, moments, nearness, plants, (nearness if props is None else props, *posed), buffers,
        )  # fmt: skip
        if images is not None:
            softened = self._scratch["softened"]
            gpu.launch(
                postprocess.adder(reduced), count, postprocess.THREADS, device,
                scene, views, cameras, buffers, softened, gains,
            )  # fmt: skip
            # Without softened edges the buffers hold the final colours.
            colours = (
                Radiance(buffers.red, buffers.green, buffers.blue)
                if reduced
                else Radiance(softened[0], softened[1], softened[2])
            )
            gpu.launch(
                postprocess.tone_map, pixels, postprocess.THREADS, device,
                colours, buffers.kind, buffers.transmittance, views.looks, keys, gains, self._codes, images,
            )  # fmt: skip
        if layers is not None:
            depths, classes, wanted = layers
            # Each thread reads the kind of its pixel before it writes: masks that nobody wants may take its place.
            unwanted = buffers.kind[:count]
            gpu.launch(
                postprocess.write_layers, pixels, postprocess.THREADS, device,
                buffers, depths, classes, unwanted if wanted is None else wanted,
            )  # fmt: skip
        elif masks is not None:
            gpu.launch(postprocess.write_mask, pixels, postprocess.THREADS, device, buffers, masks)
