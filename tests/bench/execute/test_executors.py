"""Runs beside each other: the same results as one after the other, whoever dies on the way."""

import errno
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute import executors
from thalweg.bench.execute.executors import (
    LOGS,
    THREAD_VARIABLES,
    ExecutionContext,
    ProcessPoolExecutor,
    SerialExecutor,
    run_row,
)
from thalweg.bench.execute.runner import run_suite, selected_runs
from thalweg.bench.results.results import read_runs
from thalweg.bench.suite.arms import Run
from thalweg.train.folder.run_record import write_status

pytestmark = pytest.mark.usefixtures("no_pictures")

CUT_OFF = """
import sys
from pathlib import Path
from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.execute.executors import ProcessPoolExecutor
from thalweg.bench.execute.runner import run_suite

if __name__ == "__main__":
    run_suite(SUITE, Path(sys.argv[1]), SmallBackend(sleeps_s=600.0), executor=ProcessPoolExecutor(2))
"""


def tables(folder: Path) -> dict[str, str]:
    """Everything of a results folder that is a result, by name."""
    files = [*folder.glob("evaluation/*.csv"), folder / "runs.csv", folder / "report" / "table.csv"]
    return {file.name: file.read_text() for file in files}


@pytest.fixture(scope="module")
def one_by_one(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("one_by_one")
    run_suite(SUITE, folder, SmallBackend())
    return tables(folder)


def test_the_row_of_a_run_counts_all_stages_of_its_training(tmp_path: Path):
    home, run = tmp_path / "runs" / "curriculum-4", Run("train", "curriculum", 4)
    for folder, steps, seconds in (
        (home / ".before" / "0", 60, 5.0),
        (home / ".before" / "1", 40, 20.0),
        (home, 100, 25.0),
    ):
        folder.mkdir(parents=True, exist_ok=True)
        figures = {"return_mean": 1.0, "cost_mean": 0.0, "cost_rate": 0.0, "warnings": {}, "episodes": 2}
        write_status(folder, {"state": "finished", "algorithm": "PPO", "steps": steps, "seconds": seconds, **figures})
    context = ExecutionContext(SUITE, tmp_path, SmallBackend(), Console())
    row = run_row(run, context, "")
    assert (row.status, row.steps, row.wall_s, row.steps_per_s) == ("finished", 200, 50.0, 4.0)
    assert run_row(Run("train", "PPO", 0), context, "broken").steps_per_s == 0.0


def spoil_status(folder: Path, run: str) -> Path:
    """Write half a status into the folder of a run that has no row yet; returns its path."""
    (folder / "runs.csv").unlink(missing_ok=True)
    (path := folder / "runs" / run / "status.json").parent.mkdir(parents=True, exist_ok=True)
    path.write_text('{"state": "runn')
    return path


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_damaged_status_is_a_failed_run_and_the_others_continue(jobs: int, tmp_path: Path):
    run_suite(SUITE, tmp_path, SmallBackend(), only=("PPO-0",))
    path = spoil_status(tmp_path, "PPO-0")
    executor = SerialExecutor() if jobs == 1 else ProcessPoolExecutor(jobs)
    outcome = run_suite(SUITE, tmp_path, SmallBackend(), executor=executor)
    (row,) = outcome.failed
    assert row.run == "PPO-0" and row.error.startswith(f"TrainingError: {path} is not the status of a run: ")
    assert [row.status for row in outcome.runs].count("finished") == 4
    path.unlink()
    assert run_suite(SUITE, tmp_path, SmallBackend()).failed == []


def test_a_process_that_died_is_a_failed_run_also_with_a_damaged_status(tmp_path: Path):
    spoil_status(tmp_path, "PPO-0")
    context = ExecutionContext(SUITE, tmp_path, SmallBackend(), Console())
    row = run_row(Run("train", "PPO", 0), context, "the process that did it ended with 9")
    assert (row.status, row.error, row.steps) == ("failed", "the process that did it ended with 9", 0)


def test_the_row_of_a_run_without_a_number_in_its_status_has_none(tmp_path: Path):
    (tmp_path / "runs" / "PPO-0").mkdir(parents=True)
    (tmp_path / "runs" / "PPO-0" / "status.json").write_text('{"state": "failed", "steps": null, "seconds": null}')
    row = run_row(Run("train", "PPO", 0), ExecutionContext(SUITE, tmp_path, SmallBackend(), Console()), "broken")
    assert (row.steps, row.wall_s, row.steps_per_s) == (0, 0.0, 0.0)


def test_a_run_that_was_killed_between_its_policy_and_its_status_is_trained_to_its_end(tmp_path: Path):
    """Without a status, as of functions that train, the policy says enough."""
    run_suite(SUITE, tmp_path, SmallBackend())
    (tmp_path / "runs.csv").unlink()
    (tmp_path / "runs" / "PPO-0" / "status.json").write_text('{"state": "running"}')
    (tmp_path / "runs" / "PPO-1" / "status.json").write_text('{"state": "interrupted"}')
    again = SmallBackend()
    assert run_suite(SUITE, tmp_path, again, only=("PPO", "FOCOPS")).failed == []
    assert again.calls == ["train PPO-0", "train PPO-1"]


@pytest.mark.slow
def test_two_at_a_time_leave_what_one_leaves(tmp_path: Path, one_by_one: dict[str, str]):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(), executor=ProcessPoolExecutor(2))
    assert [row.status for row in outcome.runs] == ["finished"] * 5
    assert tables(tmp_path) == one_by_one
    assert "train 100 steps on Medium" in (tmp_path / LOGS / "FOCOPS-1.txt").read_text()


@pytest.mark.slow
def test_a_process_that_dies_is_a_failed_run_and_is_tried_again(tmp_path: Path, one_by_one: dict[str, str]):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(dies=("PPO-1",)), executor=ProcessPoolExecutor(3))
    assert [(row.run, row.error) for row in outcome.failed] == [("PPO-1", "the process that did it ended with 9")]
    assert len([row for row in read_runs(tmp_path) if row.status == "finished"]) == 4
    assert run_suite(SUITE, tmp_path, SmallBackend(), executor=ProcessPoolExecutor(2)).failed == []
    assert tables(tmp_path) == one_by_one


Numbers = tuple[str | None, ...]
"""Values of the variables for numbers of threads, in order; None for one that is not set."""


def _numbers() -> Numbers:
    return tuple(map(os.environ.get, THREAD_VARIABLES))


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Numbers]:
    """The numbers of threads that each process would inherit; a process is over as soon as it starts."""
    started: list[Numbers] = []

    class Process:
        exitcode = 0

        def __init__(self, target: Any, args: Any) -> None:
            self.sender, self.run = args[:2]

        def start(self) -> None:
            started.append(_numbers())
            self.sender.send(run_row(self.run, _context(tmp_path), "over"))

        def join(self) -> None:
            """It has ended."""

    spawn = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Process)
    monkeypatch.setattr(executors.multiprocessing, "get_context", lambda _: spawn)
    return started


def _context(folder: Path) -> ExecutionContext:
    return ExecutionContext(SUITE, folder, SmallBackend(), Console(quiet=True))


@pytest.mark.parametrize(("cores", "jobs", "threads"), [(7, 2, "3"), (1, 2, "1")])
def test_processes_share_the_cores_and_this_one_keeps_its_own(
    cores: int, jobs: int, threads: str, started: list[Numbers], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(executors, "usable_cores", lambda: cores)
    monkeypatch.setenv(THREAD_VARIABLES[0], "5")
    monkeypatch.delenv(THREAD_VARIABLES[1], raising=False)
    rows = ProcessPoolExecutor(jobs).execute(_context(tmp_path), [Run("train", "PPO", seed) for seed in range(3)])
    assert sorted(row.run for row in rows) == ["PPO-0", "PPO-1", "PPO-2"]
    assert started == [(threads, threads)] * 3 and _numbers() == ("5", None)


@pytest.mark.parametrize(("given", "kept"), [(("2", "1"), ("2", "1")), (("0", "two"), ("3", "3"))])
def test_processes_have_no_more_threads_than_the_user_set(
    given: Numbers, kept: Numbers, started: list[Numbers], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(executors, "usable_cores", lambda: 6)
    for name, value in zip(THREAD_VARIABLES, given, strict=True):
        monkeypatch.setenv(name, str(value))
    list(ProcessPoolExecutor(2).execute(_context(tmp_path), [Run("train", "PPO", 0)]))
    assert started == [kept]


@pytest.mark.slow
def test_an_error_in_a_process_is_its_row(tmp_path: Path):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(broken=("FOCOPS-0",)), executor=ProcessPoolExecutor(2))
    assert [row.error for row in outcome.failed] == ["ArithmeticError: the loss is NaN in line two"]
    assert "in train" in (tmp_path / "runs" / "FOCOPS-0" / "error.txt").read_text()


def gone(process: int) -> bool:
    """Whether a process has ended; one that nobody has asked for counts as ended too."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


class Full(SmallBackend):
    """The disk is full when FOCOPS-0 is to be trained, while the training of PPO-1 takes ten minutes."""

    def train(self, run: Run, folder: Path) -> None:
        if run.name == "FOCOPS-0":
            other = folder.parent / "PPO-1" / "process.txt"
            while not other.is_file():
                time.sleep(0.05)
            raise OSError(errno.ENOSPC, "No space left on device")
        self.sleeps_s = 600.0 if run.name == "PPO-1" else 0.0
        super().train(run, folder)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_a_full_disk_in_a_process_stops_all(tmp_path: Path):
    with pytest.raises(OSError, match="No space"):
        run_suite(SUITE, tmp_path, Full(), executor=ProcessPoolExecutor(2))
    assert gone(int((tmp_path / "runs" / "PPO-1" / "process.txt").read_text()))
    assert {row.run: row.status for row in read_runs(tmp_path)}["PPO-0"] == "finished"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_killed_at_once_it_leaves_no_process_behind(tmp_path: Path):
    (tmp_path / "cut_off.py").write_text(CUT_OFF)
    results = tmp_path / "results"
    paths = os.pathsep.join([str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")])
    runner = subprocess.Popen(
        [sys.executable, str(tmp_path / "cut_off.py"), str(results)],
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.DEVNULL,
    )
    try:
        notes = wait_for(lambda: list(results.glob("runs/*/process.txt")), 2)
        children = [int(note.read_text()) for note in notes]
        assert not any(gone(child) for child in children)
    finally:
        runner.send_signal(signal.SIGKILL)
        runner.wait()
    assert wait_for(lambda: [child for child in children if gone(child)], 2)


def wait_for(found, count: int, seconds: float = 600.0) -> list:
    """What is found once there is so much of it."""
    end = time.monotonic() + seconds
    while len(have := found()) < count:
        assert time.monotonic() < end, f"{have} after {seconds} s"
        time.sleep(0.1)
    return have


def test_only_what_is_named_is_done_and_the_rest_later(tmp_path: Path, one_by_one: dict[str, str]):
    outcome = run_suite(SUITE, tmp_path, SmallBackend(), only=("FOCOPS-1", "PPO"))
    assert [row.run for row in outcome.runs] == ["PPO-0", "PPO-1", "FOCOPS-1"]
    assert any(line.startswith("Unfinished: 6 of 15") for line in outcome.report.problems)
    run_suite(SUITE, tmp_path, SmallBackend())
    assert tables(tmp_path) == one_by_one


def test_what_is_named_is_in_the_order_of_the_suite_and_known():
    assert [run.name for run in selected_runs(SUITE, ())] == ["hover-0", "PPO-0", "PPO-1", "FOCOPS-0", "FOCOPS-1"]
    said = (
        r"suite small has no 'FOCOPS-2' \(did you mean 'FOCOPS-1'\?\); name one of hover, PPO, FOCOPS, or one run,"
        " such as FOCOPS-1$"
    )
    with pytest.raises(ResultsError, match=said):
        selected_runs(SUITE, ("PPO", "FOCOPS-2"))


def test_no_jobs_do_nothing():
    with pytest.raises(ResultsError, match="jobs must be at least 1, not 0"):
        ProcessPoolExecutor(0)
