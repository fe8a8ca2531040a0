"""The curve of a training run, `curve.csv`: its episodes in blocks of `MEAN_EPISODES`, one row for each.

It is what results can keep of a run in little space: flights of tasks are short, so that the episodes of one run take
megabytes. Running means, rates of violations and the regret of training are computed from it as from the episodes
themselves, at the ends of blocks.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from thalweg.bench.csv_files import ResultsError, csv_text, finite, read_csv
from thalweg.bench.results.results import RunRow
from thalweg.bench.results.statistics import VIOLATIONS, TrainingLog, in_blocks
from thalweg.core.atomic_io import write_atomic

EPISODES, CURVE = "episodes.csv", "curve.csv"
"""Files of a run's folder: its finished episodes, one by one and in blocks."""
MEANS = ("return", "cost", "tight", "loose")
"""Columns of means over a row's episodes, which is one in `EPISODES`."""
COLUMNS = ("step", "episodes", *MEANS, *VIOLATIONS)
"""Columns of `CURVE`."""
MOST_STEPS = 1e15
"""Largest step of a training curve, and most episodes of a row; whole numbers up to it are exact."""


def training_file(folder: Path) -> Path:
    """Return the file of a run's folder that has its training: its episodes, or its curve where they are not kept."""
    return folder / CURVE if not (folder / EPISODES).exists() and (folder / CURVE).exists() else folder / EPISODES


def read_training(path: Path, row: RunRow, earlier_steps: int = 0) -> TrainingLog:
    """Return the training of a run from its `EPISODES` or its `CURVE`; of several stages, that of the last one.

    `earlier_steps`: steps of the stages before, which the row counts too. Raises `ResultsError` or `OSError`.
    """
    is_curve = path.name == CURVE
    columns = COLUMNS if is_curve else ("step", "return", "tight", "loose")
    lines = read_csv(path, columns)
    if lines and "cost" in lines[0]:
        columns = tuple(dict.fromkeys([*columns, "cost"]))
    values = _numbers(path, lines, columns)
    step = _whole(path, "step", values["step"])
    order = np.argsort(step, kind="stable")
    last = max(row.steps - earlier_steps, int(step.max(initial=0)))
    return_, tight, loose = (values[name][order] for name in ("return", "tight", "loose"))
    total = values["cost"][order] if "cost" in values else None
    episodes, violations = _blocks(path, values, order) if is_curve else (None, None)
    return TrainingLog(row.algorithm, row.seed, step[order], return_, tight, loose, last, total, episodes, violations)


def _numbers(path: Path, lines: Sequence[Mapping[str, str]], columns: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the values of each column, [K] float64; raises `ResultsError` for one that is not a finite number."""
    try:
        return {name: np.array([finite(line[name]) for line in lines], dtype=float) for name in columns}
    except ValueError as error:
        raise ResultsError(f"{path.name}: {error}") from error


def _blocks(path: Path, values: Mapping[str, np.ndarray], order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of episodes [K] and of violations [K, 3] of a curve's rows; raises `ResultsError` for numbers
    that no block can have."""
    episodes = _whole(path, "episodes", values["episodes"], least=1)
    violations = np.stack([_whole(path, name, values[name]) for name in VIOLATIONS], axis=1)
    if (bad := np.flatnonzero((violations > episodes[:, None]).any(axis=1))).size:
        raise ResultsError(f"{path.name} line {bad[0] + 2} has more violations than episodes")
    return episodes[order], violations[order]


def _whole(path: Path, name: str, values: np.ndarray, least: int = 0) -> np.ndarray:
    """Return values [K] as int64; raises `ResultsError` for one that is no whole number from `least` on."""
    if (bad := values[~((values >= least) & (values <= MOST_STEPS)) | (values % 1 != 0)]).size:
        raise ResultsError(f"{path.name}: {name} must be a whole number from {least} to {MOST_STEPS:g}, got {bad[0]:g}")
    return values.astype(np.int64)


def write_curve(folder: Path, row: RunRow) -> None:
    """Write the curve of a run's folder from its episodes, unless it is there or there are none.

    Raises `ResultsError` for episodes that cannot be used.
    """
    if (folder / CURVE).exists() or not (folder / EPISODES).exists():
        return
    log = in_blocks(read_training(folder / EPISODES, row))
    columns = (log.return_, log.cost, log.tight, log.loose)
    rows = zip(log.step, log.episodes_of_rows, *columns, *log.violations_of_rows.T, strict=True)
    write_atomic(folder / CURVE, csv_text(COLUMNS, ([value.item() for value in each] for each in rows)))
