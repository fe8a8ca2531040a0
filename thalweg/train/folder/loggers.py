"""Logs of a run: metrics.csv, episodes.csv and TensorBoard events.

They are only written; learning never depends on them.
"""

import csv
import io
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from thalweg.core.atomic_io import disk_errors_name
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.episodes import COLUMNS, Episode


class CsvTable:
    """A CSV file to which rows are appended, and which can be truncated to its length at a checkpoint."""

    def __init__(self, path: Path, keep_bytes: int = 0, columns: Sequence[str] | None = None) -> None:
        """Open the file and truncate it to `keep_bytes`; raises `TrainingError` if it is shorter.

        Without `columns`, the keys of the first row are the columns.
        """
        self._path = path
        self._file = open(path, "r+b" if path.exists() else "w+b")  # noqa: SIM115 (open as long as the table)
        size = self._file.seek(0, os.SEEK_END)
        if size < keep_bytes:
            self._file.close()
            raise TrainingError(f"{path} has {size} bytes, but had {keep_bytes} when its checkpoint was written")
        self._file.truncate(keep_bytes)
        self._file.seek(keep_bytes)
        self._columns: list[str] | None = None
        if keep_bytes:
            self._file.seek(0)
            self._columns = self._read_header()
            self._file.seek(keep_bytes)
        elif columns is not None:
            self._write_header(columns)

    def _read_header(self) -> list[str]:
        """Return the columns of the first line."""
        try:
            return next(csv.reader([self._file.readline().decode().strip()]), [])
        except UnicodeDecodeError as error:
            self._file.close()
            raise TrainingError(f"{self._path} is damaged: its first line is not text") from error

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row; numbers are written in full precision."""
        columns = self._columns or self._write_header(list(row))
        self._write_line([_cell(row.get(column, "")) for column in columns])

    def sync(self) -> int:
        """Write everything to disk; returns the length of the file in bytes."""
        with disk_errors_name(self._path):
            self._file.flush()
            os.fsync(self._file.fileno())
        return self._file.tell()

    def flush(self) -> None:
        """Flush, so that other programs see the rows."""
        with disk_errors_name(self._path):
            self._file.flush()

    def close(self) -> None:
        with disk_errors_name(self._path):
            self._file.close()

    def _write_header(self, columns: Sequence[str]) -> Sequence[str]:
        self._columns = list(columns)
        self._write_line(self._columns)
        return columns

    def _write_line(self, cells: Iterable[str]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        with disk_errors_name(self._path):
            self._file.write(text.getvalue().encode())


class RunLog:
    """metrics.csv, episodes.csv and TensorBoard events of one run."""

    def __init__(self, folder: Path, kept_bytes: Mapping[str, int] | None = None, step: int = -1) -> None:
        """Create the logs, or truncate them to a checkpoint: `kept_bytes` of each table, events up to `step`."""
        from torch.utils.tensorboard import SummaryWriter  # slow to import

        kept_bytes = kept_bytes or {}
        self.metrics = CsvTable(folder / "metrics.csv", kept_bytes.get("metrics", 0))
        self.episodes = CsvTable(folder / "episodes.csv", kept_bytes.get("episodes", 0), COLUMNS)
        self._events = folder / "tensorboard"
        with disk_errors_name(self._events):
            self._board = SummaryWriter(str(self._events), purge_step=step + 1)

    def episode(self, episode: Episode) -> None:
        """Append an episode to episodes.csv."""
        values = (getattr(episode, name) for name in Episode.__dataclass_fields__)
        self.episodes.write(dict(zip(COLUMNS, values, strict=True)))

    def update(self, step: int, row: Mapping[str, float]) -> None:
        """Append a row to metrics.csv, and its numbers to TensorBoard."""
        self.metrics.write(row)
        with disk_errors_name(self._events):
            for name, value in row.items():
                if name != "steps" and math.isfinite(value):
                    self._board.add_scalar(name, value, step)
        self.metrics.flush()
        self.episodes.flush()

    def sync(self) -> dict[str, int]:
        """Write everything to disk; returns the bytes of each table, for a checkpoint."""
        with disk_errors_name(self._events):
            self._board.flush()
        return {"metrics": self.metrics.sync(), "episodes": self.episodes.sync()}

    def close(self) -> None:
        """Close all three, also if one of them cannot be written any more."""
        with ExitStack() as stack:
            stack.enter_context(disk_errors_name(self._events))
            stack.callback(self._board.close)
            stack.callback(self.episodes.close)
            stack.callback(self.metrics.close)


def _cell(value: Any) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
