"""How does a suite get done? One run after another, each in its folder; what is finished is never done again.

Kill it at any moment: the same command goes on and ends with the same episodes. A run that fails is a row with its
error in `runs.csv`, the others go on, and the same command tries the failed one again.
"""

import errno
import json
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from thalweg.bench.bars import all_landed, bar, progress_of_flights
from thalweg.bench.episodes import read_episodes, write_episodes
from thalweg.bench.files import ResultsError
from thalweg.bench.filming import film_best
from thalweg.bench.report import Report, write_report
from thalweg.bench.results import RunRow, evaluation_path, read_runs, read_suite, write_runs
from thalweg.bench.river import PACKAGED_POLICY, Place, Rivers, made_by
from thalweg.bench.suites import Run, Suite, check
from thalweg.env import EnvConfig
from thalweg.train.machine import machine, versions
from thalweg.train.record import POLICY, read_status
from thalweg.whole import write_whole


@dataclass(frozen=True)
class Outcome:
    """What a suite left."""

    folder: Path
    report: Report
    runs: list[RunRow]

    @property
    def failed(self) -> list[RunRow]:
        return [row for row in self.runs if row.status == "failed"]


def run_suite(suite: Suite, folder: Path, place: Place | None = None, console: Console | None = None) -> Outcome:
    """Do what is left of a suite and write its report.

    Raises `ResultsError`, before anything runs, for a suite that names what does not exist and for a folder that holds
    another suite.
    """
    console = console or Console()
    _check(suite)
    claim(folder, suite)
    place = place or Rivers(suite)
    rows = {row.run: row for row in read_runs(folder)}
    for run in suite.runs():
        if not _finished(run, suite, folder, rows.get(run.name)):
            rows[run.name] = _attempt(run, suite, folder, place, console)
            write_runs(folder, [rows[other.name] for other in suite.runs() if other.name in rows])
    film_best(suite, folder, place, console)
    report = write_report(folder)
    return Outcome(folder, report, [rows[run.name] for run in suite.runs()])


def _check(suite: Suite) -> None:
    from thalweg.algos.registry import ALGORITHMS
    from thalweg.world import LEVELS

    check(suite, tuple(ALGORITHMS), tuple(LEVELS))


def claim(folder: Path, suite: Suite) -> None:
    """Make the folder this suite's, or raise `ResultsError` if it holds something else or was made by other code."""
    made = made_by()
    record = {
        **suite.as_data(),
        "made_by": made,
        "env": asdict(EnvConfig()),
        "versions": versions(),
        "machine": machine(),
    }
    path = folder / "suite.json"
    if not path.exists():
        if folder.exists() and any(folder.iterdir()):
            raise ResultsError(f"{folder} is not empty and holds no suite; choose another folder")
        write_whole(path, json.dumps(record, indent=2) + "\n")
        return
    old = read_suite(folder)
    differing = [key for key, value in json.loads(json.dumps(suite.as_data())).items() if old.get(key) != value]
    if differing:
        changes = "; ".join(f"{key} {old.get(key)!r} there, {suite.as_data()[key]!r} now" for key in differing)
        raise ResultsError(f"{folder} holds other results ({changes}); choose another folder")
    theirs = old.get("made_by") or {}
    changes = "; ".join(
        f"{key} {theirs.get(key)} there, {mine} now" for key, mine in made.items() if theirs.get(key) != mine
    )
    if changes:
        raise ResultsError(
            f"{folder} holds results made by another Thalweg ({changes}); choose another --out, or remove it"
            f" (make demo OUT=elsewhere, too). Its report can be made again all the same: thalweg report {folder}"
        )


def _finished(run: Run, suite: Suite, folder: Path, row: RunRow | None) -> bool:
    """Whether all episodes of the run are there."""
    if row is None or row.status != "finished":
        return False
    try:
        return all(
            len(read_episodes(evaluation_path(folder, run.name, level))) == suite.episodes
            for level in suite.test_levels
        )
    except (ResultsError, OSError):
        return False


def _attempt(run: Run, suite: Suite, folder: Path, place: Place, console: Console) -> RunRow:
    """Train and evaluate one run. Whatever goes wrong in it becomes its row; a full disk stops everything."""
    if run.kind == "packaged" and not PACKAGED_POLICY.exists():
        why = "this copy of Thalweg comes without a trained policy"
        console.print(f"{run.name}: {why}; the others go on")
        return RunRow(run.name, run.kind, run.algorithm, run.seed, 0, "absent", why)
    home = folder / "runs" / run.name
    error = ""
    try:
        (home / "error.txt").unlink(missing_ok=True)
        if run.kind == "train" and not (home / POLICY).exists():
            console.print(f"{run.name}: train {suite.steps:,} steps on {suite.train_level}", highlight=False)
            place.train(run, home)
        for level in suite.test_levels:
            _evaluate(run, home, suite, level, folder, place, console)
    except Exception as failure:
        if isinstance(failure, OSError) and failure.errno == errno.ENOSPC:
            raise
        error = " ".join(f"{type(failure).__name__}: {failure}".split())
        write_whole(home / "error.txt", traceback.format_exc())
        console.print(f"{run.name} failed: {error}", style="red", highlight=False, markup=False)
    status = read_status(home)
    steps, seconds = int(status.get("steps", 0)), float(status.get("seconds", 0.0))
    done = "failed" if error else "finished"
    rate = steps / seconds if seconds > 0 else 0.0
    return RunRow(run.name, run.kind, run.algorithm, run.seed, steps, done, error, seconds, rate)


def _evaluate(run: Run, home: Path, suite: Suite, level: str, folder: Path, place: Place, console: Console) -> None:
    """Evaluate on a level, unless its file is there and whole."""
    path = evaluation_path(folder, run.name, level)
    try:
        if len(read_episodes(path)) == suite.episodes:
            return
    except (ResultsError, OSError):
        pass
    with bar(console, "episodes") as progress:
        on_step = progress_of_flights(progress, f"{run.name} on {level}", suite.episodes)
        rows = place.evaluate(run, home, level, on_step)
        all_landed(progress)
    write_episodes(path, rows)
