"""Runner of suites: executes what is left of a suite, then writes films and report.

A suite that is killed at any moment resumes with the same command and ends with the same episodes. A run that fails is
a row with its error in `runs.csv`; the other runs continue, and the same command tries the failed one again. Runs that
were made with other versions are outdated and done again.
"""

import json
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import Backend, RiverBackend
from thalweg.bench.execute.executors import ExecutionContext, Executor, SerialExecutor, is_evaluated
from thalweg.bench.execute.feasible import check_feasible
from thalweg.bench.execute.filming import film_flights
from thalweg.bench.execute.reuse import take_trainings
from thalweg.bench.execute.river_files import recorded_rivers
from thalweg.bench.report.report import Report, write_report
from thalweg.bench.results.curve import write_curve
from thalweg.bench.results.outdated import discard, is_current, prepare
from thalweg.bench.results.reading import read_results, versions_today, with_films
from thalweg.bench.results.results import Results, RunRow, read_runs, write_runs
from thalweg.bench.results.run_versions import current_sources, read_sources, read_versions
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.record import read_suite
from thalweg.core.machine import machine_info, package_versions
from thalweg.core.plugins.record import PluginWarning, changed_source
from thalweg.core.run_folder import FolderKind
from thalweg.core.suggestion import did_you_mean

RESULTS_FOLDER = FolderKind("suite", "suite.json", ResultsError)


@dataclass(frozen=True)
class Outcome:
    """The outcome of a suite."""

    results: Results
    report: Report
    runs: list[RunRow]
    """Rows of the requested runs, in the order of the suite."""

    @property
    def failed(self) -> list[RunRow]:
        return [row for row in self.runs if row.status == "failed"]


def run_suite(
    suite: Suite,
    folder: Path,
    backend: Backend | None = None,
    console: Console | None = None,
    *,
    executor: Executor | None = None,
    only: tuple[str, ...] = (),
    reuse: Path | None = None,
) -> Outcome:
    """Execute what is left of a suite and write its report.

    Args:
        suite: The suite.
        folder: Folder of the results, a new one or one of the same suite.
        backend: Trains and flies policies; our rivers by default.
        console: Console for messages about progress.
        executor: Executes the runs; by default this process, one after another.
        only: Names of policies or runs to execute now, see `selected_runs`; all by default.
        reuse: Folder of the results of another suite, from which trainings are taken that are the same there, see
            `thalweg.bench.execute.reuse`; none by default.

    Raises `ResultsError`, before anything runs, for a folder of another suite, for a name in `only` that the suite does
    not have, for a folder `reuse` without results, and the errors of `check_feasible`.
    """
    console = console or Console()
    requested = selected_runs(suite, only)
    check_feasible(suite, requested)
    if reuse is not None and (RESULTS_FOLDER.is_new(reuse) or reuse.resolve() == folder.resolve()):
        raise ResultsError(f"{reuse} holds no results of another suite; give a folder that `thalweg bench` wrote")
    with claimed(folder, suite):
        backend = backend or RiverBackend(suite)
        _warn_of_changed_sources(suite, folder, requested)
        context = ExecutionContext(suite, folder, backend, console)
        rows = execute_runs(context, requested, executor or SerialExecutor(), reuse)
        results = read_results(folder)
        film_flights(suite, results, backend, console)
        results = with_films(results)
        return Outcome(results, write_report(folder, results=results), [rows[run.name] for run in requested])


def execute_runs(
    context: ExecutionContext, requested: Sequence[Run], executor: Executor, reuse: Path | None = None
) -> dict[str, RunRow]:
    """Execute what is left of some runs of a suite, in a folder that is `claimed` for it.

    Returns the rows of all of its runs so far, by name. `reuse`: as for `run_suite`.
    """
    suite, folder = context.suite, context.folder
    rows = {row.run: row for row in read_runs(folder)}
    pending = [run for run in requested if not _is_finished(run, suite, folder, rows.get(run.name))]
    _prepare(suite, folder, pending, context.console)
    if reuse is not None:
        # Trainings of plug-ins are left out: they may have another source there.
        trained = [run for run in pending if run.kind == "train" and not _sources_of(suite, run)]
        take_trainings(context, {run: versions_of(suite, run) for run in trained}, reuse)
    rows = {row.run: row for row in read_runs(folder)}
    runs = {run.name: run for run in suite.runs()}
    for row in executor.execute(context, pending):
        rows[row.run] = row
        write_runs(folder, [rows[name] for name in runs if name in rows])
        if row.status == "finished":
            discard(folder, runs[row.run], suite.trials(runs[row.run]))
    for run in requested:
        if run.kind == "train" and rows[run.name].status == "finished":
            with suppress(ResultsError):  # whoever reads the results names the file that cannot be used
                write_curve(folder / "runs" / run.name, rows[run.name])
    return rows


def selected_runs(suite: Suite, only: tuple[str, ...]) -> list[Run]:
    """Return the runs of a suite with these names, or all of its runs if no names are given.

    A name is that of a run (`FOCOPS-0`) or of a policy: an arm, a baseline or `packaged`. Raises `ResultsError` for an
    unknown name.
    """
    runs = suite.runs()
    known = {name for run in runs for name in (run.name, run.algorithm)}
    for name in only:
        if name not in known:
            meant = did_you_mean(name, sorted(known))
            policies = ", ".join(dict.fromkeys(run.algorithm for run in runs))
            raise ResultsError(
                f"suite {suite.name} has no {name!r}{meant}; name one of {policies}, or one run,"
                f" such as {runs[-1].name}"
            )
    return [run for run in runs if not only or {run.name, run.algorithm} & set(only)]


@contextmanager
def claimed(folder: Path, suite: Suite) -> Iterator[None]:
    """Hold the folder for this suite while the block writes to it.

    Raises `ResultsError` if it holds anything but results of the same suite, or if another command holds it.
    """
    RESULTS_FOLDER.is_new(folder)  # refuses a foreign one before a lock is put into it
    with RESULTS_FOLDER.locked(folder):
        claim(folder, suite)
        yield


def claim(folder: Path, suite: Suite) -> None:
    """Write the record of this suite into a new folder; raises `ResultsError` if it holds anything but results of the
    same suite."""
    if RESULTS_FOLDER.is_new(folder):
        about = {"env": suite.rules.as_data(), "versions": package_versions(), "machine": machine_info()}
        RESULTS_FOLDER.write_json(folder, suite.as_data() | about)
        return
    try:
        record = read_suite(folder)
    except ResultsError as error:
        raise ResultsError(f"{folder} cannot be resumed: {error}; choose another folder") from error
    recorded, requested = comparable(record, suite)
    before = recorded_rivers(recorded)
    for place, river in recorded_rivers(requested).items():
        RESULTS_FOLDER.require_same_file(folder, before.get(place, {}), river)
    RESULTS_FOLDER.require_same(folder, recorded, requested)


def comparable(record: dict[str, Any], suite: Suite) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a suite's record in a folder and that of a suite so that their differences can be named, with their arms
    by name."""
    usual = {
        "observation": "frames",
        "encoder": "default",
        "world_seeds": [],
        "policies": [],
        "rivers": {},
    }  # not written
    usual |= {"task": "River", "hard": False, "forces": {}, "views": {}}
    requested = usual | json.loads(json.dumps(suite.as_data()))
    recorded = usual | {key: value for key, value in record.items() if key in requested}
    return _arms_by_name(_by_content(recorded)), _arms_by_name(_by_content(requested))


def _by_content(record: dict[str, Any]) -> dict[str, Any]:
    """Return a suite's record with the contents of policies alone, wherever their files lie and whatever they are
    called."""

    def content(file: Any) -> Any:
        return {name: value for name, value in file.items() if name != "file"} if isinstance(file, dict) else file

    def told(each: dict[str, Any], name: str) -> dict[str, Any]:
        files = each.get(name)
        if files is None:
            return each
        return each | {name: [*map(content, files)] if isinstance(files, list) else content(files)}

    policies = [told(each, "policy") for each in record.get("policies", [])]
    return record | {"policies": policies, "arms": [told(arm, "begin_with") for arm in record.get("arms", [])]}


def _arms_by_name(record: dict[str, Any]) -> dict[str, Any]:
    """Return a suite's record with its arms by name, so that differences name the arm."""
    return record | {"arms": {arm["name"]: arm for arm in record.get("arms", [])}}


def versions_of(suite: Suite, run: Run) -> dict[str, int | None]:
    """Return the current versions of what a run depends on."""
    own = {run.algorithm: suite.function(run.algorithm).policy.version} if run.kind == "function" else {}
    return versions_today(suite.as_data(), run.algorithm, own)


def _sources_of(suite: Suite, run: Run) -> dict[str, str]:
    """Return the current hashes of the sources of the plug-ins that a run is trained by, or of the function that it
    flies."""
    own = {run.algorithm: suite.function(run.algorithm).policy.source} if run.kind == "function" else {}
    return own | current_sources(suite.plugins_of(run))


def _warn_of_changed_sources(suite: Suite, folder: Path, runs: Sequence[Run]) -> None:
    """Warn once of each plug-in whose source has changed since a run of the folder, and whose version has not."""
    recorded, made_with, warned = read_sources(folder), read_versions(folder), set[str]()
    for run in runs:
        current, versions = _sources_of(suite, run), versions_of(suite, run)
        for name, before in recorded.get(run.name, {}).items():
            same = made_with.get(run.name, {}).get(name) == versions.get(name)
            if same and name not in warned and current.get(name, before) != before:
                where = f"run {run.name} in {folder}"
                warnings.warn(changed_source(name, where, before, current[name]), PluginWarning, stacklevel=3)
                warned.add(name)


def _prepare(suite: Suite, folder: Path, runs: Sequence[Run], console: Console) -> None:
    """Set outdated runs aside, and say how many are done again."""
    outcomes = Counter(
        prepare(folder, run, suite.trials(run), versions_of(suite, run), _sources_of(suite, run)) for run in runs
    )
    for outcome in ("trained", "flown"):
        if count := outcomes[outcome]:
            console.print(
                f"{count} outdated run{'s' * (count > 1)}, made with other versions: {outcome} again; the earlier"
                " results are shown until then",
                highlight=False,
            )


def _is_finished(run: Run, suite: Suite, folder: Path, row: RunRow | None) -> bool:
    """Return whether all episodes of the run exist, with the current versions."""
    if row is None or row.status != "finished" or not is_current(folder, run, versions_of(suite, run)):
        return False
    finished = all(is_evaluated(folder, run, trial, suite.episodes) for trial in suite.trials(run))
    if finished:
        discard(folder, run, suite.trials(run))  # an earlier call may have been killed before it did
    return finished
