"""What is a result? One row per evaluated episode; every figure of a report is computed from such rows."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from math import isfinite
from pathlib import Path

from thalweg.bench.csv_files import ResultsError, csv_text, read_csv
from thalweg.core.atomic_io import write_atomic
from thalweg.env import DoneReason

REASONS = tuple(reason.label for reason in DoneReason if reason >= 0)
"""Why an episode ended, in the order of the codes of `thalweg.env.DoneReason`."""
WORDS = dict(
    zip(
        REASONS,
        ("collision", "left the river", "too low or high", "faced backwards", "idle", "out of steps", "success"),
        strict=True,
    )
)
"""The same for people: files keep the paper's names, pages and pictures have these."""


@dataclass(frozen=True)
class Episode:
    """One flight from a given start to its end."""

    algorithm: str
    """As in the registry of algorithms, or the name of a baseline."""
    seed: int
    """Seed of the training run, and of the sampled actions."""
    level: str
    world_seed: int
    episode: int
    """Place of the start in the level's fixed list."""
    x: float
    """Start in metres, and the heading in radians."""
    y: float
    z: float
    yaw: float
    return_: float
    """Sum of the rewards; the column is called `return`."""
    cost: float
    """Sum of the costs, tight and loose."""
    tight: float
    loose: float
    length: int
    """Steps flown."""
    reason: str
    """One of `REASONS`."""
    success: bool
    progress: float
    """Share of the course's segments that were visited."""
    end_x: float = float("nan")
    """Where it ended, in metres; NaN in results from before this was kept."""
    end_y: float = float("nan")
    end_z: float = float("nan")


ENDS = ("end_x", "end_y", "end_z")
"""Columns that older results lack."""
COLUMNS = tuple(field.name.rstrip("_") for field in fields(Episode))


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Write the rows as CSV, whole or not at all."""
    rows = [[int(value) if isinstance(value, bool) else value for value in astuple(row)] for row in episodes]
    write_atomic(path, csv_text(COLUMNS, rows))


def read_episodes(path: Path) -> list[Episode]:
    """The rows of a file; raises `ResultsError` for one that is half-written or not of this kind."""
    parse = {"int": int, "float": float, "str": str, "bool": lambda text: bool(int(text))}
    episodes = []
    unknown = dict.fromkeys(ENDS, "nan")
    for number, row in enumerate(read_csv(path, [name for name in COLUMNS if name not in ENDS]), start=2):
        said = unknown | row
        try:
            values = [
                parse[getattr(field.type, "__name__", "str")](said[field.name.rstrip("_")]) for field in fields(Episode)
            ]
        except ValueError as error:
            raise ResultsError(f"{path.name} line {number}: {error}") from error
        episode = Episode(*values)
        if episode.reason not in REASONS:
            raise ResultsError(f"{path.name} line {number}: unknown reason {episode.reason!r}")
        for name, value in (("return", episode.return_), ("cost", episode.cost)):
            if not isfinite(value):
                raise ResultsError(f"{path.name} line {number}: {name} must be finite, not {value}")
        episodes.append(episode)
    return episodes
