"""The record of a finding."""

from collections.abc import Mapping
from dataclasses import dataclass

from findings import STUDY

from thalweg.bench.results.inference import Estimate


@dataclass(frozen=True)
class Headline:
    """A finding."""

    name: str
    """Name of its picture's file."""
    title: str
    sentence: str
    labels: tuple[str, ...]
    """Rows of the picture."""
    series: Mapping[str, tuple[Estimate | None, ...]]
    """Values of the rows, with None where there is none, by what they are of."""
    axis: str
    """What the values are, below the picture."""
    line: float | None = None
    """A value that is marked in the picture."""
    folders: tuple[str, ...] = (STUDY.name,)
    """Folders of the results that it follows from."""
