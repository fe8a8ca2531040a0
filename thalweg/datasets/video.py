"""Videos of recordings: colours as H.264, written and read by the ffmpeg of `imageio-ffmpeg`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np

from thalweg.datasets.errors import DatasetError

CODEC, PIXELS = "libx264", "yuv420p"
CRF = 18
"""Constant rate factor of H.264, low enough that losses are hardly visible."""
KEY_EVERY = 2
"""Frames between two key frames, so that single frames are read fast."""


def write_video(path: Path, frames: np.ndarray, fps: int) -> None:
    """Write frames [T, H, W, 3] uint8, `fps` a second; raises `DatasetError` for an odd height or width."""
    height, width = frames.shape[1:3]
    if height % 2 or width % 2:
        raise DatasetError(f"a video needs an even height and width, not {height} x {width}: record without --video")
    path.parent.mkdir(parents=True, exist_ok=True)
    settings: dict[str, Any] = {"codec": CODEC, "pix_fmt_out": PIXELS, "quality": None, "macro_block_size": 1}
    options = ["-crf", str(CRF), "-g", str(KEY_EVERY), "-movflags", "+faststart"]
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), fps=fps, output_params=options, **settings)
    try:
        writer.send(None)
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


def read_video(path: Path) -> Iterator[np.ndarray]:
    """Yield the frames [H, W, 3] uint8 of a video; raises `DatasetError` for a file that is no video."""
    reader = imageio_ffmpeg.read_frames(str(path))
    try:
        about: Any = next(reader)
        width, height = about["size"]
        for frame in reader:
            yield np.frombuffer(frame, np.uint8).reshape(height, width, 3)  # pyright: ignore
    except (OSError, StopIteration, IndexError, KeyError, RuntimeError) as error:
        reason = str(error).strip().splitlines()
        raise DatasetError(f"{path} cannot be read as a video{f': {reason[-1]}' if reason else ''}") from error
    finally:
        reader.close()


def about_video(frames: tuple[int, int], fps: int) -> dict[str, Any]:
    """Return LeRobot's metadata of a video; `frames` is H and W."""
    return {
        "video.height": frames[0],
        "video.width": frames[1],
        "video.codec": "h264",
        "video.pix_fmt": PIXELS,
        "video.is_depth_map": False,
        "video.fps": fps,
        "video.channels": 3,
        "has_audio": False,
    }
