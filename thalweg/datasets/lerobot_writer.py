"""Writer of data sets in LeRobot's format, version 3.0.

Colours are PNG or video, mask and classes PNG, and depth is numbers. The files are written by pyarrow and ffmpeg;
LeRobot, which pins another version of torch, is not needed.
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from thalweg.core.atomic_io import atomic_path
from thalweg.core.video import VideoError, VideoWriter, video_writer
from thalweg.datasets import lerobot_layout as layout
from thalweg.datasets import lerobot_statistics as statistics
from thalweg.datasets.draft import Draft
from thalweg.datasets.episode import About, sentence_of
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.lerobot_flight import LeRobotFlight, Place
from thalweg.datasets.steps import FlightWriter

CRF = 18
"""Constant rate factor of videos, low enough that losses are hardly visible."""
KEY_EVERY = 2
"""Frames between two key frames, so that single frames are read fast."""


class LeRobotWriter:
    """Writes flights to a folder that `lerobot.datasets.lerobot_dataset.LeRobotDataset(NAME, root=folder)` reads."""

    def __init__(self, draft: Draft, about: About, *, video: bool) -> None:
        """`video`: keep the colours as H.264, which is lossy; else as PNG, which is lossless."""
        self._draft, self.about, self._video = draft, about, video
        self._flights = draft.records

    @property
    def finished(self) -> int:
        """Number of flights that are written."""
        return len(self._flights)

    @contextmanager
    def flight(self, task: str, options: dict[str, Any]) -> Iterator[FlightWriter]:
        """Write the flight that is given in the block, see `DataSetWriter.flight`."""
        number, sentence = self.finished, sentence_of(task)
        table = layout.DATA_PATH.format(**layout.place(number))
        tasks = self._tasks
        with ExitStack() as files:
            draft = files.enter_context(atomic_path(self._draft.folder / table))
            video = self._open_video(number, files) if self._video else None
            first = sum(each["steps"] for each in self._flights)
            place = Place(draft, number, first, tasks.get(sentence, len(tasks)))
            writer = LeRobotFlight(place, self.about, video, self._check_features)
            files.callback(writer.close)
            yield writer
            told = writer.told()
        self._draft.note(told | {"sentence": sentence, "task": task, "options": options})

    def close(self) -> None:
        """Write the files about all flights: tables of episodes and tasks, statistics and descriptions."""
        if not self._flights:
            return
        import pandas

        folder, rows = self._draft.folder, self._rows()
        for first in range(0, len(rows), layout.FILES_PER_CHUNK):
            place = _episodes_place(first)
            _write_table(rows[first : first + layout.FILES_PER_CHUNK], folder / layout.EPISODES_PATH.format(**place))
        tasks = self._tasks
        pandas.DataFrame({"task_index": list(tasks.values())}, index=list(tasks)).to_parquet(folder / layout.TASKS)
        lengths = [each["steps"] for each in self._flights]
        info = layout.info_of(self._flights[0]["features"], self.about, lengths, len(tasks), video=self._video)
        counted = [statistics.from_plain(each["statistics"]) for each in self._flights]
        found = {key: statistics.together([each[key] for each in counted]) for key in counted[0]}
        flights = [{"task": each["task"], "options": each["options"]} | each["end"] for each in self._flights]
        about = {"format": layout.FORMAT, "about": asdict(self.about), "flights": flights}
        texts = {layout.INFO: info, layout.STATS: statistics.plain(found), layout.ABOUT: about}
        for name, content in texts.items():
            (folder / name).write_text(json.dumps(content, indent=1), encoding="utf-8")

    @property
    def _tasks(self) -> dict[str, int]:
        """Index of each task by its sentence."""
        return {text: number for number, text in enumerate(dict.fromkeys(each["sentence"] for each in self._flights))}

    def _check_features(self, features: dict[str, Any]) -> None:
        """Raise `DatasetError` unless a flight has the features of those before it."""
        if self._flights and self._flights[0]["features"] != features:
            raise DatasetError("all flights of a data set need the same size of frames, layers and kind of actions")

    def _open_video(self, number: int, files: ExitStack) -> VideoWriter:
        """Return the writer of the colours of a flight."""
        file = layout.VIDEO_PATH.format(video_key=layout.CAMERA, **layout.place(number))
        draft = files.enter_context(atomic_path(self._draft.folder / file))
        files.enter_context(_video_errors())
        writer = video_writer(draft, self.about.fps, crf=CRF, key_every=KEY_EVERY, name=self._draft.name / file)
        return files.enter_context(writer)

    def _rows(self) -> list[dict[str, Any]]:
        """Return the row of each episode in the table of episodes."""
        rows, first = [], 0
        for number, flight in enumerate(self._flights):
            rows.append(self._row(number, flight, first))
            first += flight["steps"]
        return rows

    def _row(self, number: int, flight: dict[str, Any], first: int) -> dict[str, Any]:
        """Return the row of an episode, whose first step has the index `first` among those of all."""
        place, steps = layout.place(number), flight["steps"]
        video: dict[str, Any] = {}
        if self._video:
            key = f"videos/{layout.CAMERA}"
            times = {"from_timestamp": 0.0, "to_timestamp": steps / self.about.fps}
            video = {f"{key}/{name}": value for name, value in {**place, **times}.items()}
        found = flight["statistics"]
        return {
            "episode_index": number,
            "tasks": [flight["sentence"]],
            "length": steps,
            **{f"data/{name}": value for name, value in place.items()},
            **video,
            **{f"meta/episodes/{name}": value for name, value in _episodes_place(number).items()},
            "dataset_from_index": first,
            "dataset_to_index": first + steps,
            **{f"stats/{key}/{name}": value for key, of in found.items() for name, value in of.items()},
        }


@contextmanager
def _video_errors() -> Iterator[None]:
    """Raise errors of a video as `DatasetError`."""
    try:
        yield
    except VideoError as error:
        raise DatasetError(str(error)) from error


def _episodes_place(number: int) -> dict[str, int]:
    """Return the indices of chunk and file of the table with the row of an episode."""
    return {"chunk_index": 0, "file_index": number // layout.FILES_PER_CHUNK}


def _write_table(rows: list[dict[str, Any]], path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), path)
