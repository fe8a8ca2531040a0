"""Overlays of videos: the water that is found in each frame, and the move that a policy chooses.

The policy has no effect on the video. It sees the middle of each frame, cut to the shape of its camera.
"""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.core.atomic_io import atomic_path
from thalweg.core.video import Video, VideoError, open_video, write_video
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import Exportable
from thalweg.encoder.water import SIDES, WaterSegmenter, water_in

VIEW_PX, PANEL_PX, MARGIN_PX = 384, 176, 16
"""Sides of the frame and of the panel beside it, and the margin around them, in pixels."""
CRF = 22
"""Constant rate factor of overlays."""
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
        self.moves = chosen.moves
        """What the options of each branch do, or +1, 0 and -1."""
        self.step_s = chosen.steps["seconds"]
        """Seconds of a step in the policy's training."""
        if segmenter is not None and any(side % SIDES for side in self.size_px):
            raise ExportError(
                f"the policy sees frames of {camera.height_px} x {camera.width_px} pixels (height x width); finding the"
                f" water needs sides that are multiples of {SIDES}"
            )
        self._player = chosen.policy.player(1, deterministic=True)
        self._fresh = True

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return colours [H, W, 3] uint8, options int64 [4] or numbers float32 [4] of the move, and the water mask
        [H, W] uint8 of a frame [H', W', 3] uint8.

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


def frames_of_step(video: Video, path: Path, step_s: float) -> int:
    """Return the number of frames of a video from one step of `step_s` seconds to the next, at least 1.

    Raises `VideoError`, with the video's `path`, if it does not say how many frames a second it has.
    """
    if not 0 < video.fps < float("inf"):
        raise VideoError(f"{path} does not say how many frames a second it has (fps: {video.fps})")
    return max(round(video.fps * step_s), 1)


def overlay(
    colours: np.ndarray,
    options: np.ndarray,
    moves: Mapping[str, tuple[str, str, str]],
    mask: np.ndarray | None,
    title: str,
    step: int,
) -> np.ndarray:
    """Return the overlay [h, w, 3] uint8 of one step.

    Args:
        colours: [H, W, 3] uint8.
        options: int64 [4] or float32 [4] in -1..1, the policy's move.
        moves: What the options of each branch do, as `thalweg.env.spaces.moves_in_words` returns it.
        mask: [H, W] uint8, above 0 where water was found; None to show none.
        title: Name of the policy.
        step: Number of the step, from 1.
    """
    height = VIEW_PX + 2 * MARGIN_PX
    canvas = Image.new("RGB", (VIEW_PX + PANEL_PX + 3 * MARGIN_PX, height), BACKGROUND)
    shaded = colours.astype(np.float32)
    if mask is not None:
        shaded[mask > 0] = (1 - SHADE) * shaded[mask > 0] + SHADE * np.array(WATER_RGB, np.float32)
    _paste(canvas, Image.fromarray(shaded.astype(np.uint8)), VIEW_PX, (MARGIN_PX, MARGIN_PX))
    left, draw, font = VIEW_PX + 2 * MARGIN_PX, ImageDraw.Draw(canvas), ImageFont.load_default(size=15)
    for line, text in enumerate((title, f"step {step}")):
        draw.text((left, MARGIN_PX + line * LINE_PX), text, TEXT, font)
    for branch, (names, option) in enumerate(zip(moves.values(), options, strict=True)):
        name = move_in_words(names, option)
        at = (left, MARGIN_PX + (3 + branch) * LINE_PX)
        draw.text(at, name if name != "none" else "-", QUIET if name == "none" else TEXT, font)
    if mask is not None:
        top = height - MARGIN_PX - PANEL_PX
        _paste(canvas, Image.fromarray(mask), PANEL_PX, (left, top))
        draw.text((left, top - LINE_PX), "water found", TEXT, font)
    return np.asarray(canvas)


def _paste(canvas: Image.Image, picture: Image.Image, side_px: int, corner: tuple[int, int]) -> None:
    """Paste a picture into the middle of a square, as large as fits; `corner`: left and upper end of the square."""
    scale = side_px / max(picture.size)
    width, height = (max(round(scale * side), 1) for side in picture.size)
    at = corner[0] + (side_px - width) // 2, corner[1] + (side_px - height) // 2
    canvas.paste(picture.resize((width, height)).convert("RGB"), at)


def move_in_words(names: tuple[str, ...], choice: np.number) -> str:
    """Return what an option does, or a number with its share of a step; `names` of the options, or of +1, 0 and -1."""
    if np.issubdtype(choice.dtype, np.integer):
        return names[int(choice)]
    name, share = names[0 if choice > 0 else 2], f"{abs(choice):.0%}"
    return "none" if name == "none" or share == "0%" else f"{name} {share}"


def follow(path: Path, out: Path, follower: Follower, title: str) -> np.ndarray:
    """Write the overlay of the video `path` to `out`, atomically, and return its T moves [T, 4].

    Frames are taken about a step of the policy's training apart. Raises `FileNotFoundError`, and `VideoError` for a
    file that is no video, has no frame, or does not say how many frames a second it has.
    """
    taken: list[np.ndarray] = []

    def overlays(frames: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
        for frame in frames:
            colours, options, mask = follower(frame)
            taken.append(options)
            yield overlay(colours, options, follower.moves, mask, title, len(taken))

    with open_video(path) as video, atomic_path(out) as draft:
        every = frames_of_step(video, path, follower.step_s)
        if not write_video(draft, overlays(islice(video.frames, 0, None, every)), video.fps / every, crf=CRF, name=out):
            raise VideoError(f"{path} has no frame")
    return np.stack(taken)
