"""`Renderer`: frames of worlds, for any number of cameras in any of its worlds."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from thalweg.core import versions
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.threads import get_num_threads
from thalweg.core.config import refuse_unknown
from thalweg.render import compilation
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.batch import bands_of, draw
from thalweg.render.errors import RenderError
from thalweg.render.lens_drawing import LensDrawing
from thalweg.render.records.appearance import Look, look_rows, look_values
from thalweg.render.records.breeze import ruffle
from thalweg.render.records.camera import Camera
from thalweg.render.records.props import NO_PROPS, checked_props
from thalweg.render.records.quality import QUALITIES, Quality
from thalweg.render.records.view import COLOURS, LAYERS, MASK, FrameSettings, Output, Views, output
from thalweg.world.record import World

RENDER_VERSION = versions.RENDER
"""Version of the frames: it changes whenever the same world looks different."""


Layer = Literal["rgb", "mask", "depth_m", "class_id"]
ALL_LAYERS: tuple[Layer, ...] = get_args(Layer)


@dataclass(frozen=True)
class Frame:
    """Frames with all their layers, or with those that were asked for; the others are None."""

    rgb: np.ndarray
    """[N, H, W, 3] uint8, sRGB."""
    mask: np.ndarray
    """[N, H, W] bool, true where water is seen at the centre of the pixel."""
    depth_m: np.ndarray
    """[N, H, W] float32, metres along the optical axis; -1 for the sky."""
    class_id: np.ndarray
    """[N, H, W] uint8: 0 sky, 1 water, 2 ground, 3 plant, 4 bridge, 5 swimmer, 6 kayak, 7 buoy, 8 gauge station."""


FARTHEST, LATEST_S, FASTEST_M_PER_S = 1e6, 1e6, 1e3
"""Greatest numbers of poses, in metres and radians, of times and of winds: far beyond them kernels, which check no
index, compute what is no number."""


class Renderer:
    """Draws worlds as a camera sees them. Its tables are built once; drawing changes nothing in it."""

    def __init__(
        self,
        worlds: Sequence[World],
        camera: Camera | None = None,
        quality: Quality = "full",
        device: str = "cpu",
    ) -> None:
        """Prepare the tables of the worlds.

        `quality`: "full", or "fast" for frames without reflected woods, with less filtering, and with interpolated
        ground. `device`: where frames are drawn, see `thalweg.core.compute.device`. Frames are arrays of the host in
        either case; at most 0.1 % of their pixels differ between two devices by more than 2 of 255.

        Raises `RenderError` for no world, an unknown quality, or too little memory on the GPU, and `DeviceError` for a
        device that can't be used.
        """
        if not worlds:
            raise RenderError("a renderer needs at least one world")
        self._set_up(camera, quality, device)
        self.worlds = tuple(worlds)
        self.count = len(self.worlds)
        """Number of worlds that `world_index` may name."""
        self.scene = build_scene(self.worlds)
        """The tables that the kernels read."""
        if self.device != "cpu":
            from thalweg.render.gpu.gpu_renderer import GpuRenderer

            self._gpu = GpuRenderer(self.scene, self._settings, self.device)

    def _set_up(self, camera: Camera | None, quality: Quality, device: str) -> None:
        """Prepare everything that does not depend on the worlds."""
        if quality not in QUALITIES:
            raise RenderError(f"quality = {quality!r}: choose one of {', '.join(QUALITIES)}")
        self.device = resolve_device(device)
        if self.device == "cpu":
            compilation.begin()
        self.camera = camera or Camera()
        self.quality = quality
        if self.camera.lens is not None and self.device != "cpu":
            raise RenderError(
                f"the camera has a lens, which is drawn on the CPU only, not on {self.device}: choose device='cpu', or"
                " rectify the images and take the camera of the rectified ones"
            )
        size = int(self.camera.height_px), int(self.camera.width_px)
        self._settings = FrameSettings(*size, np.float32(self.camera.near_m), quality == "fast")
        self._gpu: Any = None
        self._lens = None if self.camera.lens is None else LensDrawing(self.camera, self._settings)

    def render(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        out: np.ndarray | None = None,
        look: Look | Sequence[Look] | np.ndarray | None = None,
        props: ArrayLike | None = None,
        *,
        wind: ArrayLike | None = None,
    ) -> np.ndarray:
        """Frames [N, H, W, 4] uint8: sRGB, and the water mask (0 or 255) in the fourth channel.

        poses [N, 4]: x, y, z in metres, yaw in radians. world_index [N]: which of the worlds each camera is in (the
        first if left out). time_s [N] or a number: moves the ripples. out: an array of the result's shape to draw into.
        look: one for all frames, or one for each (also as an array [N, P], see
        `thalweg.render.records.appearance.PARAMETERS`). props [N, P, 6]: what else stands in each frame, see
        `thalweg.render.records.props`; frames without props do not change by it. wind [N, 2]: m/s towards east and
        north, by which ripples grow and move; at zero they are as without it.

        Raises `RenderError` for poses, indices, looks, props, winds or an `out` that do not fit.
        """
        views = self._checked(poses, world_index, time_s, look, wind)
        drawn_props = checked_props(props, len(views.poses))
        out = _checked_out(out, (len(views.poses), self.camera.height_px, self.camera.width_px, 4))
        self._draw(views, output(COLOURS, _packed(out)), drawn_props)
        return out

    def render_mask(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None = None,
        out: np.ndarray | None = None,
        look: Look | Sequence[Look] | np.ndarray | None = None,
        props: ArrayLike | None = None,
    ) -> np.ndarray:
        """Water masks [N, H, W] uint8, 0 or 255: the fourth channel of `render`, without drawing colours.

        Arguments and errors as in `render`. Masks do not depend on the time, which only moves the ripples.
        """
        views = self._checked(poses, world_index, None, look)
        drawn_props = checked_props(props, len(views.poses))
        out = _checked_out(out, (len(views.poses), self.camera.height_px, self.camera.width_px))
        self._draw(views, output(MASK, masks=out), drawn_props)
        return out

    def render_layers(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        look: Look | Sequence[Look] | np.ndarray | None = None,
        layers: Collection[Layer] = ALL_LAYERS,
        props: ArrayLike | None = None,
        *,
        wind: ArrayLike | None = None,
    ) -> Frame:
        """Frames with depth and class; arguments and errors as in `render`.

        layers: names of the fields of `Frame` that are wanted. Nothing is drawn that they do not need: a mask alone
        takes a fraction of the time of a frame, and depth and class without colours are in between. Raises
        `RenderError` for another name, or none.
        """
        refuse_unknown("layer", layers, ALL_LAYERS, RenderError)
        if not layers:
            raise RenderError(f"name at least one of the layers {', '.join(ALL_LAYERS)}")
        views = self._checked(poses, world_index, time_s, look, wind)
        drawn_props = checked_props(props, len(views.poses))
        shape = (len(views.poses), self.camera.height_px, self.camera.width_px)
        image = np.empty((*shape, 4), np.uint8) if "rgb" in layers else None
        mask = np.empty(shape, np.uint8) if image is None else image[..., 3]
        pair = None
        if "depth_m" in layers or "class_id" in layers:
            pair = np.empty(shape, np.float32), np.empty(shape, np.uint8)
        if image is not None:
            self._draw(views, output(COLOURS, _packed(image), layers=pair), drawn_props)
        else:
            self._draw(views, output(MASK if pair is None else LAYERS, masks=mask, layers=pair), drawn_props)
        drawn: dict[str, Any] = {} if pair is None else {"depth_m": pair[0], "class_id": pair[1]}
        drawn["mask"] = mask > 0
        if image is not None:
            drawn["rgb"] = np.ascontiguousarray(image[..., :3])
        wanted: dict[str, Any] = {name: drawn[name] if name in layers else None for name in ALL_LAYERS}
        return Frame(**wanted)

    def render_tensors(
        self, views: Sequence[Any], out: Any, layers: tuple[Any, Any] | None = None, props: Any = None
    ) -> None:
        """`render` or `render_mask` without checks and copies, from torch's tensors on this renderer's device into one.

        views: world_index [N] int64, poses [N, 4] and times [N] float64, and looks as rows [N, LOOK_COLUMNS] float32 of
        `thalweg.render.records.appearance.look_rows`; out: [N, H, W, 4] uint8, or [N, H, W, 1] for the mask alone;
        layers: tensors for the depths [N, H, W] float32 and the classes [N, H, W] uint8 too, see `Frame`;
        props: None, or [N, P, 6] float32 of `thalweg.render.records.props`.
        """
        if self._gpu is not None:
            self._gpu.draw_tensors(views, out, layers, props)
            return
        array = out.numpy()
        pair = None if layers is None else (layers[0].numpy(), layers[1].numpy())
        if array.shape[-1] == 1:
            wanted = output(MASK if pair is None else LAYERS, masks=array[..., 0], layers=pair)
        else:
            wanted = output(COLOURS, _packed(array), layers=pair)
        own_props = NO_PROPS if props is None else props.numpy()
        self._draw(Views(*(tensor.numpy() for tensor in views)), wanted, own_props)

    @property
    def scratch_bytes(self) -> int:
        """Least memory of the GPU that drawing takes, beside the worlds' tables and the frames; 0 on the CPU."""
        return 0 if self._gpu is None else self._gpu.scratch_bytes

    def _draw(self, views: Views, wanted: Output, props: np.ndarray) -> None:
        """Draw into the arrays of an `Output`; props [N, P, 6] float32, or `NO_PROPS`."""
        if self._gpu is not None:
            self._gpu.draw_for_host(views, wanted, props)
            return
        compilation.finish()
        if self._lens is not None:
            self._lens.draw(self.scene, views, wanted, props)
            return
        draw(
            self.scene,
            views,
            self._settings,
            wanted,
            bands_of(self.camera.height_px, get_num_threads(), len(views.poses)),
            props,
        )

    def _checked(
        self,
        poses: ArrayLike,
        world_index: ArrayLike | None,
        time_s: ArrayLike | None,
        look: Look | Sequence[Look] | np.ndarray | None,
        wind: ArrayLike | None = None,
    ) -> Views:
        # Copies, here and below: kernels would be compiled again for arrays that are strided or can't be written to.
        poses = np.array(poses, np.float64, order="C")
        if poses.ndim != 2 or poses.shape[1] != 4:
            raise RenderError(f"poses have shape {list(poses.shape)}; they must be [N, 4]: x, y, z, yaw")
        if not np.isfinite(poses).all():
            raise RenderError(f"pose {int(np.argmin(np.isfinite(poses).all(axis=1)))} is not finite")
        if len(far := np.argwhere(np.abs(poses) > FARTHEST)):
            row, column = far[0]
            raise RenderError(f"pose {row} holds {poses[row, column]:g}; its numbers lie within ±{FARTHEST:g}")
        count = len(poses)
        index = np.zeros(count, np.int64) if world_index is None else np.asarray(world_index)
        if index.shape != (count,):
            raise RenderError(f"world_index has shape {list(index.shape)}; there are {count} poses")
        if count and index.dtype.kind not in "iu":
            raise RenderError(f"world_index must be whole numbers, not {index.dtype}")
        index = np.array(index, np.int64)
        if count and (index.min() < 0 or index.max() >= self.count):
            raise RenderError(f"world_index must be in 0..{self.count - 1}; got {index.min()}..{index.max()}")
        times = _checked_times(time_s, count)
        if look is None:
            rows = np.repeat(self._default_look_row, count, axis=0)
        else:
            rows = look_rows(look_values(look, count), self.camera)
        if wind is not None:
            ruffle(rows, *_checked_wind(wind, count).T)
        return Views(index, poses, times, rows)

    @cached_property
    def _default_look_row(self) -> np.ndarray:
        """The row [1, LOOK_COLUMNS] of the default look, which most frames have."""
        return look_rows(look_values(None, 1), self.camera)


def _checked_times(time_s: ArrayLike | None, count: int) -> np.ndarray:
    """Return times [N] float64; raises `RenderError` for another shape, or times beyond `LATEST_S`."""
    times = np.asarray(0.0 if time_s is None else time_s, np.float64)
    if times.shape not in ((), (count,)):
        raise RenderError(f"time_s has shape {list(times.shape)}; it must be one number or [{count}]")
    if not (np.abs(times) <= LATEST_S).all():  # NaN is none of them
        wrong = times.ravel()[~(np.abs(times.ravel()) <= LATEST_S)][0]
        raise RenderError(f"time_s holds {wrong:g}; times lie within ±{LATEST_S:g} s")
    return np.array(np.broadcast_to(times, count), order="C")


def _checked_wind(wind: ArrayLike, count: int) -> np.ndarray:
    """Return winds [N, 2] float64; raises `RenderError` for another shape, or values beyond `FASTEST_M_PER_S`."""
    winds = np.asarray(wind, np.float64)
    if winds.shape != (count, 2) or not (np.abs(winds) <= FASTEST_M_PER_S).all():
        raise RenderError(
            f"wind has shape {list(winds.shape)} and values up to {np.abs(winds).max(initial=0.0):g}; it must be"
            f" [{count}, 2] in m/s east and north, within ±{FASTEST_M_PER_S:g}"
        )
    return winds


def _checked_out(out: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return `out`, or a new array of uint8 if it is None; raises `RenderError` for one that does not fit."""
    if out is None:
        return np.empty(shape, np.uint8)
    if out.shape != shape or out.dtype != np.uint8 or not out.flags.c_contiguous:
        raise RenderError(f"out is {out.dtype} {list(out.shape)}; it must be contiguous uint8 {list(shape)}")
    return out


def _packed(image: np.ndarray) -> np.ndarray:
    """Return the pixels of an image [N, H, W, 4] uint8 as [N, H, W] uint32, without a copy."""
    return image.view(np.uint32)[..., 0]
