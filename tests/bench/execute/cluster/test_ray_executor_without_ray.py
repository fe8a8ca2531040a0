"""Tests of the work done here for runs that are done elsewhere, without a cluster: each is done at once, or by a
script."""

import errno
import io
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from tests.bench.small_backend import SUITE, SmallBackend
from tests.bench.suite.test_rivers import LINE
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.cluster import ray_executor as cluster
from thalweg.bench.execute.cluster.node_task import RunRequest, RunUpdate
from thalweg.bench.execute.cluster.ray_executor import RayExecutor
from thalweg.bench.execute.cluster.run_archive import unpack
from thalweg.bench.execute.executors import ExecutionContext
from thalweg.bench.execute.river_files import OtherRiverError
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.results.results import RunRow, read_runs
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.flown import Function

pytestmark = pytest.mark.usefixtures("no_pictures")


class Lost(Exception):
    """A node was lost."""


class Told(Exception):
    """What a task raised."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(cause)
        self.cause = cause


class StandIn:
    """What `RayExecutor` uses of Ray; `most` is how many streams it was ever asked to wait for."""

    exceptions = SimpleNamespace(RayTaskError=Told, RayError=Lost)
    cloudpickle = pickle

    def __init__(self, script: Callable[[RunRequest], Iterator[RunUpdate]] | None = None) -> None:
        self.script, self.most = script, 0

    def remote(self, **options: Any) -> Callable[[Any], Any]:
        return lambda task: SimpleNamespace(remote=task if self.script is None else self._by_script)

    def _by_script(self, order: bytes) -> Iterator[RunUpdate]:
        assert self.script is not None
        return self.script(pickle.loads(order))

    def wait(self, streams: list, timeout: float) -> tuple[list, list]:
        self.most = max(self.most, len(streams))
        return streams[:1], streams[1:]

    def get(self, news: RunUpdate | Exception) -> RunUpdate:
        if isinstance(news, Exception):
            raise news
        return news


@pytest.fixture
def joins(monkeypatch: pytest.MonkeyPatch) -> Callable[[StandIn], StandIn]:
    """Lets clusters join a stand-in."""

    def join(ray: StandIn) -> StandIn:
        @contextmanager
        def ray_connection(address: str) -> Iterator[StandIn]:
            yield ray

        monkeypatch.setattr(cluster, "ray_connection", ray_connection)
        monkeypatch.setattr(cluster, "check_ray", lambda: None)
        return ray

    return join


@pytest.mark.parametrize(("jobs", "most"), [(None, 5), (2, 2)])
def test_at_most_the_requested_number_of_runs_execute_at_once(
    joins: Callable, tmp_path: Path, jobs: int | None, most: int
):
    ray = joins(StandIn())
    assert run_suite(SUITE, tmp_path, SmallBackend(), executor=RayExecutor("auto", jobs)).failed == []
    assert ray.most == most


def test_what_runs_wait_for_is_printed_once(joins: Callable, tmp_path: Path):
    class Busy(StandIn):
        """Has no free processor for a while."""

        idle = 3

        def wait(self, streams: list, timeout: float) -> tuple[list, list]:
            self.idle -= 1
            return super().wait(streams, timeout) if self.idle < 0 else ([], streams)

        def nodes(self) -> list[dict[str, Any]]:
            return [{"Alive": True, "Resources": {"CPU": 2.0}}, {"Alive": False, "Resources": {"CPU": 64.0}}]

    joins(Busy())
    said = io.StringIO()
    run_suite(SUITE, tmp_path, SmallBackend(), Console(file=said, width=200), executor=RayExecutor("auto", cpus=4))
    lines = [line for line in said.getvalue().splitlines() if line.startswith("waiting")]
    assert lines == ["waiting for a node with free processors: a run takes 4, the largest node has 2"]


def test_no_cluster_is_joined_when_no_runs_remain(joins: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    joins(StandIn())
    run_suite(SUITE, tmp_path, SmallBackend())
    monkeypatch.setattr(cluster, "ray_connection", None)
    assert len(run_suite(SUITE, tmp_path, SmallBackend(), executor=RayExecutor("auto")).runs) == 5


def test_a_full_disk_here_stops_all_and_keeps_what_was_finished(
    joins: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def unpack_or_fail(files, folder, run):
        if run == "PPO-0":
            raise OSError(errno.ENOSPC, "No space left on device")
        unpack(files, folder, run)

    joins(StandIn())
    monkeypatch.setattr(cluster, "unpack", unpack_or_fail)
    with pytest.raises(OSError, match="No space"):
        run_suite(SUITE, tmp_path, SmallBackend(), executor=RayExecutor("auto", jobs=1))
    assert [(row.run, row.status) for row in read_runs(tmp_path)] == [("hover-0", "finished")]


@pytest.mark.parametrize(("gets_further", "begun", "status"), [(True, 6, "finished"), (False, 3, "failed")])
def test_a_run_is_restarted_as_long_as_it_makes_progress(
    joins: Callable, tmp_path: Path, gets_further: bool, begun: int, status: str
):
    """Each time it goes on from the checkpoint that came back, and its node is lost after the next one."""
    found: list[list[str]] = []

    def script(order: RunRequest) -> Iterator[Any]:
        found.append([name.split("/")[3] for name in order.files])
        if len(found) == 6:
            yield RunUpdate("node7", order.files, RunRow("PPO-0", "train", "PPO", 0, 100, "finished"))
            return
        step = len(found) if gets_further else 1
        yield RunUpdate("node7", {f"runs/PPO-0/checkpoints/{step:012d}/state.json": b"{}"})
        yield Lost()

    joins(StandIn(script))
    work = ExecutionContext(SUITE, tmp_path, SmallBackend(), Console(file=io.StringIO()))
    rows = list(RayExecutor("auto").execute(work, [Run("train", "PPO", 0)]))
    assert found == [[]] + [[f"{step if gets_further else 1:012d}"] for step in range(1, begun)]
    assert [(row.run, row.status) for row in rows] == [("PPO-0", status)]


@pytest.mark.parametrize(
    ("cause", "hint"),
    [
        (ResultsError("node a has another Thalweg"), "; install the same Thalweg on every node"),
        (ImportError("node a lacks this Thalweg"), "; install the same Thalweg on every node"),
        (OtherRiverError("node a has another file"), ""),
    ],
)
def test_a_node_with_another_thalweg_or_river_stops_all(joins: Callable, tmp_path: Path, cause: Exception, hint: str):
    def script(order: RunRequest) -> Iterator[Any]:
        yield Told(cause)

    joins(StandIn(script))
    with pytest.raises(ResultsError, match=f"^{cause}{hint}$"):
        run_suite(SUITE, tmp_path, SmallBackend(), executor=RayExecutor("auto"))
    assert read_runs(tmp_path) == []


def test_functions_of_files_fly_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cluster, "check_ray", lambda: None)
    monkeypatch.setattr(cluster, "ray_connection", None)
    (tmp_path / "mine.py").write_text("def ahead(obs):\n    return [1, 1, 0, 1]\n\n\nahead.version = 1\n")
    suite = replace(SUITE, arms=(), baselines=(), policies=(Function(f"{tmp_path / 'mine.py'}:ahead"),))
    outcome = run_suite(suite, tmp_path / "results", SmallBackend(), executor=RayExecutor("auto"))
    assert [(row.run, row.status) for row in outcome.runs] == [("ahead-0", "finished")]


def test_a_file_that_is_edited_meanwhile_is_not_sent(joins: Callable, tmp_path: Path):
    brook = tmp_path / "brook.geojson"
    brook.write_text(LINE)
    files = {"brook": {"file": str(brook), "width_m": 9.0}}
    suite = replace(SUITE, train_level="brook", test_levels=("brook",), files=files)

    def script(order: RunRequest) -> Iterator[RunUpdate]:
        brook.write_text(LINE.replace("9.0012", "9.0013"))
        yield RunUpdate("node7", None, RunRow(order.run.name, "train", "PPO", 0, 100, "finished"))

    joins(StandIn(script))
    with pytest.raises(ResultsError, match=r"brook\.geojson has changed since the suite in"):
        run_suite(suite, tmp_path / "results", SmallBackend(), executor=RayExecutor("auto", jobs=1))
