"""Tables of measurements: rows are appended as each is made, or put in place of those of the same measurement."""

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.core.atomic_io import write_atomic

Rows = list[dict[str, str]]
Row = TypeVar("Row", bound=Mapping[str, str])


def is_begun(table: Path) -> bool:
    """Return whether a table has a heading: one that a killed process left empty is as good as none."""
    return table.is_file() and table.stat().st_size > 0


def rows_of(table: Path, columns: Sequence[str]) -> Rows:
    """Return the rows of a table that has at least these columns; none before it is begun."""
    return read_csv(table, columns) if is_begun(table) else []


def of_versions(rows: Iterable[Row], versions: Mapping[str, object]) -> list[Row]:
    """Return the rows that are of these versions, which are given by their columns."""
    return [row for row in rows if all(row[name] == str(version) for name, version in versions.items())]


def last_of_each(rows: Iterable[Row], key: Sequence[str]) -> list[Row]:
    """Return the last of the rows with the same values in the columns of a key, in the order of the first ones."""
    return list({tuple(row[name] for name in key): row for row in rows}.values())


def thinned(reports: Rows, interval: int) -> Rows:
    """Return the first report of a run after each multiple of so many steps, and the last one."""
    found: dict[int, dict[str, str]] = {}
    for row in reports:
        found.setdefault(int(row["steps"]) // interval, row)
    return list({row["steps"]: row for row in (*found.values(), reports[-1])}.values())


def append(table: Path, columns: Sequence[str], row: Mapping[str, Any]) -> None:
    """Append a row to a table, with a heading if it is not begun."""
    new = not is_begun(table)
    with open(table, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def change(table: Path, columns: Sequence[str], change_rows: Callable[[Rows], Iterable[Mapping[str, Any]]]) -> Rows:
    """Write a table anew, with what a function makes of the rows that it has now; returns them.

    Other commands may change the table meanwhile: each waits for the others, and none loses their rows.
    """
    with FileLock(table.with_name(".lock")):
        rows = [{name: str(row[name]) for name in columns} for row in change_rows(rows_of(table, columns))]
        write_atomic(table, csv_text(columns, ([row[name] for name in columns] for row in rows)))
    return rows


def put(
    table: Path,
    columns: Sequence[str],
    new: Iterable[Mapping[str, Any]],
    key: Sequence[str],
    place: Callable[[Mapping[str, str]], Any] | None = None,
) -> Rows:
    """Put rows into a table, in place of those with the same values in the columns of a key; returns all of them.

    They are behind the others, or, with `place`, sorted by it. See `change`.
    """
    added = [{name: str(row[name]) for name in columns} for row in new]
    replaced = {tuple(row[name] for name in key) for row in added}

    def changed(rows: Rows) -> Rows:
        kept = [row for row in rows if tuple(row[name] for name in key) not in replaced]
        return sorted([*kept, *added], key=place) if place else [*kept, *added]

    return change(table, columns, changed)
