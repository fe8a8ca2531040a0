"""Reader of data sets in LeRobot's format that Thalweg recorded."""

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from PIL import Image

from thalweg.core.video import VideoError, read_video
from thalweg.datasets import lerobot_layout as layout
from thalweg.datasets.episode import About, RecordedEpisode, check_episode
from thalweg.datasets.errors import DatasetError

PLAIN = ("terminated", "task", "options")
"""Keys of a flight's description that are taken as they are."""


def is_lerobot(folder: Path) -> bool:
    """Return whether a folder holds a data set in LeRobot's format."""
    return (folder / layout.INFO).is_file()


def read_lerobot(folder: Path) -> tuple[About, Iterator[RecordedEpisode]]:
    """Return the description of a data set, and an iterator over its flights.

    The format has no images after the last step: those before it are repeated there. Raises `DatasetError` for a data
    set that was not recorded by Thalweg or is of another version; so does the iterator for a table, a picture or a
    video that cannot be read, a missing column, and a video that has not a frame for each row.
    """
    if not (folder / layout.ABOUT).is_file():
        raise DatasetError(f"{folder} is a data set of LeRobot, but was not recorded by Thalweg")
    try:
        told = json.loads((folder / layout.ABOUT).read_text(encoding="utf-8"))
        info = json.loads((folder / layout.INFO).read_text(encoding="utf-8"))
        version, form = info["codebase_version"], told["format"]
        common, flights = told["about"], list(told["flights"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise DatasetError(f"{folder} cannot be read as a data set of LeRobot: {error!r}") from error
    if (version, form) != (layout.CODEBASE_VERSION, layout.FORMAT):
        raise DatasetError(
            f"{folder} is of LeRobot's version {version} and Thalweg's format {form}; this version reads"
            f" {layout.CODEBASE_VERSION} and {layout.FORMAT}"
        )
    about = About.from_plain(common, folder)
    return about, (_read_episode(folder, number, flight, about) for number, flight in enumerate(flights))


def _read_episode(folder: Path, number: int, flight: dict[str, Any], about: About) -> RecordedEpisode:
    """Return a flight of a data set; raises `DatasetError`, which names what is wrong."""
    files = _FlightFiles.open(folder, number, flight)
    rgb = files.pictures(layout.CAMERA)
    if rgb is None:
        video = folder / layout.VIDEO_PATH.format(video_key=layout.CAMERA, **layout.place(number))
        rgb = _again(_frames_of(video, len(files.table)))
    if not len(files.table):
        raise DatasetError(f"{files.path} has no rows")
    actions = len(layout.ACTION_NAMES)
    episode = RecordedEpisode(
        rgb=rgb,
        mask=files.pictures("mask"),
        depth_m=_again(files.column("depth", *rgb.shape[1:3])) if files.has("depth") else None,
        class_id=files.pictures("class"),
        proprioception=files.with_end(layout.STATE, (len(about.proprioception),), "end_state"),
        poses=files.with_end("pose", (len(layout.POSE_NAMES),), "end_pose"),
        times_s=files.with_end("clock_s", (), "end_clock_s"),
        moves=files.column("action", actions),
        options=files.column("option", actions) if files.has("option") else None,
        rewards=files.column("next.reward").astype(np.float64),
        costs=files.column("next.cost", len(about.cost_kinds)).astype(np.float64),
        terminated=flight["terminated"],
        reason=int(files.column("next.reason")[-1]),
        pilots=tuple(files.column("pilot").tolist()),
        task=flight["task"],
        options_of_flight=flight["options"],
    )
    check_episode(episode, about, files.path)
    return episode


@dataclass(frozen=True)
class _FlightFiles:
    """The table of a flight of T steps, and its description."""

    path: Path
    """File of the table."""
    table: Any
    """`pyarrow.Table` of T rows."""
    about: Path
    """File of the description."""
    number: int
    flight: dict[str, Any]
    """Its description."""

    @classmethod
    def open(cls, folder: Path, number: int, flight: dict[str, Any]) -> Self:
        """Return the files of a flight; raises `DatasetError` for a table or a description that cannot be used."""
        import pyarrow
        import pyarrow.parquet

        path = folder / layout.DATA_PATH.format(**layout.place(number))
        try:
            table = pyarrow.parquet.read_table(path)
        except (OSError, pyarrow.ArrowException) as error:
            raise DatasetError(f"{path} cannot be read: {error}") from error
        if not isinstance(flight, dict):
            raise DatasetError(f"{folder / layout.ABOUT} describes flight {number} by {flight!r:.40}, not by a mapping")
        if missing := [name for name in ("end_state", "end_pose", "end_clock_s", *PLAIN) if name not in flight]:
            raise DatasetError(f"{folder / layout.ABOUT} lacks {', '.join(missing)} of flight {number}")
        return cls(path, table, folder / layout.ABOUT, number, flight)

    def has(self, name: str) -> bool:
        """Return whether there is a column."""
        return name in self.table.column_names

    def column(self, name: str, *shape: int) -> np.ndarray:
        """Return a column [T, *shape]; raises `DatasetError` for one that is missing or of another kind."""
        import pyarrow

        if not self.has(name):
            raise DatasetError(f"{self.path} lacks the column {name}")
        try:
            chunks = self.table[name].combine_chunks()
            for _ in shape if shape != (1,) else ():  # a feature of one number is a column of numbers
                chunks = chunks.flatten()
            return chunks.to_numpy(zero_copy_only=False).reshape(len(self.table), *shape)
        except (AttributeError, ValueError, pyarrow.ArrowException) as error:
            raise DatasetError(f"{self.path} has another kind of numbers in the column {name}: {error}") from error

    def with_end(self, name: str, shape: tuple[int, ...], key: str) -> np.ndarray:
        """Return a column with the value after the last step [T + 1, *shape], which the description has by a key.

        Raises `DatasetError` for a column or a value that cannot be used.
        """
        values = self.column(name, *shape)
        try:
            return np.concatenate([values, np.asarray(self.flight[key], values.dtype).reshape(1, *shape)])
        except (TypeError, ValueError, OverflowError) as error:
            raise DatasetError(
                f"{self.about}: {key} of flight {self.number} is {self.flight[key]!r:.60}: {error}"
            ) from error

    def pictures(self, name: str) -> np.ndarray | None:
        """Return a column of pictures [T + 1, ...], the last one twice; None if there is no such column.

        Raises `DatasetError` for a damaged picture.
        """
        if not self.has(name):
            return None
        rows = self.table[name].to_pylist()
        try:
            return _again(np.stack([np.asarray(Image.open(io.BytesIO(row["bytes"]))) for row in rows]))
        except (OSError, SyntaxError, ValueError, KeyError, TypeError) as error:  # Pillow raises many for a damaged PNG
            raise DatasetError(f"{self.path} has a damaged picture in the column {name}: {error!r}") from error


def _frames_of(path: Path, steps: int) -> np.ndarray:
    """Return the frames [T, H, W, 3] of a video of T steps; raises `DatasetError` for another number of frames.

    Of a damaged video, ffmpeg often reads fewer frames and tells no error.
    """
    try:
        frames = list(read_video(path))
    except (OSError, VideoError) as error:
        raise DatasetError(str(error)) from error
    if len(frames) != steps:
        raise DatasetError(f"{path} has {len(frames)} frames that can be read, but its flight has {steps} steps")
    return np.stack(frames)


def _again(values: np.ndarray) -> np.ndarray:
    """Return values [T + 1, ...]: those given [T, ...], with the last one repeated."""
    return np.concatenate([values, values[-1:]])
