"""Runs on a cluster: the same results as here, whoever is lost on the way. It is a real cluster, on this machine."""

import errno
import io
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from tests.bench.execute.test_executors import gone, wait_for
from tests.bench.ray_nodes import ROOT, Nodes
from tests.bench.small_backend import SUITE as SMALL_SUITE
from tests.bench.small_backend import SmallBackend
from tests.bench.walking_backend import DOOMED, LAST, SUITE, WalkingBackend
from tests.train.small_runs import numbers
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.cluster import connection
from thalweg.bench.execute.cluster import ray_executor as cluster
from thalweg.bench.execute.cluster.connection import ray_connection
from thalweg.bench.execute.cluster.ray_executor import RayExecutor
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.results.results import read_runs

pytestmark = pytest.mark.usefixtures("no_pictures")
HOST = socket.gethostname()


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    started = Nodes()
    yield started
    started.stop()


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of this process alone."""
    folder = tmp_path_factory.mktemp("here")
    run_suite(SUITE, folder, WalkingBackend())
    return folder


def results(folder: Path) -> dict[str, object]:
    """Everything in a results folder that must not depend on who did the runs: all but the time it took."""
    files = [*folder.glob("evaluation/*.csv"), folder / "report" / "table.csv"]
    found: dict[str, object] = {file.name: file.read_text() for file in files}
    found["runs.csv"] = [replace(row, wall_s=0.0, steps_per_s=0.0) for row in read_runs(folder)]
    return found | {run: numbers(folder / "runs" / run) for run in ("PPO-0", "FOCOPS-0")}


def held(note: Path, folder: Path) -> tuple[str, int]:
    """Run and process that are held, once that run's last checkpoint has come back."""
    wait_for(lambda: list(note.parent.glob(note.name)), 1)
    run, process = note.read_text().split()
    wait_for(lambda: list(folder.glob(f"runs/{run}/checkpoints/{LAST}/state.json")), 1)
    return run, int(process)


@pytest.mark.slow
@pytest.mark.ray
def test_a_lost_nodes_run_resumes_elsewhere_and_the_results_equal_local_ones(nodes: Nodes, tmp_path: Path, here: Path):
    note, folder = tmp_path / "note.txt", tmp_path / "results"
    doomed = nodes.add(**{DOOMED: str(note)})
    runs: list[str] = []

    def lose_it() -> None:
        runs.append(held(note, folder)[0])
        nodes.kill(doomed)

    killer = threading.Thread(target=lose_it)
    killer.start()
    run_suite(SUITE, folder, WalkingBackend(), executor=RayExecutor(nodes.address, sync_interval_s=0.0))
    killer.join()
    assert results(folder) == results(here)
    log = (folder / "logs" / f"{runs[0]}.txt").read_text().splitlines()
    assert [line for line in log if line.startswith("goes on")] == ["goes on from", f"goes on from {LAST}"]


@pytest.mark.slow
@pytest.mark.ray
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_after_the_driver_is_killed_its_runs_end_and_the_same_command_resumes(
    nodes: Nodes, tmp_path: Path, here: Path, capsys: pytest.CaptureFixture
):
    note, folder = tmp_path / "note.txt", tmp_path / "results"
    driver = subprocess.Popen(
        [sys.executable, "-m", "tests.bench.walking_backend", nodes.address, str(folder), str(note)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    try:
        _, process = held(note, folder)
        assert not gone(process)
    finally:
        driver.send_signal(signal.SIGKILL)
        driver.wait()
    wait_for(lambda: [process] if gone(process) else [], 1)
    run_suite(SUITE, folder, WalkingBackend())
    assert results(folder) == results(here)
    assert capsys.readouterr().out.count(f"goes on from {LAST}") == 1


class Troubled(SmallBackend):
    """The disk of its node is full in one run; see `SmallBackend` for what goes wrong in others."""

    def train(self, run, folder):
        if run.name == "FOCOPS-0":
            raise OSError(errno.ENOSPC, "No space left on device")
        super().train(run, folder)


@pytest.mark.slow
@pytest.mark.ray
def test_failed_runs_are_rows_with_their_errors_and_the_others_continue(
    nodes: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(cluster, "MAX_ATTEMPTS", 2)
    said = io.StringIO()
    place = Troubled(broken=("PPO-0",), dies=("PPO-1",))
    outcome = run_suite(
        SMALL_SUITE, tmp_path, place, Console(file=said, width=200), executor=RayExecutor(nodes.address)
    )
    # A process that dies at once may not have told on which node it runs.
    died = rf"the process that did it on ({HOST}|a node) ended \(WorkerCrashedError\)"
    errors = {row.run: row.error for row in outcome.runs}
    assert re.fullmatch(f"{died}; 2 times without progress", errors.pop("PPO-1"))
    # The run's log is the file that could not be written.
    named = errors.pop("FOCOPS-0")
    assert re.fullmatch(rf"OSError: \[Errno 28\] No space left on device: '\S+FOCOPS-0.txt' \(on {HOST}\)", named)
    assert errors == {
        "hover-0": "",
        "PPO-0": "ArithmeticError: the loss is NaN in line two",
        "FOCOPS-1": "",
    }
    assert re.search(f"^PPO-1: {died}; it is restarted$", said.getvalue(), re.MULTILINE)
    assert "in train" in (tmp_path / "runs" / "PPO-0" / "error.txt").read_text()
    assert "train 100 steps on Medium" in (tmp_path / "logs" / "FOCOPS-1.txt").read_text()


@pytest.mark.slow
@pytest.mark.ray
def test_a_cluster_that_requires_a_token_is_joined_with_it_or_refused_by_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The connection is made by new processes, since Ray reads its environment when it is imported."""
    monkeypatch.setattr(connection, "ANSWER_S", 600.0)
    token = "0123456789abcdef0123456789abcdef"
    nodes = Nodes(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=token)
    try:
        for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("HOME", str(tmp_path))
        with pytest.raises(ResultsError, match=f"the cluster at {nodes.address} requires a token, and this machine"):
            connection._required_environment(nodes.address)
        monkeypatch.setenv("RAY_AUTH_TOKEN", token)
        assert connection._required_environment(nodes.address) == {"RAY_AUTH_MODE": "token"}
    finally:
        nodes.stop()


@pytest.mark.ray
def test_a_cluster_of_another_version_is_not_joined(nodes: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """This process's own Ray is made to look old where it first tries to join."""
    (tmp_path / "sitecustomize.py").write_text("import ray\nray.__version__ = '1.0'")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    message = f"the cluster at {nodes.address} can't be joined: Version mismatch: .*Ray: 2.*Ray: 1.0 Python"
    with pytest.raises(ResultsError, match=message), ray_connection(nodes.address):
        pass
