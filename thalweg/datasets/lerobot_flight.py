"""Writer of one flight in LeRobot's format: a table of rows and a video, written as the steps come.

A row is what was seen before a step, the step, and its reward, costs and reason; images after the last step are not
kept. Letters: T steps, B rows of a block.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from thalweg.core.video import VideoWriter
from thalweg.datasets import lerobot_layout as layout
from thalweg.datasets import lerobot_statistics as statistics
from thalweg.datasets.episode import LAYERS, RUNNING, About
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.steps import Sight, Step, check_layers

BLOCK = 32
"""Number of rows that are written together, which are in memory until then."""
PICTURES = (layout.CAMERA, "mask", "class")
WITHOUT_STATISTICS = ("depth", "pilot")
"""Features without statistics: one has a number for each pixel, the other is text."""
SUCCESS = "Success"
"""Reason for the end of a flight that reached its goal."""


@dataclass(frozen=True)
class Place:
    """Where a flight stands in its data set."""

    table: Path
    """File of the rows to write."""
    number: int
    """Index of the flight."""
    first: int
    """Index of its first row among those of all flights."""
    task: int
    """Index of its task."""


class LeRobotFlight:
    """Writes a flight; it holds the images of at most `BLOCK` steps, and the numbers of all."""

    def __init__(self, place: Place, about: About, video: VideoWriter | None, check: Callable[[dict], None]) -> None:
        """`video`: takes the colours, None to keep them in the table; `check`: is given the features at the first step,
        and raises `DatasetError` if the flights before have others."""
        self._place, self._about, self._video, self._check = place, about, video, check
        self._seen: Sight | None = None
        self._rows: list[tuple[Sight, Step]] = []
        self._features: dict[str, dict[str, Any]] = {}
        self._table: Any = None
        self._pictures: dict[str, statistics.PictureCounts] = {}
        self._numbers: dict[str, list[np.ndarray]] = {}
        self._written = 0
        self._end: dict[str, Any] | None = None
        self._reason = RUNNING

    def see(self, sight: Sight) -> None:
        self._seen = sight

    def step(self, step: Step, after: Sight) -> None:
        assert self._seen is not None
        if not self._features:
            check_layers(self._seen, self._about)
            discrete = step.option is not None
            features = layout.features_of(
                self._about, self._seen.size_px, video=self._video is not None, discrete=discrete
            )
            self._check(features)
            self._features = features
        check_layers(after, self._about)
        if len(self._rows) == BLOCK:
            self._write_rows(RUNNING, last=False)
        self._rows.append((self._seen, step))
        self._seen = after

    def end(self, terminated: bool, reason: int) -> None:
        assert self._seen is not None
        if not self._rows:
            raise DatasetError("a flight without a step cannot be recorded")
        self._write_rows(reason, last=True)
        self._reason = reason
        self._end = {
            "terminated": terminated,
            "end_pose": self._seen.pose.tolist(),
            "end_clock_s": float(self._seen.time_s),
            "end_state": self._seen.proprioception.tolist(),
        }

    def close(self) -> None:
        """Close the table; the video is closed by its owner."""
        if self._table is not None:
            self._table.close()

    def told(self) -> dict[str, Any]:
        """Return the description of the flight as plain data: features, statistics and its end; raises `DatasetError`
        for a flight without an end."""
        if self._end is None:
            raise DatasetError("a flight was not recorded to its end")
        counted = {key: counts.statistics() for key, counts in self._pictures.items()}
        counted |= {key: statistics.of_numbers(np.concatenate(parts)) for key, parts in self._numbers.items()}
        ordered = {key: counted[key] for key in self._features if key in counted}
        return {
            "steps": self._written,
            "reason": self._reason,
            "features": self._features,
            "statistics": statistics.plain(ordered),
            "end": self._end,
        }

    def _write_rows(self, reason: int, *, last: bool) -> None:
        """Write the rows in memory; of the `last` ones, the very last has the reason for the flight's end."""
        import pyarrow
        import pyarrow.parquet

        columns = self._columns(reason, last)
        for key, values in columns.items():
            if key in PICTURES:
                pictures = values if values.ndim == 4 else values[..., None]
                self._pictures.setdefault(key, statistics.PictureCounts(pictures.shape[-1])).add(pictures)
            elif key not in WITHOUT_STATISTICS:
                self._numbers.setdefault(key, []).append(values)
        arrays = {key: _arrow(columns[key], of) for key, of in self._features.items() if of["dtype"] != "video"}
        table = pyarrow.table(arrays)
        if self._table is None:
            self._table = pyarrow.parquet.ParquetWriter(
                self._place.table, table.schema, compression="zstd", use_dictionary=False
            )
        self._table.write_table(table)
        if self._video is not None:
            for frame in columns[layout.CAMERA]:
                self._video.send(frame)
        self._written += len(self._rows)
        self._rows = []

    def _columns(self, reason: int, last: bool) -> dict[str, np.ndarray]:
        """Return the values [B, ...] of each feature, the colours included if they are a video."""
        sights, steps = zip(*self._rows, strict=True)
        place, index = self._place, self._written + np.arange(len(steps))
        ends = last & (np.arange(len(steps)) == len(steps) - 1)
        success = reason >= 0 and self._about.reasons[reason] == SUCCESS
        layers = [name for name in LAYERS if name in self._about.layers]
        images = {name: np.stack([each.images[name] for each in sights]) for name in ("rgb", *layers)}
        options = {} if steps[0].option is None else {"option": np.stack([each.option for each in steps])}
        return {
            layout.CAMERA: images.pop("rgb"),
            **images,
            layout.STATE: np.stack([each.proprioception for each in sights]),
            "action": np.stack([each.move for each in steps]),
            **options,
            "pose": np.stack([each.pose for each in sights]),
            "clock_s": np.array([each.time_s for each in sights]),
            "pilot": np.array([each.pilot for each in steps], object),
            "next.reward": np.array([each.reward for each in steps]),
            "next.cost": np.stack([each.costs for each in steps]),
            "next.reason": np.where(ends, reason, RUNNING),
            "next.done": ends,
            "next.success": ends & success,
            "timestamp": index / self._about.fps,
            "frame_index": index,
            "episode_index": np.full(len(steps), place.number),
            "index": place.first + index,
            "task_index": np.full(len(steps), place.task),
        }


def _arrow(values: np.ndarray, feature: dict[str, Any]) -> Any:
    """Return the values [B, ...] of a feature as a column of its type."""
    import pyarrow

    if feature["dtype"] == "image":
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        return pyarrow.array([{"bytes": _png(value), "path": None} for value in values], kind)
    kind = {"string": pyarrow.string(), "bool": pyarrow.bool_()}.get(feature["dtype"])
    kind = kind or getattr(pyarrow, feature["dtype"])()
    if feature["shape"] == [1]:
        return pyarrow.array(values.ravel().tolist(), kind)  # [B], or [B, 1]
    flat = pyarrow.array(np.ascontiguousarray(values, feature["dtype"]).ravel(), kind)
    for size in reversed(values.shape[1:]):
        flat = pyarrow.FixedSizeListArray.from_arrays(flat, size)
    return flat


def _png(picture: np.ndarray) -> bytes:
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "PNG", compress_level=4)
    return content.getvalue()
