"""Compiling: of the right types, in another process, so that worlds and frames are the same in all of them."""

import copy
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.render import Camera, Renderer, compilation
from thalweg.render.bake.scene_tables import build_scene
from thalweg.render.batch import draw_jobs
from thalweg.render.records.scene import Scene

FIRST_FRAMES = """
import hashlib
import numpy as np
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import build
world = build("Easy", 3)
frames = Renderer([world], Camera(64, 64)).render(sample_starts(world, 4, 0))
maps = (world.ground_m, world.water_m, world.albedo, world.sun, world.sky, world.canopy_m, world.plants.light)
print(*(hashlib.sha256(np.ascontiguousarray(a)).hexdigest() for a in (*maps, frames)))
"""


@pytest.mark.slow
def test_worlds_and_frames_are_the_same_in_the_process_that_compiles_and_in_later_ones(tmp_path: Path):
    environment = {**os.environ, "THALWEG_CACHE": str(tmp_path)}
    messages = [
        subprocess.run(
            [sys.executable, "-c", FIRST_FRAMES], env=environment, capture_output=True, text=True, check=True
        )
        for _ in range(2)
    ]
    assert len(messages[0].stdout.split()) == 8
    assert messages[0].stdout == messages[1].stdout
    assert "Warning" not in messages[0].stderr


def test_the_kernel_is_compiled_for_the_types_with_which_it_is_called():
    real = build_scene([plane(plants=plants_at([(0.0, 0.0)], 3))])
    blank = compilation.arguments()[0]
    types = {name: (numba.typeof(getattr(real, name)), numba.typeof(getattr(blank, name))) for name in Scene._fields}
    assert {name: found for name, found in types.items() if found[0] != found[1]} == {}


def test_a_copy_of_a_renderer_draws_with_the_kernel_that_is_compiled():
    pose = np.array([[0.0, 0.0, 2.0, 0.0]])
    one = Renderer([plane(plants=plants_at([(5.0, 0.0)], 3))], Camera(32, 32))
    frame, compiled = one.render(pose), len(draw_jobs.signatures)
    for twin in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        np.testing.assert_array_equal(twin.render(pose), frame)
    assert len(draw_jobs.signatures) == compiled


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("time_s", ["none", "number", "array"])
def test_poses_indices_and_times_of_any_memory_layout_reach_the_kernel_as_the_compiled_types(count: int, time_s: str):
    renderer = Renderer([plane()], Camera(32, 32))
    poses = np.asfortranarray(np.tile([0.0, 0.0, 2.0, 0.0], (count, 1)))
    index = np.zeros(2 * count, np.int32)[::2]
    poses.setflags(write=False)
    times = {"none": None, "number": 2.0, "array": np.full(count, 2.0)}[time_s]
    views = renderer._checked(poses, index, times, None)
    assert numba.typeof(views) == numba.typeof(compilation.arguments()[1])
    np.testing.assert_array_equal(views.times, np.full(count, 0.0 if time_s == "none" else 2.0))


def test_threads_that_draw_at_once_wait_for_one_process(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    slow, started = tmp_path / "python", tmp_path / "started"
    slow.write_text(f"#!/bin/sh\necho one >> {started}\nsleep 0.3\n")
    slow.chmod(0o755)
    monkeypatch.setattr(compilation, "_ready", False)
    monkeypatch.setattr(compilation, "_child", None)
    monkeypatch.setattr(compilation, "kernel_cache_dir", lambda: tmp_path)
    monkeypatch.setattr(sys, "executable", str(slow))
    with ThreadPoolExecutor(8) as threads:
        assert [*threads.map(lambda _: compilation.finish(), range(8))] == [None] * 8
    assert started.read_text() == "one\n" and compilation._child is None


def test_where_no_process_can_compile_a_warning_says_what_follows(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
):
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho no room left >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(compilation, "_ready", False)
    monkeypatch.setattr(compilation, "_child", None)
    monkeypatch.setattr(compilation, "kernel_cache_dir", lambda: tmp_path)
    monkeypatch.setattr(sys, "executable", str(broken))
    with pytest.warns(UserWarning, match=r"no room left.*this one compiles it"):
        compilation.finish()
    compilation.finish()
    printed_once = "thalweg: compiling kernels: first start only, 30 to 60 seconds\n"
    assert capsys.readouterr().err == printed_once
