"""Tables with a row for each finished piece of work; a piece that has a row is skipped.

A clock says when no other piece may begin, for machines that are there for some hours only.
"""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from filelock import FileLock

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.core.atomic_io import write_atomic


class Pieces:
    """A table of finished pieces, written anew after each of them."""

    def __init__(self, path: Path, key: Sequence[str]) -> None:
        """`key` are the columns that identify a piece."""
        self.path, self.key = path, tuple(key)
        self.rows: list[dict[str, str]] = read_csv(path, self.key) if path.is_file() else []

    def row(self, *identity: object) -> dict[str, str] | None:
        """Return the row of a piece; None if it is not finished."""
        wanted = tuple(map(str, identity))
        return next((row for row in self.rows if self._identity(row) == wanted), None)

    def add(self, row: Mapping[str, object]) -> None:
        """Add the row of a piece, in place of an earlier one of the same piece, and write the table atomically; other
        commands may add theirs meanwhile."""
        text = {name: str(value) for name, value in row.items()}
        with FileLock(self.path.with_name(".lock")):
            rows = read_csv(self.path, self.key) if self.path.is_file() else []
            self.rows = [each for each in rows if self._identity(each) != self._identity(text)] + [text]
            write_atomic(self.path, csv_text(list(text), [list(each.values()) for each in self.rows]))

    def _identity(self, row: Mapping[str, str]) -> tuple[str, ...]:
        return tuple(row[name] for name in self.key)


class Clock:
    """The time since the start of a script."""

    def __init__(self, minutes: float | None) -> None:
        """`minutes` may pass before it is over; None: it never is."""
        self.until = None if minutes is None else time.monotonic() + 60 * minutes

    @property
    def is_over(self) -> bool:
        """Whether the time is over."""
        return self.until is not None and time.monotonic() >= self.until
