"""Videos as H.264, written and read a frame at a time by the ffmpeg of `imageio-ffmpeg`."""

import errno
import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np

CODEC, PIXELS = "libx264", "yuv420p"
"""Encoder, and format of the pixels, whose colours have half the height and width of the frame."""
FULL_BYTES = 100_000
"""Free space on a disk below which it counts as full."""


class VideoError(ValueError):
    """A video that cannot be read or written; the message names it."""


@dataclass(frozen=True)
class Video:
    """A video that is being read."""

    fps: float
    """Frames a second; NaN if the file does not say."""
    frames: Iterator[np.ndarray]
    """Frames [H, W, 3] uint8, one after the other, as far as they can be read.

    Raises `VideoError` where ffmpeg fails; but of a damaged video it often reads fewer frames and tells no error.
    """


class VideoWriter:
    """Takes the frames of a video one after the other; made by `video_writer`."""

    def __init__(self, path: Path, fps: float, crf: int, key_every: int | None, name: Path, comment: str = "") -> None:
        self._path, self._name, self._settings = path, name, (fps, crf, key_every, comment)
        self._process: Any = None
        self._shape: tuple[int, ...] = ()
        self.count = 0
        """Number of frames."""

    def send(self, frame: np.ndarray) -> None:
        """Add a frame [H, W, 3] uint8.

        Raises `VideoError` for sides that are odd, for a frame of another size than the first one, and for what ffmpeg
        does not take, and `OSError` for a full disk.
        """
        if self._process is not None and frame.shape != self._shape:
            (height, width, _), (before, wide, _) = frame.shape, self._shape
            sizes = f"one of {height} x {width} came after those of {before} x {wide}"
            raise VideoError(f"{self._name} needs frames of one height and width: {sizes}")
        with _errors_of_writing(self._path, self._name, 0):
            if self._process is None:
                self._process, self._shape = _begin(self._path, frame, *self._settings), frame.shape
            self._process.send(np.ascontiguousarray(frame))
        self.count += 1

    def close(self) -> None:
        """End the video; the file is whole only if all frames were written."""
        if self._process is not None:
            self._process.close()

    def check(self) -> None:
        """Raise `VideoError`, or `OSError` for a full disk, for a video without an end."""
        if self.count:
            with _errors_of_writing(self._path, self._name, -1):
                imageio_ffmpeg.count_frames_and_secs(str(self._path))


@contextmanager
def video_writer(
    path: Path, fps: float, *, crf: int, key_every: int | None = None, name: Path | None = None, comment: str = ""
) -> Iterator[VideoWriter]:
    """Yield a writer of a video; without a frame, there is no file. Arguments and errors are those of `write_video`."""
    writer = VideoWriter(path, fps, crf, key_every, path if name is None else name, comment)
    try:
        yield writer
    finally:
        writer.close()
    writer.check()


def write_video(
    path: Path,
    frames: Iterable[np.ndarray],
    fps: float,
    *,
    crf: int,
    key_every: int | None = None,
    name: Path | None = None,
    comment: str = "",
) -> int:
    """Write frames [H, W, 3] uint8, all of one size, and return how many there are; writes no file without any.

    Args:
        path: File that does not exist yet.
        frames: The frames.
        fps: Frames a second.
        crf: Constant rate factor of H.264, from 0, lossless, to 51.
        key_every: Frames between two key frames, from which reading can begin; None leaves them to the encoder.
        name: File that errors name, such as the one that a draft at `path` becomes; `path` by default.
        comment: Text for the file's metadata, which `comment_of` reads; none if empty.

    Raises the errors of `VideoWriter.send`.
    """
    with video_writer(path, fps, crf=crf, key_every=key_every, name=name, comment=comment) as writer:
        for frame in frames:
            writer.send(frame)
    return writer.count


def _begin(path: Path, frame: np.ndarray, fps: float, crf: int, key_every: int | None, comment: str) -> Any:
    """Return a writer of frames of the size of `frame`."""
    height, width = frame.shape[:2]
    if height % 2 or width % 2:
        raise VideoError(f"a video needs an even height and width, not {height} x {width}")
    keys = [] if key_every is None else ["-g", str(key_every)]
    settings: Any = {"fps": fps, "codec": CODEC, "pix_fmt_out": PIXELS, "quality": None, "macro_block_size": 1}
    about = ["-metadata", f"comment={comment}"] if comment else []
    options = ["-crf", str(crf), *keys, *about, "-movflags", "+faststart"]
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), output_params=options, **settings)
    writer.send(None)
    return writer


@contextmanager
def open_video(path: Path) -> Iterator[Video]:
    """Yield a video; raises `VideoError` for a file that is none, and `FileNotFoundError`."""
    if not path.is_file():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    reader = imageio_ffmpeg.read_frames(str(path))
    try:
        with _errors_of_reading(path):
            about: Any = next(reader)
            width, height = about["size"]
        yield Video(float(about.get("fps") or np.nan), _frames(reader, path, (height, width, 3)))
    finally:
        reader.close()


def comment_of(path: Path) -> str:
    """Return the one-line comment in a video's metadata; empty if there is none, or if the file is no video."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "ffmetadata", "-"]
    told = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False).stdout
    lines = (line.partition("=") for line in told.decode(errors="replace").splitlines())
    comment = next((value for key, _, value in lines if key == "comment"), "")
    return re.sub(r"\\(.)", r"\1", comment)  # ffmpeg escapes = ; # and backslashes


def read_video(path: Path) -> Iterator[np.ndarray]:
    """Yield all frames [H, W, 3] uint8 of a video; raises the errors of `open_video`."""
    with open_video(path) as video:
        yield from video.frames


def _frames(reader: Any, path: Path, shape: tuple[int, int, int]) -> Iterator[np.ndarray]:
    while True:
        with _errors_of_reading(path):
            frame = next(reader, None)
        if frame is None:
            return
        yield np.frombuffer(frame, np.uint8).reshape(shape)


@contextmanager
def _errors_of_reading(path: Path) -> Iterator[None]:
    """Raise ffmpeg's errors as `VideoError`, with the last line of what it says."""
    try:
        yield
    except (OSError, RuntimeError, IndexError, KeyError, StopIteration) as error:
        raise VideoError(f"{path} cannot be read as a video{_reason(error, -1)}") from error


@contextmanager
def _errors_of_writing(path: Path, name: Path, line: int) -> Iterator[None]:
    """Raise ffmpeg's errors, which tell only of a broken pipe, as that of a full disk or as `VideoError` of `name`.

    `line`: index of the line that says why; 0 where frames are sent, since the command follows, and -1 in reading.
    """
    try:
        yield
    except (OSError, RuntimeError) as error:
        if shutil.disk_usage(path.parent).free < FULL_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(name)) from error
        raise VideoError(f"{name} cannot be written as a video{_reason(error, line)}") from error


def _reason(error: BaseException, line: int) -> str:
    """Return the line of an error with the index `line` after a colon; nothing for an error without text."""
    lines = str(error).strip().splitlines()
    return f": {lines[line]}" if lines else ""
