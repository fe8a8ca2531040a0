"""Verification of recorded results: runs are made again in another folder, and compared with the recorded ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import COLUMNS, END_COLUMNS
from thalweg.bench.execute.backend import Backend, RiverBackend
from thalweg.bench.execute.executors import ExecutionContext, Executor, SerialExecutor
from thalweg.bench.execute.runner import RESULTS_FOLDER, claimed, comparable, execute_runs, selected_runs, versions_of
from thalweg.bench.results.curve import training_file
from thalweg.bench.results.reproduction import Part, Table, compare_means, compare_to_the_bit, other_conditions
from thalweg.bench.results.results import evaluation_path, read_runs
from thalweg.bench.results.run_versions import read_versions, version_label
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import read_suite
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import read_config

CURVE = "curve"
CURVE_COLUMNS = ("step", "return", "cost")


@dataclass(frozen=True)
class Verification:
    """The outcome of a run that was made again."""

    run: str
    conditions: tuple[str, ...]
    """Why the last bits may differ; empty for a run that must be the same to the bit."""
    parts: tuple[Part, ...]

    @property
    def reproduced(self) -> bool:
        """Whether curve and flights agree."""
        return not any(part.differences for part in self.parts)


def verify(
    suite: Suite,
    recorded: Path,
    repeated: Path,
    only: tuple[str, ...],
    backend: Backend | None = None,
    console: Console | None = None,
    *,
    executor: Executor | None = None,
) -> list[Verification]:
    """Make runs of a suite again in the folder `repeated`, or resume that, and compare them with a `recorded` folder.

    `only` names policies or runs, see `thalweg.bench.execute.runner.selected_runs`. Nothing is written to the recorded
    folder, and neither films nor a report to the other.

    Raises `ResultsError`, before anything is trained, for runs that are not in the recorded folder, whole, of the same
    suite and of today's versions; and for a run that fails.
    """
    console = console or Console()
    requested = selected_runs(suite, only)
    if repeated.resolve() == recorded.resolve():
        raise ResultsError(f"{repeated} is the folder to verify; give --out another, in which the runs are made again")
    _check_suite(suite, recorded, requested)
    for run in requested:
        _check_recorded(suite, recorded, run)
    with claimed(repeated, suite):
        context = ExecutionContext(suite, repeated, backend or RiverBackend(suite), console)
        rows = execute_runs(context, requested, executor or SerialExecutor())
    for run in requested:
        if (row := rows[run.name]).status != "finished":
            raise ResultsError(f"{run.name} cannot be verified: it {row.status} here: {row.error}")
    return [_compared(suite, recorded, repeated, run) for run in requested]


def tables_of(suite: Suite, recorded: Path, run: Run) -> list[Table]:
    """Return the files in which a run can be compared with that in a `recorded` folder: the curve of its training, if
    it has one, by episodes or by blocks of them, whichever was kept, and its flights."""
    steps = suite.arm(run.algorithm).steps if run.kind == "train" else 0
    kept = training_file(recorded / "runs" / run.name).name
    curve = [Table(CURVE, f"runs/{{run}}/{kept}", CURVE_COLUMNS, steps)] if steps else []
    columns = tuple(name for name in COLUMNS if name not in END_COLUMNS)
    flights = [
        Table(str(trial), evaluation_path(Path(), "{run}", trial).as_posix(), columns) for trial in suite.trials(run)
    ]
    return [*curve, *flights]


def _check_suite(suite: Suite, recorded: Path, requested: Sequence[Run]) -> None:
    """Raise `ResultsError` unless a folder holds the suite, as far as the requested runs depend on it."""
    if RESULTS_FOLDER.is_new(recorded):
        raise ResultsError(f"{recorded} holds no results to verify; give a folder that `thalweg bench` wrote")
    there, here = comparable(read_suite(recorded), suite)
    names = {run.algorithm for run in requested}
    for record in (there, here):
        record["arms"] = {name: _without_seeds(arm) for name, arm in record["arms"].items() if name in names}
        record["policies"] = [each for each in record["policies"] if each["name"] in names and "policy" in each]
        for key in ("name", "baselines", "packaged"):  # other runs than those that are compared
            record.pop(key, None)
    RESULTS_FOLDER.require_same(recorded, there, here)


def _without_seeds(arm: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in arm.items() if key != "seeds"}


def _check_recorded(suite: Suite, recorded: Path, run: Run) -> None:
    """Raise `ResultsError` unless a folder holds a whole run of today's versions."""
    status = next((row.status for row in read_runs(recorded) if row.run == run.name), "not there")
    if status != "finished":
        raise ResultsError(f"{run.name} cannot be verified: in {recorded} it is {status}")
    made_with, now = read_versions(recorded).get(run.name, {}), versions_of(suite, run)
    if label := version_label(made_with, now):
        raise ResultsError(
            f"{run.name} cannot be verified: it was made with {label}, and this copy of Thalweg has other versions;"
            " verify it with the version of Thalweg that made it"
        )
    for table in tables_of(suite, recorded, run):
        if not (path := table.path(recorded, run.name)).is_file():
            raise ResultsError(f"{run.name} cannot be verified: there is no {path}")


def _compared(suite: Suite, recorded: Path, repeated: Path, run: Run) -> Verification:
    """Return how a run in one folder compares with that in another."""
    conditions = other_conditions(_made_under(recorded, run), _made_under(repeated, run))
    parts = []
    for table in tables_of(suite, recorded, run):
        there, here = (table.path(folder, run.name) for folder in (recorded, repeated))
        part = compare_to_the_bit(table, there, here)
        if part.differences and conditions:
            seeds = [each.name for each in suite.runs() if each.algorithm == run.algorithm]
            files = [path for name in seeds if (path := table.path(recorded, name)).is_file()]
            part = compare_means(table, files, there, here)
        parts.append(part)
    return Verification(run.name, tuple(conditions), tuple(parts))


def _made_under(folder: Path, run: Run) -> Mapping[str, Any]:
    """Return machine, device and versions of packages of a run; those of the suite for one that was not trained."""
    try:
        return read_config(folder / "runs" / run.name) or read_suite(folder)
    except TrainingError as error:
        raise ResultsError(str(error)) from error
