"""Tables with a row for each finished piece of work; a piece that has a row is skipped.

A clock says when no other piece may begin, for machines that are there for some hours only.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # tables are written as those of other benchmarks

from tables import Rows, change, rows_of


class Pieces:
    """A table of finished pieces, written anew after each of them."""

    def __init__(self, path: Path, key: Sequence[str]) -> None:
        """`key` are the columns that identify a piece."""
        self.path, self.key = path, tuple(key)
        self.rows = rows_of(path, self.key)

    def row(self, *identity: object) -> dict[str, str] | None:
        """Return the row of a piece; None if it is not finished."""
        wanted = tuple(map(str, identity))
        return next((row for row in self.rows if self._identity(row) == wanted), None)

    def add(self, row: Mapping[str, object]) -> None:
        """Add the row of a piece, in place of an earlier one of the same piece, and write the table."""
        self.replace(tuple(str(row[name]) for name in self.key), [row])

    def replace(self, identity: tuple[str, ...], new: Sequence[Mapping[str, object]]) -> None:
        """Put rows in place of all that a piece has, and write the table; other commands may add theirs meanwhile."""
        if not new and not self.rows:
            return
        columns = list([*new, *self.rows][0])

        def changed(rows: Rows) -> list[Mapping[str, object]]:
            return [*(row for row in rows if self._identity(row) != identity), *new]

        self.rows = change(self.path, columns, changed)

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
