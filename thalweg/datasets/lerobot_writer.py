"""Writer of data sets in LeRobot's format, version 3.0.

Colours are PNG or video, mask and classes PNG, and depth is numbers.

The files are written by pyarrow and ffmpeg; LeRobot, which pins another version of torch, is not needed. A row is what
was seen before a step, the step, and its reward, costs and reason; images after the last step are not kept.
"""

import io
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from thalweg.core.video import VideoError, write_video
from thalweg.datasets import lerobot_layout as layout
from thalweg.datasets import lerobot_statistics as statistics
from thalweg.datasets.episode import About, RecordedEpisode, sentence_of
from thalweg.datasets.errors import DatasetError

CRF = 18
"""Constant rate factor of videos, low enough that losses are hardly visible."""
KEY_EVERY = 2
"""Frames between two key frames, so that single frames are read fast."""
PICTURES = (layout.CAMERA, "mask", "class")
WITHOUT_STATISTICS = ("depth", "pilot")
"""Features without statistics: one has a number for each pixel, the other is text."""


class LeRobotWriter:
    """Writes flights to a folder that `lerobot.datasets.lerobot_dataset.LeRobotDataset(NAME, root=folder)` reads."""

    def __init__(self, folder: Path, about: About, *, video: bool, name: Path) -> None:
        """Write to `folder`, which is empty.

        `video`: keep the colours as H.264, which is lossy; else as PNG, which is lossless. `name`: folder that errors
        name, which the draft in `folder` becomes.
        """
        self._folder, self._about, self._video, self._name = folder, about, video, name
        self._frames = 0
        """Number of rows so far."""
        self._features: dict[str, dict[str, Any]] = {}
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, statistics.Statistics]] = []
        self._flights: list[dict[str, Any]] = []

    def add(self, episode: RecordedEpisode) -> None:
        """Write a flight.

        Raises `DatasetError` if it has other actions or another size than those before it, or makes no video, and
        `OSError` for a full disk.
        """
        discrete = episode.options is not None
        features = layout.features_of(self._about, episode.size_px, video=self._video, discrete=discrete)
        if self._features not in ({}, features):
            raise DatasetError("all flights of a data set need the same size of frames, layers and kind of actions")
        self._features = features
        number, place = len(self._episodes), layout.place(len(self._episodes))
        sentence = sentence_of(episode.task)
        columns = self._columns(episode, self._tasks.setdefault(sentence, len(self._tasks)))
        self._write_frames(columns, self._folder / layout.DATA_PATH.format(**place))
        if self._video:
            self._write_video(episode.rgb[:-1], layout.VIDEO_PATH.format(video_key=layout.CAMERA, **place))
        self._statistics.append(_statistics_of(columns))
        self._episodes.append(self._row(number, episode.steps, sentence, place))
        self._flights.append({"task": episode.task, "options": episode.options_of_flight} | _end_of(episode))
        self._frames += episode.steps

    def close(self) -> None:
        """Write the files about all flights: tables of episodes and tasks, statistics and descriptions."""
        if not self._episodes:
            return
        import pandas

        for first in range(0, len(self._episodes), layout.FILES_PER_CHUNK):
            rows = self._episodes[first : first + layout.FILES_PER_CHUNK]
            _write_table(rows, self._folder / layout.EPISODES_PATH.format(**_episodes_place(first)))
        tasks = pandas.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks))
        tasks.to_parquet(self._folder / layout.TASKS)
        lengths = [row["length"] for row in self._episodes]
        info = layout.info_of(self._features, self._about, lengths, len(self._tasks), video=self._video)
        keys = self._statistics[0]
        found = {key: statistics.together([each[key] for each in self._statistics]) for key in keys}
        about = {"format": layout.FORMAT, "about": asdict(self._about), "flights": self._flights}
        texts = {layout.INFO: info, layout.STATS: statistics.plain(found), layout.ABOUT: about}
        for name, content in texts.items():
            (self._folder / name).write_text(json.dumps(content, indent=1), encoding="utf-8")

    def _columns(self, episode: RecordedEpisode, task: int) -> dict[str, np.ndarray]:
        """Return the values [T, ...] of each feature, the colours included if they are a video."""
        steps, number = episode.steps, len(self._episodes)
        last = np.arange(steps) == steps - 1
        layers = {name: episode.layer(name) for name in self._about.layers}
        success = self._about.reasons[episode.reason] == "Success" if episode.reason >= 0 else False
        return {
            layout.CAMERA: episode.rgb[:-1],
            **{name: layer[:-1] for name, layer in layers.items() if layer is not None},
            layout.STATE: episode.proprioception[:-1],
            "action": episode.moves,
            **({} if episode.options is None else {"option": episode.options}),
            "pose": episode.poses[:-1],
            "clock_s": episode.times_s[:-1],
            "pilot": np.array(episode.pilots, object),
            "next.reward": episode.rewards,
            "next.cost": episode.costs,
            "next.reason": episode.reasons(),
            "next.done": last,
            "next.success": last & success,
            "timestamp": np.arange(steps) / self._about.fps,
            "frame_index": np.arange(steps),
            "episode_index": np.full(steps, number),
            "index": self._frames + np.arange(steps),
            "task_index": np.full(steps, task),
        }

    def _write_frames(self, columns: dict[str, np.ndarray], path: Path) -> None:
        """Write the table of an episode, a row for each step."""
        import pyarrow
        import pyarrow.parquet

        arrays = {key: _arrow(columns[key], of) for key, of in self._features.items() if of["dtype"] != "video"}
        path.parent.mkdir(parents=True, exist_ok=True)
        pyarrow.parquet.write_table(pyarrow.table(arrays), path, compression="zstd")

    def _write_video(self, frames: np.ndarray, file: str) -> None:
        """Write frames [T, H, W, 3] to a file of the folder."""
        path = self._folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write_video(path, frames, self._about.fps, crf=CRF, key_every=KEY_EVERY, name=self._name / file)
        except VideoError as error:
            raise DatasetError(str(error)) from error

    def _row(self, number: int, steps: int, sentence: str, place: dict[str, int]) -> dict[str, Any]:
        """Return the row of an episode in the table of episodes."""
        video: dict[str, Any] = {}
        if self._video:
            key = f"videos/{layout.CAMERA}"
            times = {"from_timestamp": 0.0, "to_timestamp": steps / self._about.fps}
            video = {f"{key}/{name}": value for name, value in {**place, **times}.items()}
        found = statistics.plain(self._statistics[-1])
        return {
            "episode_index": number,
            "tasks": [sentence],
            "length": steps,
            **{f"data/{name}": value for name, value in place.items()},
            **video,
            **{f"meta/episodes/{name}": value for name, value in _episodes_place(number).items()},
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + steps,
            **{f"stats/{key}/{name}": value for key, of in found.items() for name, value in of.items()},
        }


def _episodes_place(number: int) -> dict[str, int]:
    """Return the indices of chunk and file of the table with the row of an episode."""
    return {"chunk_index": 0, "file_index": number // layout.FILES_PER_CHUNK}


def _statistics_of(columns: dict[str, np.ndarray]) -> dict[str, statistics.Statistics]:
    """Return the statistics of each feature of an episode."""
    found = {}
    for key, values in columns.items():
        if key in PICTURES:
            found[key] = statistics.of_pictures(values if values.ndim == 4 else values[..., None])
        elif key not in WITHOUT_STATISTICS:
            found[key] = statistics.of_numbers(values)
    return found


def _end_of(episode: RecordedEpisode) -> dict[str, Any]:
    """Return the state after the last step, which no row has."""
    return {
        "terminated": episode.terminated,
        "end_pose": episode.poses[-1].tolist(),
        "end_clock_s": float(episode.times_s[-1]),
        "end_state": episode.proprioception[-1].tolist(),
    }


def _write_table(rows: list[dict[str, Any]], path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), path)


def _arrow(values: np.ndarray, feature: dict[str, Any]) -> Any:
    """Return the values [T, ...] of a feature as a column of its type."""
    import pyarrow

    if feature["dtype"] == "image":
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        return pyarrow.array([{"bytes": _png(value), "path": None} for value in values], kind)
    kind = {"string": pyarrow.string(), "bool": pyarrow.bool_()}.get(feature["dtype"])
    kind = kind or getattr(pyarrow, feature["dtype"])()
    if feature["shape"] == [1]:
        return pyarrow.array(values.tolist(), kind)
    flat = pyarrow.array(np.ascontiguousarray(values, feature["dtype"]).ravel(), kind)
    for size in reversed(values.shape[1:]):
        flat = pyarrow.FixedSizeListArray.from_arrays(flat, size)
    return flat


def _png(picture: np.ndarray) -> bytes:
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG", compress_level=4)
    return content.getvalue()
