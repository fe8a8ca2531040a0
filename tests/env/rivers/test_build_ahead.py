"""Tests of the process that builds rivers ahead of their use."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thalweg.core.cache import cache_dir
from thalweg.env.rivers import build_ahead
from thalweg.env.rivers.build_ahead import BackgroundBuilder
from thalweg.world import LEVELS, build
from thalweg.world.record import World
from thalweg.world.store.world_cache import cache_path

SMALL = replace(LEVELS["Easy"], name="Small", plant_density=0.02)


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for compiled in ("kernels", "code"):
        (tmp_path / compiled).symlink_to(cache_dir() / compiled)
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))


def fail_after(seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make `wait` fail the test if it takes longer than `seconds`."""
    until, sleep = time.monotonic() + seconds, time.sleep

    def checked(pause_s: float) -> None:
        assert time.monotonic() < until, "it still waits"
        sleep(pause_s)

    monkeypatch.setattr(build_ahead.time, "sleep", checked)


@pytest.mark.slow
def test_rivers_are_built_elsewhere_the_urgent_one_first():
    builder = BackgroundBuilder([(SMALL, seed) for seed in range(40)])
    assert builder.missing == 40
    builder.wait((SMALL, 39))
    built, expected = World.load(cache_path(SMALL, 39)), build(SMALL, 39)
    assert np.array_equal(built.ground_m, expected.ground_m)
    assert not all(cache_path(SMALL, seed).is_file() for seed in range(39))
    builder.close()


@pytest.mark.slow
def test_nobody_waits_for_a_process_that_was_killed(monkeypatch: pytest.MonkeyPatch):
    builder = BackgroundBuilder([(SMALL, 1)])
    process = builder._process
    assert process is not None
    os.kill(process.pid, signal.SIGKILL)
    fail_after(5.0, monkeypatch)
    builder.wait((SMALL, 1))
    builder.close()
    assert process.returncode == -signal.SIGKILL


@pytest.mark.slow
def test_nobody_waits_for_a_file_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "worlds").write_text("in the way")
    builder = BackgroundBuilder([(SMALL, 1)])
    process = builder._process
    assert process is not None
    fail_after(60.0, monkeypatch)  # the process itself takes seconds to start
    builder.wait((SMALL, 1))
    assert process.wait(60) == 1
    builder.close()


@pytest.mark.slow
def test_the_process_ends_with_its_parent():
    builder = BackgroundBuilder([(SMALL, seed) for seed in range(400)])
    process = builder._process
    assert process is not None and process.stdin is not None
    process.stdin.close()
    assert process.wait(60) == 0


def test_no_process_starts_where_all_is_built(monkeypatch: pytest.MonkeyPatch):
    cache_path(SMALL, 1).parent.mkdir(parents=True)
    cache_path(SMALL, 1).write_bytes(b"")
    monkeypatch.setattr(build_ahead.subprocess, "Popen", None)
    builder = BackgroundBuilder([(SMALL, 1)])
    builder.wait((SMALL, 1))
    assert builder.missing == 0
    builder.close()
