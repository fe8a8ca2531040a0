"""Records of evaluated episodes and their CSV files; every figure of a report is computed from them."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.bench.csv_files import ResultsError, csv_text, finite, read_csv
from thalweg.core.atomic_io import write_atomic
from thalweg.env import DoneReason, RiverVectorEnv
from thalweg.env.task.progress_share import progress_of

ALL_REASONS = tuple(reason.label for reason in DoneReason if reason >= 0)
"""Reasons for the end of an episode, in the order of the codes of `thalweg.env.DoneReason`."""
FIRST_COST = DoneReason.COST_INCURRED.label
"""Reason of episodes that the first cost of a task ended, see `EnvConfig.hard`."""
REASONS = tuple(reason for reason in ALL_REASONS if reason != FIRST_COST)
"""Those of the paper, which the tables and figures of reports count; `FIRST_COST` too in results of the hard mode."""
REASON_TEXT = dict(
    zip(
        ALL_REASONS,
        (
            *("collision", "left the river", "too low or high", "faced backwards", "idle", "out of steps", "success"),
            "incurred a cost",
        ),
        strict=True,
    )
)
"""Plain words for each reason, shown on pages and pictures; files have the paper's names."""


@dataclass(frozen=True)
class Episode:
    """One episode from a given start to its end."""

    algorithm: str
    """Name of the algorithm in the registry, or of a baseline."""
    seed: int
    """Seed of the training run, and of action sampling."""
    level: str
    world_seed: int
    episode: int
    """Index of the start in the level's fixed list."""
    x: float
    """Start position in metres, and the heading in radians."""
    y: float
    z: float
    yaw: float
    return_: float
    """Sum of the rewards; the column is called `return`."""
    cost: float
    """Sum of the costs of all kinds."""
    tight: float
    loose: float
    length: int
    """Number of steps."""
    reason: str
    """One of `ALL_REASONS`."""
    success: bool
    progress: float
    """As `info["progress"]` at its end."""
    end_x: float = float("nan")
    """End position in metres; NaN in results from before it was recorded."""
    end_y: float = float("nan")
    end_z: float = float("nan")
    shield: int = 0
    """Version of the shield that the flight had; 0 for none."""
    vetoes: int = 0
    """Number of moves that the shield replaced."""
    ahead: float | None = None
    """Share flown of what lay ahead of the start on an open course: of the segments, in `Portage` of the way to the
    station; None on a loop."""
    version: int = 0
    """Version of the plug-in that trained the policy, or of a function that flies; 0 for one of the package."""
    source: str = ""
    """Hash of the source of that plug-in or function."""


END_COLUMNS = ("end_x", "end_y", "end_z")
"""Columns of the end position, which older results lack."""
SHIELD_COLUMNS = ("shield", "vetoes")
"""Columns that only files with shielded flights have."""
OPEN_COLUMNS = ("ahead",)
"""Columns that only files with flights along open courses have."""
PLUGIN_COLUMNS = ("version", "source")
"""Columns that only files with flights of policies from outside the package have."""
COLUMNS = tuple(
    field.name.rstrip("_")
    for field in fields(Episode)
    if field.name not in (*SHIELD_COLUMNS, *OPEN_COLUMNS, *PLUGIN_COLUMNS)
)


def share_ahead(env: RiverVectorEnv) -> np.ndarray:
    """Return [N] the share of the course that lies ahead of the episodes that an environment has just begun: of the
    segments, in `Portage` of the way to the station; NaN on a loop."""
    courses, state = env.courses, env.state
    if env.config.task_record.portage:
        ahead = np.maximum(1.0 - progress_of(env.config, courses, state), np.finfo(float).tiny)  # may begin at it
    else:
        segments = courses.segments[state.world]
        ahead = np.where(state.travel > 0, segments - state.segment, state.segment + 1) / segments
    return np.where(courses.closed[state.world] != 0, np.nan, ahead)


def flown_of_ahead(progress: float, ahead: float, *, portage: bool) -> float | None:
    """Return the share flown of what lay ahead of a start, an `Episode.ahead`, from the progress at the end and the
    share ahead at the start (`share_ahead`); None on a loop.

    In `Portage` (`portage`) the progress at the start is what does not lie ahead; in other tasks it is 0.
    """
    begun = 1.0 - ahead if portage else 0.0
    share = (progress - begun) / ahead
    return None if np.isnan(share) else float(np.clip(share, 0.0, 1.0))


def write_episodes(path: Path, episodes: Sequence[Episode]) -> None:
    """Write the rows as CSV, atomically."""
    columns = COLUMNS + (SHIELD_COLUMNS if any(row.shield for row in episodes) else ())
    columns += OPEN_COLUMNS if any(row.ahead is not None for row in episodes) else ()
    columns += PLUGIN_COLUMNS if any(row.source for row in episodes) else ()
    attributes = ["return_" if name == "return" else name for name in columns]
    values = [[getattr(row, name) for name in attributes] for row in episodes]
    rows = [[int(value) if isinstance(value, bool) else value for value in row] for row in values]
    write_atomic(path, csv_text(columns, rows))


def read_episodes(path: Path) -> list[Episode]:
    """Return the rows of a file; raises `ResultsError` for a file that is half-written or of another kind."""
    parse = {"int": int, "float": finite, "str": str, "bool": _flag, "end": float}
    parse["share"] = lambda text: finite(text) if text else None
    kinds = {field.name: getattr(field.type, "__name__", "str") for field in fields(Episode)}
    kinds |= dict.fromkeys(END_COLUMNS, "end") | dict.fromkeys(OPEN_COLUMNS, "share")
    episodes = []
    defaults = dict.fromkeys(END_COLUMNS, "nan") | dict.fromkeys(OPEN_COLUMNS, "") | dict.fromkeys(SHIELD_COLUMNS, "0")
    defaults |= {"version": "0", "source": ""}
    for number, row in enumerate(read_csv(path, [name for name in COLUMNS if name not in END_COLUMNS]), start=2):
        texts, values, column = defaults | row, dict[str, Any](), ""
        try:
            for name, kind in kinds.items():
                column = name.rstrip("_")
                values[name] = parse[kind](texts[column])
        except ValueError as error:
            raise ResultsError(f"{path.name} line {number}: {column}: {error}") from error
        episode = Episode(**values)
        if episode.reason not in ALL_REASONS:
            raise ResultsError(f"{path.name} line {number}: unknown reason {episode.reason!r}")
        episodes.append(episode)
    return episodes


def _flag(text: str) -> bool:
    """Return whether a value is 1; raises `ValueError` for anything but 0 and 1."""
    if text not in ("0", "1"):
        raise ValueError(f"0 or 1 is needed, got {text[:40]!r}")
    return text == "1"
