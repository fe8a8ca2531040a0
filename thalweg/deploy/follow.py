"""Overlays of videos: the water that is found in each frame, what a policy sees, and the move that it chooses.

The policy has no effect on the video. It sees the middle of each frame, cut to the shape of its camera.
"""

from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from thalweg.bench.pictures.film_format import FILM_COMMENT
from thalweg.core.atomic_io import atomic_path
from thalweg.core.video import Video, VideoError, comment_of, open_video, write_video
from thalweg.deploy.errors import ExportError
from thalweg.deploy.export import Exportable
from thalweg.encoder.water import WaterSegmenter, water_in

VIEW_PX, PANEL_PX, MARGIN_PX = 384, 256, 16
"""Sides of the frame and of the two panels beside it, and the margin around them, in pixels."""
CRF = 22
"""Constant rate factor of overlays."""
WATER_RGB, SHADE = (40, 120, 255), 0.45
TEXT, QUIET, BACKGROUND = (235, 235, 235), (110, 118, 126), (24, 28, 32)
LINE_PX = 22
SEEN = {1: "water mask", 3: "colours", 4: "colours and mask"}
"""What an image with so many channels shows."""


class Followed(NamedTuple):
    """One step of a policy; H and W are those of its camera."""

    colours: np.ndarray
    """[H, W, 3] uint8, the middle of the frame."""
    seen: np.ndarray
    """[H, W, C] uint8, the image that the policy, or its encoder, is given: colours, the water mask, or both."""
    move: np.ndarray
    """Options int64 [4], or numbers float32 [4] in -1..1."""
    mask: np.ndarray | None
    """[H, W] uint8, 255 where water was found; None without a segmenter."""


class Follower:
    """A policy that sees the frames of a video one after the other."""

    def __init__(self, policy: Any, segmenter: WaterSegmenter | None = None) -> None:
        """Prepare a policy; `segmenter` finds the water for the mask.

        Raises the errors of `Exportable.of`, and `ExportError` for a policy that takes proprioception, or masks without
        a `segmenter`.
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
        self._player = chosen.policy.player(1, deterministic=True)
        self._fresh = True

    def __call__(self, frame: np.ndarray) -> Followed:
        """Return what the policy sees of a frame [H', W', 3] uint8, and its move."""
        colours = cut_to(frame, self.size_px)
        mask = None
        if self.segmenter is not None:
            mask = water_in(self.segmenter, colours[None])[0].astype(np.uint8) * 255
        parts = [colours] if "rgb" in self.chosen.sees else []
        if "mask" in self.chosen.sees:
            assert mask is not None
            parts.append(mask[..., None])
        seen = np.concatenate(parts, axis=-1)
        given = seen[None] if self.chosen.encoder is None else self.chosen.encoder(seen[None])
        move = self._player(given, np.array([self._fresh]))[0]
        self._fresh = False
        return Followed(colours, seen, move, mask)


def cut_to(frame: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Return the middle of a frame [H', W', 3] uint8, with the shape of a camera, as [H, W, 3] uint8."""
    height, width = size_px
    scale = min(frame.shape[0] / height, frame.shape[1] / width)
    # Rounding may not lead over the frame's edge.
    top, left = max((frame.shape[0] - scale * height) / 2, 0.0), max((frame.shape[1] - scale * width) / 2, 0.0)
    box = (left, top, min(left + scale * width, frame.shape[1]), min(top + scale * height, frame.shape[0]))
    return np.array(Image.fromarray(frame).resize((width, height), Image.Resampling.BOX, box=box))


def frames_of_step(video: Video, path: Path, step_s: float) -> int:
    """Return the number of frames of a video from one step of `step_s` seconds to the next, at least 1.

    Raises `VideoError`, with the video's `path`, if it does not say how many frames a second it has.
    """
    if not 0 < video.fps < float("inf"):
        raise VideoError(f"{path} does not say how many frames a second it has (fps: {video.fps})")
    return max(round(video.fps * step_s), 1)


def overlay(followed: Followed, moves: Mapping[str, tuple[str, str, str]], title: str, step: int) -> np.ndarray:
    """Return the overlay [h, w, 3] uint8 of one step: the frame with the water shaded, what the policy sees as it is
    given, and the mask.

    Args:
        followed: The step.
        moves: What the options of each branch do, as `thalweg.env.spaces.moves_in_words` returns it.
        title: Name of the policy.
        step: Number of the step, from 1.
    """
    height = VIEW_PX + 2 * MARGIN_PX
    canvas = Image.new("RGB", (VIEW_PX + 2 * PANEL_PX + 4 * MARGIN_PX, height), BACKGROUND)
    _paste(canvas, Image.fromarray(_shaded(followed)), VIEW_PX, (MARGIN_PX, MARGIN_PX))
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(size=15)
    left, right = VIEW_PX + 2 * MARGIN_PX, VIEW_PX + PANEL_PX + 3 * MARGIN_PX
    for line, text in enumerate((title, f"step {step}")):
        draw.text((left, MARGIN_PX + line * LINE_PX), text, TEXT, font)
    for line, (names, choice) in enumerate(zip(moves.values(), followed.move, strict=True)):
        name = move_in_words(names, choice)
        at = (right, MARGIN_PX + line * LINE_PX)
        draw.text(at, name if name != "none" else "-", QUIET if name == "none" else TEXT, font)
    top, channels = height - MARGIN_PX - PANEL_PX, followed.seen.shape[-1]
    draw.text((left, top - LINE_PX), f"the policy sees: {SEEN[channels]}", TEXT, font)
    picture = followed.seen[..., 0] if channels == 1 else followed.seen[..., :3]
    _paste(canvas, Image.fromarray(picture), PANEL_PX, (left, top), smooth=False)
    if followed.mask is not None:
        draw.text((right, top - LINE_PX), "water found", TEXT, font)
        _paste(canvas, Image.fromarray(followed.mask), PANEL_PX, (right, top), smooth=False)
    return np.asarray(canvas)


def _shaded(followed: Followed) -> np.ndarray:
    """Return the colours [H, W, 3] uint8 of a step, shaded where water was found."""
    shaded = followed.colours.astype(np.float32)
    if followed.mask is not None:
        water = followed.mask > 0
        shaded[water] = (1 - SHADE) * shaded[water] + SHADE * np.array(WATER_RGB, np.float32)
    return shaded.astype(np.uint8)


def _paste(
    canvas: Image.Image, picture: Image.Image, side_px: int, corner: tuple[int, int], *, smooth: bool = True
) -> None:
    """Paste a picture into the middle of a square, whose left and upper end is the `corner`, as large as fits.

    Without smoothing, pixels stay as they are, and a picture that fits is enlarged by a whole factor.
    """
    scale = side_px / max(picture.size)
    if not smooth and scale > 1:
        scale = int(scale)
    width, height = (max(round(scale * side), 1) for side in picture.size)
    at = corner[0] + (side_px - width) // 2, corner[1] + (side_px - height) // 2
    way = Image.Resampling.BICUBIC if smooth else Image.Resampling.NEAREST
    canvas.paste(picture.resize((width, height), way).convert("RGB"), at)


def move_in_words(names: tuple[str, ...], choice: np.number) -> str:
    """Return what an option does, or a number with its share of a step; `names` of the options, or of +1, 0 and -1."""
    if np.issubdtype(choice.dtype, np.integer):
        return names[int(choice)]
    name, share = names[0 if choice > 0 else 2], f"{abs(choice):.0%}"
    return "none" if name == "none" or share == "0%" else f"{name} {share}"


def follow(path: Path, out: Path, follower: Follower, title: str) -> np.ndarray:
    """Write the overlay of the video `path` to `out`, atomically, and return its T moves [T, 4].

    Frames are taken about a step of the policy's training apart. Raises `FileNotFoundError`, and `VideoError` for a
    file that is no video, has no frame, or does not say how many frames a second it has, and for a film, whose frames
    are not those of a camera.
    """
    if comment_of(path) == FILM_COMMENT:
        raise VideoError(
            f"{path} is a film by thalweg film, whose frames also show the mask, the map and text; record what the "
            "camera sees by `thalweg record steady --video --episodes 1`"
        )
    taken: list[np.ndarray] = []

    def overlays(frames: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
        for frame in frames:
            followed = follower(frame)
            taken.append(followed.move)
            yield overlay(followed, follower.moves, title, len(taken))

    with open_video(path) as video, atomic_path(out) as draft:
        every = frames_of_step(video, path, follower.step_s)
        if not write_video(draft, overlays(islice(video.frames, 0, None, every)), video.fps / every, crf=CRF, name=out):
            raise VideoError(f"{path} has no frame")
    return np.stack(taken)
