"""A table before it is text: read by people at two places, by programs at full precision."""

from dataclasses import dataclass

from thalweg.bench.csv_files import csv_text
from thalweg.bench.report.tables import Grid, with_ends
from thalweg.bench.results.inference import Estimate

Cell = str | float | Estimate


@dataclass(frozen=True)
class Sheet:
    """Cells are words, numbers or estimates."""

    header: tuple[str, ...]
    rows: list[list[Cell]]

    @property
    def grid(self) -> Grid:
        """As people read it."""
        return list(self.header), [[_words(cell) for cell in row] for row in self.rows]

    @property
    def csv(self) -> str:
        """At full precision; what is an estimate anywhere has three columns, its ends empty where there are none."""
        columns = zip(*self.rows, strict=True) if self.rows else [()] * len(self.header)
        estimated = [any(isinstance(cell, Estimate) for cell in column) for column in columns]
        names = [
            name if not three else f"{name}{end}"
            for name, three in zip(self.header, estimated, strict=True)
            for end in (("", ", low", ", high") if three else ("",))
        ]
        rows = [
            [number for cell, three in zip(row, estimated, strict=True) for number in _numbers(cell, three)]
            for row in self.rows
        ]
        return csv_text(names, rows)


class Share(Estimate):
    """An estimate that people read in percent."""

    def __str__(self) -> str:
        return self.as_percent()


def _words(cell: Cell) -> str:
    return f"{cell:.2f}" if isinstance(cell, float) else str(cell)


def _numbers(cell: Cell, three: bool) -> list[object]:
    if isinstance(cell, Estimate):
        return with_ends(cell)
    return [cell, "", ""] if three else [cell]


def as_share(found: Estimate) -> Share:
    """The same estimate, to be read in percent."""
    return Share(found.value, found.low, found.high)
