"""Executors for the runs of a suite: serial, or a pool of processes.

An executor leaves everything in the run's folder and in its evaluation files, so that a run that is killed at any
moment can be resumed by any other executor. It returns only the run's row of `runs.csv`.
"""

import multiprocessing
import os
import traceback
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import read_episodes, write_episodes
from thalweg.bench.evaluate.progress import complete, progress_bar, track_episodes
from thalweg.bench.execute.backend import STAGES, Backend
from thalweg.bench.execute.river_files import require_unchanged
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.results.results import RunRow, evaluation_path
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.core import versions
from thalweg.core.atomic_io import disk_errors_name, is_disk_error, write_atomic
from thalweg.core.cores import usable_cores
from thalweg.core.parent_process import end_with_parent
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import POLICY, read_status

LOGS, LOG_WIDTH = "logs", 120
"""Folder of the logs of runs in processes of their own, and the width of their lines in characters."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables that set the number of threads of a process."""


@dataclass(frozen=True)
class ExecutionContext:
    """What every run of a suite needs."""

    suite: Suite
    folder: Path
    """Folder of the results."""
    backend: Backend
    console: Console
    """Console for messages about progress."""


class Executor(Protocol):
    """Executes the runs of a suite."""

    def execute(self, context: ExecutionContext, runs: Sequence[Run]) -> Iterator[RunRow]:
        """Execute the runs; yields the row of each as soon as it ends, in any order."""
        ...


class SerialExecutor:
    """Executes one run after another in this process."""

    def execute(self, context: ExecutionContext, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Executor`."""
        for run in runs:
            yield execute_run(run, context)


class ProcessPoolExecutor:
    """Executes up to `jobs` runs at a time, each in a process of its own; the processes share the cores.

    No process has more threads than `THREAD_VARIABLES` allow this one.
    A process that dies is a failed run. All processes end when this one does, however it ends.
    """

    def __init__(self, jobs: int) -> None:
        if jobs < 1:
            raise ResultsError(f"jobs must be at least 1, not {jobs}")
        self.jobs = jobs

    def execute(self, context: ExecutionContext, runs: Sequence[Run]) -> Iterator[RunRow]:
        """See `Executor`; raises `OSError` for a full disk after stopping the other runs."""
        pending, active = list(runs), dict[Connection, tuple[Run, BaseProcess]]()
        threads = max(1, usable_cores() // self.jobs)
        try:
            while pending or active:
                while pending and len(active) < self.jobs:
                    run = pending.pop(0)
                    receiver, process = _start(run, context, threads)
                    active[receiver] = run, process
                ready = wait(list(active))
                for receiver in [receiver for receiver in active if receiver in ready]:
                    yield _receive_row(receiver, *active.pop(receiver), context)
        finally:
            for _, process in active.values():
                process.terminate()
                process.join()


def _start(run: Run, context: ExecutionContext, threads: int) -> tuple[Connection, BaseProcess]:
    """Start the process of a run; returns the connection that receives its row, and the process."""
    spawn = multiprocessing.get_context("spawn")
    receiver, sender = spawn.Pipe(duplex=False)
    process = spawn.Process(target=_run_in_process, args=(sender, run, context.suite, context.folder, context.backend))
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    # A spawned process reads them as it starts.
    os.environ.update({name: _at_most(threads, value) for name, value in before.items()})
    try:
        process.start()
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
    sender.close()
    context.console.print(f"{run.name}: started", highlight=False)
    return receiver, process


def _at_most(threads: int, given: str | None) -> str:
    """Return the smaller of two numbers of threads; `given` does not count unless it is a positive number."""
    limit = int(given) if given is not None and given.isdecimal() else 0
    return str(min(threads, limit) if limit > 0 else threads)


def _receive_row(receiver: Connection, run: Run, process: BaseProcess, context: ExecutionContext) -> RunRow:
    """Return the row that a run's process sent, or that of a failed run if it ended without sending one."""
    try:
        message = receiver.recv()
    except EOFError:
        message = None
    receiver.close()
    process.join()
    if isinstance(message, OSError):
        raise message
    row = message or run_row(run, context, f"the process that did it ended with {process.exitcode}")
    print_row(context.console, row)
    return row


def print_row(console: Console, row: RunRow) -> None:
    """Print how a run ended."""
    console.print(f"{row.run}: {row.status} {row.error}".rstrip(), highlight=False, markup=False)


def _run_in_process(sender: Connection, run: Run, suite: Suite, folder: Path, backend: Backend) -> None:
    """Execute a run in this process, which ends when its parent does, and send its row."""
    end_with_parent()
    try:
        sender.send(execute_run_logged(run, suite, folder, backend))
    except OSError as error:  # a full disk
        sender.send(error)


def execute_run_logged(run: Run, suite: Suite, folder: Path, backend: Backend) -> RunRow:
    """Call `execute_run`, and append everything that this process prints meanwhile to the run's log."""
    log = folder / LOGS / f"{run.name}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    with (
        disk_errors_name(log),
        open(log, "a", buffering=1, encoding="utf-8") as file,
        redirect_stdout(file),
        redirect_stderr(file),
    ):
        return execute_run(run, ExecutionContext(suite, folder, backend, Console(file=file, width=LOG_WIDTH)))


def execute_run(run: Run, context: ExecutionContext) -> RunRow:
    """Train and evaluate one run, skipping what is done already.

    An error becomes the run's row; only a full disk is raised (`OSError`).
    """
    console = context.console
    if run.kind == "packaged" and not PACKAGED_POLICY.exists():
        why = "this copy of Thalweg comes without a trained policy"
        console.print(f"{run.name}: {why}; the other runs continue")
        return RunRow(run.name, run.kind, run.algorithm, run.seed, 0, "absent", why)
    run_folder = context.folder / "runs" / run.name
    error = ""
    try:
        (run_folder / "error.txt").unlink(missing_ok=True)
        require_unchanged(context.suite, context.folder)
        if run.kind == "train" and not _is_trained(run_folder):
            plan = ", then ".join(f"{steps:,} steps on {level}" for steps, level in _stages(run, context.suite))
            console.print(f"{run.name}: train {plan}", highlight=False)
            context.backend.train(run, run_folder)
        for trial in context.suite.trials(run):
            _evaluate(run, run_folder, trial, context)
    except Exception as failure:
        if is_disk_error(failure):
            raise
        error = " ".join(f"{type(failure).__name__}: {failure}".split())
        write_atomic(run_folder / "error.txt", traceback.format_exc())
        console.print(f"{run.name} failed: {error}", style="red", highlight=False, markup=False)
    return run_row(run, context, error)


def _is_trained(run_folder: Path) -> bool:
    """Return whether nothing is left to train: there is a policy, and no status says that more was to come.

    A process that is killed after it wrote the policy leaves a status of a run that is running.
    """
    return (run_folder / POLICY).exists() and read_status(run_folder).get("state", "finished") == "finished"


def _stages(run: Run, suite: Suite) -> list[tuple[int, str]]:
    """Return the steps and level of each stage of training, in order."""
    arm = suite.arm(run.algorithm)
    return [(stage.steps, suite.level_of(stage)) for stage in (*arm.before, arm)]


def run_row(run: Run, context: ExecutionContext, error: str) -> RunRow:
    """Return the row of a run that ended, with what the folders of its stages say; failed if `error` is not empty, or
    if a status cannot be read."""
    folder, records = context.folder / "runs" / run.name, list[dict[str, Any]]()
    try:
        records = [read_status(each) for each in (folder, *(folder / STAGES).glob("[0-9]*"))]
    except (TrainingError, OSError) as failure:
        if is_disk_error(failure):
            raise
        error = error or f"{type(failure).__name__}: {failure}"
    steps = sum(int(record.get("steps") or 0) for record in records)
    seconds = sum(float(record.get("seconds") or 0.0) for record in records)
    row = RunRow(run.name, run.kind, run.algorithm, run.seed, steps, "finished", "", seconds, 0.0)
    rate = steps / seconds if seconds > 0 else 0.0
    return replace(row, status="failed" if error else "finished", error=error, steps_per_s=rate)


def is_evaluated(folder: Path, run: Run, trial: Trial, episodes: int) -> bool:
    """Return whether the evaluation file of a trial is complete, and its shield of this version."""
    shield = versions.SHIELD if trial.condition.shield else 0
    try:
        rows = read_episodes(evaluation_path(folder, run.name, trial))
        return len(rows) == episodes and all(row.shield == shield for row in rows)
    except (ResultsError, OSError):
        return False


def _evaluate(run: Run, run_folder: Path, trial: Trial, context: ExecutionContext) -> None:
    """Fly a trial and write its episodes, unless that is done already."""
    episodes = context.suite.episodes
    if is_evaluated(context.folder, run, trial, episodes):
        return
    with progress_bar(context.console, "episodes") as progress:
        on_step = track_episodes(progress, f"{run.name} on {trial}", episodes)
        rows = context.backend.evaluate(run, run_folder, trial, on_step)
        complete(progress)
    write_episodes(evaluation_path(context.folder, run.name, trial), rows)
