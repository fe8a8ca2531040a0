"""Tables of measurements, to which a row is appended as each is made."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def is_begun(table: Path) -> bool:
    """Return whether a table has a heading: one that a killed process left empty is as good as none."""
    return table.is_file() and table.stat().st_size > 0


def append(table: Path, columns: Sequence[str], row: Mapping[str, Any]) -> None:
    """Append a row to a table, with a heading if it is not begun."""
    new = not is_begun(table)
    with open(table, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)
