"""How does one ask for frames? `Renderer(worlds).render(poses)`, for any number of cameras in any of its worlds."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike

from thalweg.core import versions
from thalweg.core.device import resolve_device
from thalweg.render import compilation
from thalweg.render.batch import bands_of, draw
from thalweg.render.errors import RenderError
from thalweg.render.records.appearance import Look, look_rows, look_values
from thalweg.render.records.camera import Camera
from thalweg.render.records.quality import QUALITIES, Quality
from thalweg.render.records.scene import build_scene
from thalweg.world.record import World

RENDER_VERSION = versions.RENDER
"""Changes whenever the same world looks different, so that what was trained on older frames can tell."""


@dataclass(frozen=True)
class Frame:
    """Frames with all their layers."""

    rgb: np.ndarray
    """[N, H, W, 3] uint8, sRGB."""
    mask: np.ndarray
    """[N, H, W] bool, where water is seen at the centre of the pixel."""
    depth_m: np.ndarray
    """[N, H, W] float32, metres along the optical axis; -1 for the sky."""
    class_id: np.ndarray
    """[N, H, W] uint8: 0 sky, 1 water, 2 ground, 3 plant, 4 bridge."""


class Renderer:
    """Draws worlds as seen by a camera. Its tables are built once; drawing changes nothing in it."""

    def __init__(
        self,
        worlds: Sequence[World],
        camera: Camera | None = None,
        quality: Quality = "full",
        device: str = "cpu",
    ) -> None:
        """Prepare the tables of the worlds.

        `quality`: "full", or "fast" for frames without reflections, filtered less, and marched once for four pixels.
        `device`: where frames are drawn, see `thalweg.core.device`; they are arrays of the host either way, and within
        2/255 alike.

        Raises `RenderError` if there is no world, no such quality, or too little memory on the GPU; `DeviceError` for a
        device that can't be used.
        """
        if not worlds:
            raise RenderError("a renderer needs at least one world")
        if quality not in QUALITIES:
            raise RenderError(f"quality = {quality!r}: choose one of {', '.join(QUALITIES)}")
        self.device = resolve_device(device)
        if self.device == "cpu":
            compilation.begin()
        self.worlds = tuple(worlds)
        self.camera = camera or Camera()
        self.scene = build_scene(self.worlds)
        """The tables that the kernels read."""
        self.quality = quality
        size = int(self.camera.height_px), int(self.camera.width_px)
        self._camera = *size, np.float32(self.camera.near_m), quality == "fast"
        self._painter = None
        if self.device != "cpu":
            from thalweg.render.gpu.gpu_renderer import Painter

            self._painter = Painter(self.scene, self._camera, self.device)

    def render(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        out: np.ndarray | None = None,
        look: Look | Sequence[Look] | np.ndarray | None = None,
    ) -> np.ndarray:
        """Frames [N, H, W, 4] uint8: sRGB, and the water mask (0 or 255) in the fourth channel.

        poses [N, 4]: x, y, z in metres, yaw in radians. world_index [N]: which of the worlds each camera is in (the
        first if left out). time_s [N] or a number: moves the ripples. out: an array of the result's shape to draw into.
        look: one for all frames, or one for each (also as an array [N, P], see
        `thalweg.render.records.appearance.PARAMETERS`).
        """
        poses, worlds, times = self._checked(poses, world_index, time_s)
        looks = look_rows(look_values(look, len(poses)), self.camera)
        shape = (len(poses), self.camera.height_px, self.camera.width_px, 4)
        if out is None:
            out = np.empty(shape, np.uint8)
        elif out.shape != shape or out.dtype != np.uint8 or not out.flags.c_contiguous:
            raise RenderError(f"out is {out.dtype} {list(out.shape)}; it must be contiguous uint8 {list(shape)}")
        none = np.empty((1, 1, 1), np.float32), np.empty((1, 1, 1), np.uint8)
        self._draw(worlds, poses, times, looks, out, False, *none)
        return out

    def render_layers(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        look: Look | Sequence[Look] | np.ndarray | None = None,
    ) -> Frame:
        """Frames with depth and class; arguments as of `render`."""
        poses, worlds, times = self._checked(poses, world_index, time_s)
        looks = look_rows(look_values(look, len(poses)), self.camera)
        shape = (len(poses), self.camera.height_px, self.camera.width_px)
        image, depth, kind = np.empty((*shape, 4), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.uint8)
        self._draw(worlds, poses, times, looks, image, True, depth, kind)
        return Frame(np.ascontiguousarray(image[..., :3]), image[..., 3] > 0, depth, kind)

    def render_tensors(self, views: Sequence[Any], out: Any) -> None:
        """`render` without checks, from torch's tensors on this renderer's device into one, of which nothing is copied.

        views: world_index [N] int64, poses [N, 4] and times [N] float64, and looks as rows [N, LOOK_COLUMNS] float32 of
        `thalweg.render.records.appearance.look_rows`; out: [N, H, W, 4] uint8.
        """
        if self._painter is not None:
            self._painter.draw_tensors(views, out)
            return
        none = np.empty((1, 1, 1), np.float32), np.empty((1, 1, 1), np.uint8)
        world_index, poses, times, rows = (tensor.numpy() for tensor in views)
        self._draw(world_index, poses, times, rows, out.numpy(), False, *none)

    @property
    def scratch_bytes(self) -> int:
        """Memory of the GPU that drawing takes at least, beside the worlds' tables and the frames; 0 on the CPU."""
        return 0 if self._painter is None else self._painter.each

    def _draw(self, worlds, poses, times, looks, out, want_layers, depth, kind) -> None:
        packed = out.view(np.uint32)[..., 0]
        if self._painter is not None:
            self._painter.draw_for_host(worlds, poses, times, looks, packed, (depth, kind) if want_layers else None)
            return
        compilation.finish()
        bands = bands_of(self.camera.height_px, numba.get_num_threads(), len(poses))
        draw(self.scene, worlds, poses, times, looks, self._camera, packed, want_layers, depth, kind, bands)

    def _checked(
        self, poses: ArrayLike, world_index: ArrayLike | None, time_s: ArrayLike | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        poses = np.ascontiguousarray(poses, np.float64)
        if poses.ndim != 2 or poses.shape[1] != 4:
            raise RenderError(f"poses have shape {list(poses.shape)}; they must be [N, 4]: x, y, z, yaw")
        if not np.isfinite(poses).all():
            raise RenderError(f"pose {int(np.argmin(np.isfinite(poses).all(axis=1)))} is not finite")
        count = len(poses)
        index = np.zeros(count, np.int64) if world_index is None else np.asarray(world_index, np.int64)
        if index.shape != (count,):
            raise RenderError(f"world_index has shape {list(index.shape)}; there are {count} poses")
        if count and (index.min() < 0 or index.max() >= len(self.worlds)):
            raise RenderError(f"world_index must be in 0..{len(self.worlds) - 1}; got {index.min()}..{index.max()}")
        times = np.ascontiguousarray(np.broadcast_to(np.float64(0.0) if time_s is None else time_s, count), np.float64)
        return poses, index, times
