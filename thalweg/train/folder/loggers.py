"""Where do a run's numbers go? Into files that people and other programs read.

Nothing here is ever read back to learn from.
"""

import csv
import io
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.episodes import COLUMNS, Episode


class Table:
    """A CSV file that grows by rows and can be cut back to where a checkpoint left it."""

    def __init__(self, path: Path, keep_bytes: int = 0, columns: Sequence[str] | None = None) -> None:
        """Opens the file, keeping its first `keep_bytes`; raises `TrainingError` if it has fewer.

        Without `columns` the first row names them.
        """
        self._file = open(path, "r+b" if path.exists() else "w+b")  # noqa: SIM115 (open as long as the table)
        size = self._file.seek(0, os.SEEK_END)
        if size < keep_bytes:
            self._file.close()
            raise TrainingError(f"{path} has {size} bytes, but its checkpoint was made after {keep_bytes}")
        self._file.truncate(keep_bytes)
        self._file.seek(keep_bytes)
        self._columns: list[str] | None = None
        if keep_bytes:
            self._file.seek(0)
            self._columns = self._file.readline().decode().strip().split(",")
            self._file.seek(keep_bytes)
        elif columns is not None:
            self._name(columns)

    def write(self, row: Mapping[str, Any]) -> None:
        """Append a row; numbers are written so that they read back to the same bits."""
        columns = self._columns or self._name(list(row))
        self._line([_cell(row.get(column, "")) for column in columns])

    def sync(self) -> int:
        """The file's length in bytes, once everything is safely on disk."""
        self._file.flush()
        os.fsync(self._file.fileno())
        return self._file.tell()

    def flush(self) -> None:
        """Let others see what has been written."""
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def _name(self, columns: Sequence[str]) -> Sequence[str]:
        self._columns = list(columns)
        self._line(self._columns)
        return columns

    def _line(self, cells: Iterable[str]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        self._file.write(text.getvalue().encode())


class RunLog:
    """metrics.csv, episodes.csv and TensorBoard of one run."""

    def __init__(self, folder: Path, kept: Mapping[str, int] | None = None, step: int = -1) -> None:
        """Anew, or cut back to a checkpoint: bytes `kept` of each table, and TensorBoard's events up to `step`."""
        from torch.utils.tensorboard import SummaryWriter  # slow to import: only when a run begins

        kept = kept or {}
        self.metrics = Table(folder / "metrics.csv", kept.get("metrics", 0))
        self.episodes = Table(folder / "episodes.csv", kept.get("episodes", 0), COLUMNS)
        self._board = SummaryWriter(str(folder / "tensorboard"), purge_step=step + 1)

    def episode(self, episode: Episode) -> None:
        """A row of episodes.csv."""
        values = (getattr(episode, name) for name in Episode.__dataclass_fields__)
        self.episodes.write(dict(zip(COLUMNS, values, strict=True)))

    def update(self, step: int, row: Mapping[str, float]) -> None:
        """A row of metrics.csv, and the same on TensorBoard."""
        self.metrics.write(row)
        for name, value in row.items():
            if name != "steps" and math.isfinite(value):
                self._board.add_scalar(name, value, step)
        self.metrics.flush()
        self.episodes.flush()

    def sync(self) -> dict[str, int]:
        """Bytes of each table, for a checkpoint."""
        self._board.flush()
        return {"metrics": self.metrics.sync(), "episodes": self.episodes.sync()}

    def close(self) -> None:
        self.metrics.close()
        self.episodes.close()
        self._board.close()


def _cell(value: Any) -> str:
    return repr(float(value)) if isinstance(value, float) else str(value)
