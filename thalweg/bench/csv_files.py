"""Reading and writing of the CSV files of results, and the error for files that cannot be used."""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path


class ResultsError(ValueError):
    """A results folder or a file in it cannot be used; the message says which and why."""


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the rows as CSV with a header; floats are written so that they read back to the same bits."""
    lines: list[str] = []

    class Lines:
        def write(self, line: str) -> int:
            lines.append(line)
            return len(line)

    writer = csv.writer(Lines(), lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return "".join(lines)


def read_csv(path: Path, columns: Sequence[str]) -> list[dict[str, str]]:
    """Return the rows of a CSV file that has at least these columns.

    Raises `ResultsError` for a file that is not CSV in UTF-8, lacks a column, has one twice or ends in the middle of a
    row.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ResultsError(f"{path.name} is not text") from error
    if not text:
        raise ResultsError(f"{path.name} is empty")
    reader = csv.DictReader(io.StringIO(text, newline=""))  # values in quotes may hold line breaks
    try:
        header, rows = list(reader.fieldnames or ()), list(reader)
    except csv.Error as error:
        raise ResultsError(f"{path.name} is not CSV: {error}") from error
    missing = [column for column in columns if column not in header]
    if missing:
        raise ResultsError(f"{path.name} lacks the column{'s' * (len(missing) > 1)} {', '.join(missing)}")
    if not text.endswith("\n"):
        raise ResultsError(f"{path.name} is half-written: its last line does not end")
    if twice := [column for column in columns if header.count(column) > 1]:
        raise ResultsError(f"{path.name} has the column {twice[0]} twice")
    for number, row in enumerate(rows, start=2):
        if None in row or None in row.values():
            raise ResultsError(f"{path.name} line {number} has not as many values as the header")
    return rows


def finite(text: str) -> float:
    """Return the number that a value stands for; raises `ValueError` for one that is not finite, such as nan."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"a finite number is needed, got {text[:40]!r}")
    return number
