"""Tests of the work of a node on a run, without a cluster."""

import os
import pickle
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cloudpickle
import pytest

from tests.bench.small_backend import SUITE, SmallBackend
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.backend import installed_versions
from thalweg.bench.execute.cluster import node_task
from thalweg.bench.execute.cluster.node_task import RunRequest, RunUpdate, run_on_node
from thalweg.bench.execute.cluster.ray_executor import _node_function
from thalweg.bench.execute.river_files import OtherRiverError, river_contents
from thalweg.bench.suite.arms import Run

RUN = Run("train", "PPO", 0)
NODE = socket.gethostname()


def request(backend: SmallBackend, **changes: Any) -> RunRequest:
    given: dict[str, Any] = {"files": {}, "versions": installed_versions(), "sync_interval_s": 0.0} | changes
    return RunRequest(RUN, SUITE, backend, **given)


class Slow(SmallBackend):
    """Takes its time on a level, so that what was done before is sent meanwhile."""

    def evaluate(self, run, folder, trial, on_step):
        time.sleep(1.5 if trial.level == "Hard" else 0.0)
        return super().evaluate(run, folder, trial, on_step)


class Held(SmallBackend):
    """Does not begin with the last level until it may."""

    def __init__(self) -> None:
        super().__init__()
        self.may = threading.Event()

    def evaluate(self, run, folder, trial, on_step):
        assert trial.level != "Hard" or self.may.wait(60)
        return super().evaluate(run, folder, trial, on_step)


def level_file(level: str) -> str:
    return f"evaluation/{RUN.name}-{level}.csv"


def kinds(news: list[RunUpdate]) -> list[tuple[bool, bool]]:
    """Whether there were files in each, and a row."""
    return [(one.files is not None, one.row is not None) for one in news]


def test_how_far_a_run_is_comes_back_before_the_end():
    place, news = Held(), []
    for one in run_on_node(request(place)):
        news.append(one)
        if level_file("Medium") in (one.files or {}):
            place.may.set()
    first, *between, last = kinds(news)
    assert (first, set(between), last) == ((False, False), {(True, False)}, (True, True))
    levels = [[level for level in SUITE.test_levels if level_file(level) in (one.files or {})] for one in news]
    assert ["Easy", "Medium"] in levels
    assert levels[-1] == ["Easy", "Medium", "Hard"]


def test_a_file_that_is_removed_while_files_are_listed_is_found_by_the_next_check(monkeypatch: pytest.MonkeyPatch):
    place, news, listed = Held(), [], 0
    names = node_task.archive_names

    def removed_once(*archive: Any) -> list[str]:
        nonlocal listed
        listed += 1
        if listed == 1:
            raise FileNotFoundError("checkpoints/8192/policy")
        return names(*archive)

    monkeypatch.setattr(node_task, "archive_names", removed_once)
    for one in run_on_node(request(place)):
        news.append(one)
        if level_file("Medium") in (one.files or {}):
            place.may.set()
    assert listed > 1 and news[-1].row is not None and news[-1].row.status == "finished"


@pytest.mark.slow
def test_it_runs_at_most_as_often_as_requested():
    assert kinds(list(run_on_node(request(Slow(), sync_interval_s=60.0)))) == [(False, False), (True, True)]


@pytest.mark.slow
def test_what_was_there_already_is_not_done_again_nor_sent_back():
    done = list(run_on_node(request(SmallBackend())))[-1].files or {}
    del done[level_file("Hard")]
    again = list(run_on_node(request(Slow(), files=done)))
    assert kinds(again)[0] == (False, False)
    assert all(level_file("Hard") in (one.files or {}) for one in again[1:])
    assert (again[-1].files or {})["logs/PPO-0.txt"].count(b"PPO-0 on") == 4


def test_a_node_with_other_sources_says_which_are_there_and_which_here():
    ours = installed_versions() | {"world": 99}
    message = f"node {NODE} of the cluster has another Thalweg .world {installed_versions()['world']} there, 99 here.$"
    with pytest.raises(ResultsError, match=message):
        next(run_on_node(request(SmallBackend(), versions=ours)))


def test_a_node_with_another_file_of_a_river_trains_nothing(tmp_path: Path):
    brook = tmp_path / "brook.geojson"
    brook.write_text("{}")
    suite = replace(SUITE, train_level="brook", test_levels=("brook",), files={"brook": {"file": str(brook)}})
    sent = replace(request(SmallBackend()), suite=suite, rivers=river_contents(suite))
    assert next(run_on_node(sent)) == RunUpdate(NODE)
    for content in ("{ }", None):
        brook.unlink() if content is None else brook.write_text(content)
        with pytest.raises(OtherRiverError, match=rf"^node {NODE} of the cluster has another file .*brook\.geojson \("):
            next(run_on_node(sent))


def test_a_node_without_thalweg_says_so(tmp_path: Path):
    """The function that is sent to nodes needs nothing of Thalweg's to be read there."""
    (tmp_path / "thalweg").mkdir()
    (tmp_path / "thalweg" / "__init__.py").write_text("raise ImportError('none here')")
    sent = cloudpickle.dumps(_node_function())
    read = "import pickle, sys; next(pickle.loads(sys.stdin.buffer.read())(b''))"
    tried = subprocess.run(
        [sys.executable, "-c", read],
        input=sent,
        capture_output=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert (
        tried.stderr.decode().splitlines()[-1]
        == f"ImportError: node {NODE} of the cluster lacks this Thalweg (none here)"
    )


def test_the_task_sent_to_nodes_executes_the_run():
    news = list(_node_function()(pickle.dumps(request(SmallBackend()))))
    assert news[0] == RunUpdate(NODE)
    assert news[-1].row is not None and news[-1].row.status == "finished"
