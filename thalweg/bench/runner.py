"""How does a suite get done? One run after another, each in its folder; what is finished is never done again.

Kill it at any moment: the same command goes on and ends with the same episodes. A run that fails is a row with its
error in `runs.csv`, the others go on, and the same command tries the failed one again.
"""

import errno
import json
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from thalweg.bench.episodes import Episode, read_episodes, write_episodes
from thalweg.bench.evaluation import Step
from thalweg.bench.files import ResultsError, write_whole
from thalweg.bench.report import Report, write_report
from thalweg.bench.results import CAPTION, FILM, RunRow, evaluation_path, read_runs, read_suite, write_runs
from thalweg.bench.river import PACKAGED_POLICY, Place, Rivers
from thalweg.bench.suites import Run, Suite, check
from thalweg.env import EnvConfig
from thalweg.train.machine import machine, versions
from thalweg.train.record import POLICY, read_status


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
    _film(suite, folder, place, console)
    report = write_report(folder)
    return Outcome(folder, report, [rows[run.name] for run in suite.runs()])


def _check(suite: Suite) -> None:
    from thalweg.algos.registry import ALGORITHMS
    from thalweg.world import LEVELS

    check(suite, tuple(ALGORITHMS), tuple(LEVELS))


def claim(folder: Path, suite: Suite) -> None:
    """Make the folder this suite's, or raise `ResultsError` if it holds something else."""
    record = {**suite.as_data(), "env": asdict(EnvConfig()), "versions": versions(), "machine": machine()}
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
    else:
        (home / "error.txt").unlink(missing_ok=True)
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
    with flight_progress(console) as progress:
        on_step = progress_of_flights(progress, f"{run.name} on {level}", suite.episodes)
        rows = place.evaluate(run, home, level, on_step)
        all_landed(progress)
    write_episodes(path, rows)


def flight_progress(console: Console) -> Progress:
    """A bar of finished episodes, with the steps flown a second."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("episodes  {task.fields[rate]}"),
        TimeElapsedColumn(),
        console=console,
    )


def progress_of_flights(progress: Progress, name: str, episodes: int) -> Callable[[Step], None]:
    """What `evaluate` calls before every step, to move the bar."""
    task = progress.add_task(name, total=episodes, rate="")
    begun = time.perf_counter()
    flown = 0

    def on_step(step: Step) -> None:
        nonlocal flown
        flown += len(step.flying)
        rate = flown / max(time.perf_counter() - begun, 1e-9)
        progress.update(task, completed=episodes - len(step.flying), rate=f"{rate:,.0f} steps/s")

    return on_step


def all_landed(progress: Progress) -> None:
    """Fill the bars: `on_step` is not told of the last landing."""
    for task in progress.tasks:
        progress.update(task.id, completed=task.total)


def _film(suite: Suite, folder: Path, place: Place, console: Console) -> None:
    """Film the best flight of the packaged policy, or of a trained one, on the level of training."""
    if (folder / FILM).exists() and (folder / CAPTION).exists():
        return
    chosen = best_flight(suite, folder)
    if chosen is None:
        return
    run, episode = chosen
    try:
        with flight_progress(console) as progress:
            task = progress.add_task("film", total=episode.length, rate="")
            caption = place.film(
                run, folder / "runs" / run.name, episode, folder / FILM, lambda: progress.advance(task)
            )
        write_whole(folder / CAPTION, caption + "\n")
    except ResultsError as error:
        console.print(f"No film: {error}")


def best_flight(suite: Suite, folder: Path) -> tuple[Run, Episode] | None:
    """The run and episode with the greatest return, then the least cost: of the packaged policy where there is one."""
    level = suite.train_level if suite.train_level in suite.test_levels else suite.test_levels[0]
    for kind in ("packaged", "train", "baseline"):
        flights = []
        for run in suite.runs():
            path = evaluation_path(folder, run.name, level)
            if run.kind == kind and path.exists():
                flights.extend((run, episode) for episode in read_episodes(path))
        if flights:
            return max(flights, key=lambda flight: (flight[1].return_, -flight[1].cost, -flight[1].episode))
    return None
