"""Overlays of videos: the water that is found in each frame, and the move that a policy chooses.

The policy has no effect on the video. It sees the middle of each frame, cut to the shape of its camera.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.core.atomic_io import atomic_path
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import OPTIONS, Exportable
from thalweg.encoder.water import SIDES, WaterSegmenter, water_in
from thalweg.env.config import DEFAULT_CONFIG

VIEW_PX, PANEL_PX, MARGIN_PX = 384, 176, 16
"""Sides of the frame and of the panel beside it, and the margin around them, in pixels."""
WATER_RGB, SHADE = (40, 120, 255), 0.45
TEXT, QUIET, BACKGROUND = (235, 235, 235), (110, 118, 126), (24, 28, 32)
LINE_PX = 22


class Follower:
    """A policy that sees the frames of a video one after the other."""

    def __init__(self, policy: Any, segmenter: WaterSegmenter | None = None) -> None:
        """Prepare a policy; `segmenter` finds the water for the mask.

        Raises the errors of `Exportable.of`, and `ExportError` for a policy that takes proprioception, masks without a
        `segmenter`, or frames whose sides a `segmenter` does not take.
        """
        self.chosen = chosen = Exportable.of(policy)
        if "proprioception" in chosen.inputs:
            raise ExportError("the policy takes proprioception, which a video does not have")
        if "mask" in chosen.sees and segmenter is None:
            raise ExportError(f"the policy sees {chosen.sees}: finding the water in a video needs a segmenter")
        self.segmenter = segmenter
        camera = chosen.camera
        self.size_px = camera.height_px, camera.width_px
        if segmenter is not None and any(side % SIDES for side in self.size_px):
            raise ExportError(
                f"the policy sees frames of {camera.height_px} x {camera.width_px} pixels (height x width); finding the"
                f" water needs sides that are multiples of {SIDES}"
            )
        self._player = chosen.policy.player(1, deterministic=True)
        self._fresh = True

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return colours [H, W, 3] uint8, options int64 [4] and water mask [H, W] uint8 of a frame [H', W', 3] uint8.

        H and W are those of the policy's camera. The mask is None without a segmenter.
        """
        colours = cut_to(frame, self.size_px)
        mask = None
        if self.segmenter is not None:
            mask = water_in(self.segmenter, colours[None])[0].astype(np.uint8) * 255
        parts = [colours] if "rgb" in self.chosen.sees else []
        if "mask" in self.chosen.sees:
            assert mask is not None
            parts.append(mask[..., None])
        seen = np.concatenate(parts, axis=-1)[None]
        if self.chosen.encoder is not None:
            seen = self.chosen.encoder(seen)
        options = self._player(seen, np.array([self._fresh]))[0]
        self._fresh = False
        return colours, options, mask


def cut_to(frame: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Return the middle of a frame [H', W', 3] uint8, with the shape of a camera, as [H, W, 3] uint8."""
    height, width = size_px
    scale = min(frame.shape[0] / height, frame.shape[1] / width)
    top, left = (frame.shape[0] - scale * height) / 2, (frame.shape[1] - scale * width) / 2
    box = (left, top, left + scale * width, top + scale * height)
    return np.array(Image.fromarray(frame).resize((width, height), Image.Resampling.BOX, box=box))


def read_steps(path: Path, step_s: float = DEFAULT_CONFIG.step_s) -> Iterator[np.ndarray]:
    """Yield frames [H, W, 3] uint8 of a video that are about `step_s` seconds apart; all frames of a slower one.

    Raises `ExportError` for a file that is no video, and `FileNotFoundError`.
    """
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    reader = imageio_ffmpeg.read_frames(str(path))
    try:
        about: Any = next(reader)
        width, height = about["size"]
        every = frames_of_step(_fps(about, path), step_s)
        for index, frame in enumerate(reader):
            if index % every == 0:
                yield np.frombuffer(frame, np.uint8).reshape(height, width, 3)  # pyright: ignore
    except (OSError, RuntimeError, IndexError, StopIteration) as error:
        raise ExportError(f"{path} cannot be read as a video") from error
    finally:
        reader.close()


def _fps(about: Any, path: Path) -> float:
    """Return the frames a second of a video described by ffmpeg; raises `ExportError` if it does not say."""
    fps = about.get("fps")
    if not fps or not 0 < fps < float("inf"):
        raise ExportError(f"{path} does not say how many frames a second it has (fps: {fps})")
    return float(fps)


def frames_of_step(fps: float, step_s: float = DEFAULT_CONFIG.step_s) -> int:
    """Return the number of frames from one step to the next, in a video of `fps` frames a second; at least 1."""
    return max(round(fps * step_s), 1)


def steps_a_second(path: Path) -> float:
    """Return how many frames of a second of a video `read_steps` yields; raises its errors."""
    if not path.is_file():
        raise FileNotFoundError(2, "No such file", str(path))
    reader = imageio_ffmpeg.read_frames(str(path))
    try:
        fps = _fps(next(reader), path)
    except (OSError, RuntimeError, IndexError, StopIteration) as error:
        raise ExportError(f"{path} cannot be read as a video") from error
    finally:
        reader.close()
    return fps / frames_of_step(fps)


def overlay(colours: np.ndarray, options: np.ndarray, mask: np.ndarray | None, title: str, step: int) -> np.ndarray:
    """Return the overlay [h, w, 3] uint8 of one step.

    Args:
        colours: [H, W, 3] uint8.
        options: int64 [4], the policy's move.
        mask: [H, W] uint8, above 0 where water was found; None to show none.
        title: Name of the policy.
        step: Number of the step, from 1.
    """
    height = VIEW_PX + 2 * MARGIN_PX
    canvas = Image.new("RGB", (VIEW_PX + PANEL_PX + 3 * MARGIN_PX, height), BACKGROUND)
    shaded = colours.astype(np.float32)
    if mask is not None:
        shaded[mask > 0] = (1 - SHADE) * shaded[mask > 0] + SHADE * np.array(WATER_RGB, np.float32)
    canvas.paste(Image.fromarray(shaded.astype(np.uint8)).resize((VIEW_PX, VIEW_PX)), (MARGIN_PX, MARGIN_PX))
    left, draw, font = VIEW_PX + 2 * MARGIN_PX, ImageDraw.Draw(canvas), ImageFont.load_default(size=15)
    for line, text in enumerate((title, f"step {step}")):
        draw.text((left, MARGIN_PX + line * LINE_PX), text, TEXT, font)
    for branch, (names, option) in enumerate(zip(OPTIONS, options, strict=True)):
        name = names[int(option)]
        at = (left, MARGIN_PX + (3 + branch) * LINE_PX)
        draw.text(at, name if name != "none" else "-", QUIET if name in ("none", "backward") else TEXT, font)
    if mask is not None:
        top = height - MARGIN_PX - PANEL_PX
        canvas.paste(Image.fromarray(mask).resize((PANEL_PX, PANEL_PX)).convert("RGB"), (left, top))
        draw.text((left, top - LINE_PX), "water found", TEXT, font)
    return np.asarray(canvas)


def follow(video: Path, path: Path, follower: Follower, title: str) -> np.ndarray:
    """Write the overlay of a video as H.264, atomically, and return the options int64 [T, 4] of the T moves.

    Raises the errors of `read_steps`, and `ExportError` for a video without a frame.
    """
    taken: list[np.ndarray] = []
    rate = steps_a_second(video)
    with atomic_path(path) as draft:
        writer: Any = None
        try:
            for frame in read_steps(video):
                colours, options, mask = follower(frame)
                taken.append(options)
                picture = overlay(colours, options, mask, title, len(taken))
                if writer is None:
                    size = picture.shape[1], picture.shape[0]
                    settings: Any = {"fps": rate, "quality": None, "macro_block_size": 2}
                    options_of_ffmpeg = ["-crf", "22", "-movflags", "+faststart"]
                    writer = imageio_ffmpeg.write_frames(str(draft), size, output_params=options_of_ffmpeg, **settings)
                    writer.send(None)
                writer.send(np.ascontiguousarray(picture))
        finally:
            if writer is not None:
                writer.close()
        if writer is None:
            raise ExportError(f"{video} has no frame")
    return np.stack(taken)
