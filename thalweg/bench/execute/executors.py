"""Who does the runs of a suite? This process, one after the other, or several processes beside each other.

Whoever does a run leaves everything in its folder and in the evaluation's files, so that it can be killed at any moment
and done by somebody else the next time; what it returns is only the row of `runs.csv`.
"""

import errno
import multiprocessing
import os
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import read_episodes, write_episodes
from thalweg.bench.evaluate.progress import all_landed, bar, progress_of_flights
from thalweg.bench.execute.rivers import PACKAGED_POLICY, Place
from thalweg.bench.results.results import RunRow, evaluation_path
from thalweg.bench.suite.suites import Run, Suite
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import usable_cores
from thalweg.train.folder.run_record import POLICY, read_status

LOGS, WIDTH = "logs", 120
"""Folder of what processes print, and the length of its lines."""


@dataclass(frozen=True)
class Work:
    """What is to be done, and where."""

    suite: Suite
    folder: Path
    place: Place
    console: Console
    """Where it is said what is going on."""


class Hands(Protocol):
    """Who does the runs."""

    def carry_out(self, work: Work, runs: Sequence[Run]) -> Iterator[RunRow]:
        """Do the runs; the row of each as soon as it is done, in any order."""
        ...


class Here:
    """This process, one run after the other."""

    def carry_out(self, work: Work, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Hands`."""
        for run in runs:
            yield attempt(run, work)


class Processes:
    """So many processes at a time, one for each run, that share the cores.

    A process that dies is a failed run; they all end when this process does, whatever ends it.
    """

    def __init__(self, jobs: int) -> None:
        if jobs < 1:
            raise ResultsError(f"jobs must be at least 1, not {jobs}")
        self.jobs = jobs

    def carry_out(self, work: Work, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Hands`; raises `OSError` for a full disk, once the runs beside it have been stopped."""
        waiting, going = list(runs), dict[Connection, tuple[Run, Any]]()
        threads = max(1, usable_cores() // self.jobs)
        try:
            while waiting or going:
                while waiting and len(going) < self.jobs:
                    run = waiting.pop(0)
                    going.update([self._begun(run, work, threads)])
                ready = wait(list(going))
                for ear in [ear for ear in going if ear in ready]:
                    run, process = going.pop(ear)
                    yield _heard(ear, run, process, work)
        finally:
            for _, process in going.values():
                process.terminate()
                process.join()

    def _begun(self, run: Run, work: Work, threads: int) -> tuple[Connection, tuple[Run, Any]]:
        """Where to listen for a run's row, and the process that does it."""
        context = multiprocessing.get_context("spawn")
        ear, mouth = context.Pipe(duplex=False)
        process = context.Process(target=_alone, args=(mouth, run, work.suite, work.folder, work.place))
        names = {name: str(threads) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")}
        before = {name: os.environ.get(name) for name in names}
        os.environ.update(names)  # a child that is spawned reads them as it starts
        try:
            process.start()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
        mouth.close()
        work.console.print(f"{run.name}: begun", highlight=False)
        return ear, (run, process)


def _heard(ear: Connection, run: Run, process: Any, work: Work) -> RunRow:
    """The row of a run whose process has said it, or has ended without a word."""
    try:
        said = ear.recv()
    except EOFError:
        said = None
    ear.close()
    process.join()
    if isinstance(said, OSError):
        raise said
    if said is None:
        said = row_of(run, work, f"the process that did it ended with {process.exitcode}")
    work.console.print(f"{run.name}: {said.status} {said.error}".rstrip(), highlight=False, markup=False)
    return said


def _alone(mouth: Connection, run: Run, suite: Suite, folder: Path, place: Place) -> None:
    """A run in a process of its own, which ends when its parent does."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    try:
        mouth.send(logged(run, suite, folder, place))
    except OSError as error:  # a full disk
        mouth.send(error)


def logged(run: Run, suite: Suite, folder: Path, place: Place) -> RunRow:
    """`attempt`; what this process prints meanwhile goes into the run's log."""
    log = folder / LOGS / f"{run.name}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    with open(log, "a", buffering=1, encoding="utf-8") as file, redirect_stdout(file), redirect_stderr(file):
        return attempt(run, Work(suite, folder, place, Console(file=file, width=WIDTH)))


def _end_with(sentinel: int) -> None:
    """Wait for another process to end, and end too."""
    wait([sentinel])
    os._exit(1)


def attempt(run: Run, work: Work) -> RunRow:
    """Train and evaluate one run. Whatever goes wrong in it becomes its row; a full disk stops everything."""
    suite, folder, place, console = work.suite, work.folder, work.place, work.console
    if run.kind == "packaged" and not PACKAGED_POLICY.exists():
        why = "this copy of Thalweg comes without a trained policy"
        console.print(f"{run.name}: {why}; the others go on")
        return RunRow(run.name, run.kind, run.algorithm, run.seed, 0, "absent", why)
    home = folder / "runs" / run.name
    error = ""
    try:
        (home / "error.txt").unlink(missing_ok=True)
        if run.kind == "train" and not (home / POLICY).exists():
            plan = ", then ".join(f"{steps:,} steps on {level}" for steps, level in _stages(run, suite))
            console.print(f"{run.name}: train {plan}", highlight=False)
            place.train(run, home)
        for trial in suite.trials(run):
            _evaluate(run, home, trial, work)
    except Exception as failure:
        if isinstance(failure, OSError) and failure.errno == errno.ENOSPC:
            raise
        error = " ".join(f"{type(failure).__name__}: {failure}".split())
        write_atomic(home / "error.txt", traceback.format_exc())
        console.print(f"{run.name} failed: {error}", style="red", highlight=False, markup=False)
    return row_of(run, work, error)


def _stages(run: Run, suite: Suite) -> list[tuple[int, str]]:
    """How many steps are taken on which level, one stage after the other."""
    arm = suite.arm(run.algorithm)
    return [*((stage.steps, stage.level) for stage in arm.before), (arm.steps, suite.level_of(arm))]


def row_of(run: Run, work: Work, error: str) -> RunRow:
    """The row of a run that ended, by what its folder says; failed if there is an error."""
    status = read_status(work.folder / "runs" / run.name)
    steps, seconds = int(status.get("steps", 0)), float(status.get("seconds", 0.0))
    row = RunRow(run.name, run.kind, run.algorithm, run.seed, steps, "finished", "", seconds, 0.0)
    rate = steps / seconds if seconds > 0 else 0.0
    return replace(row, status="failed" if error else "finished", error=error, steps_per_s=rate)


def _evaluate(run: Run, home: Path, trial: Trial, work: Work) -> None:
    """Fly a trial, unless its file is there and whole."""
    path, episodes = evaluation_path(work.folder, run.name, trial), work.suite.episodes
    try:
        if len(read_episodes(path)) == episodes:
            return
    except (ResultsError, OSError):
        pass
    with bar(work.console, "episodes") as progress:
        on_step = progress_of_flights(progress, f"{run.name} on {trial}", episodes)
        rows = work.place.evaluate(run, home, trial, on_step)
        all_landed(progress)
    write_episodes(path, rows)
