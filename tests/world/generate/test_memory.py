"""Tests that a world too large for the free memory is refused with its size before memory is allocated."""

import importlib
import json
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.world.lines import circle, course
from thalweg.world import LEVELS, World, WorldError, WorldFileError, build
from thalweg.world.generate import memory, terrain

LOOP = course(circle(195.0, 240))
"""Its map is 390 + 2 * 55 = 500 m wide: 2002 nodes a quarter of a metre apart, the last beyond the end."""


def free(monkeypatch: pytest.MonkeyPatch, value: int | None) -> None:
    monkeypatch.setattr(memory, "free_bytes", lambda: value)


def test_the_needed_memory_by_hand():
    assert memory.needed_bytes((1000, 3000), 0.25, 1.0) == 165 * 3_000_000 + 4000**2
    dense = 80 * 3_000_000 + 390 * 10 * 3_000_000 // 16
    assert memory.needed_bytes((1000, 3000), 0.25, 10.0) == dense + 4000**2
    assert memory.needed_bytes((100, 30_000), 0.25, 1.0) == 165 * 3_000_000 + 30_100**2


def test_a_line_too_large_for_memory_is_refused_with_its_size_before_allocation(monkeypatch):
    need = memory.needed_bytes((2002, 2002), 0.25, 0.0)
    free(monkeypatch, need - 1)
    importlib.import_module("thalweg.world.real.centerline")  # what the first call imports is no part of a world
    tracemalloc.start()
    try:
        with pytest.raises(WorldError) as caught:
            World.from_centerline(LOOP, plants=False)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()
    assert str(caught.value) == (
        "the map covers 500 x 500 m with 4.0 million nodes, 0.25 m apart; to build it takes 0.68 GB of memory, and "
        "0.68 GB are free"
    )


@pytest.mark.parametrize("known", [10**9, None])
def test_a_line_that_fits_passes_and_so_does_any_line_if_the_memory_is_unknown(monkeypatch, known):
    free(monkeypatch, known)
    memory.check_memory(LOOP[:, :2])


def test_a_level_too_dense_for_memory_is_refused_before_its_terrain(monkeypatch):
    free(monkeypatch, 150_000_000)
    monkeypatch.setattr(terrain.shore, "measure", lambda *_: pytest.fail("the terrain was begun"))
    dense = replace(LEVELS["Easy"], plant_density=10.0)
    with pytest.raises(WorldError, match=r"density 10; to build it takes 0\.2\d GB of memory, and 0\.15 GB are free"):
        build(dense, 0)
    with pytest.raises(pytest.fail.Exception, match="the terrain was begun"):
        build("Easy", 0)


def test_a_river_from_a_file_is_refused_with_its_name(monkeypatch, tmp_path: Path):
    free(monkeypatch, 50_000_000)
    path = tmp_path / "long.geojson"
    line = [[0.1 + k * 1e-4, 52.0] for k in range(100)]
    path.write_text(json.dumps({"type": "LineString", "coordinates": line}))
    with pytest.raises(WorldFileError, match=r"long\.geojson: the map covers \d+ x 110 m .* 0\.05 GB are free"):
        World.from_file(path, width_m=8.0, plants=False)


def test_available_memory_is_read_from_meminfo(tmp_path: Path):
    (tmp_path / "meminfo").write_text("MemTotal: 8000 kB\nMemFree: 100 kB\nMemAvailable:    3000 kB\n")
    assert memory.machine_bytes(tmp_path) == 3_072_000


def test_other_systems_use_the_total_memory_or_no_limit(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(memory.os, "sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 1000}.__getitem__, raising=False)
    assert memory.machine_bytes(tmp_path) == 4_096_000
    monkeypatch.delattr(memory.os, "sysconf")
    assert memory.machine_bytes(tmp_path) is None


def test_the_tightest_container_counts_without_its_file_cache(tmp_path: Path):
    groups, inner = tmp_path / "groups", tmp_path / "groups" / "a" / "b"
    inner.mkdir(parents=True)
    (tmp_path / "self").mkdir()
    (tmp_path / "self" / "cgroup").write_text("4:memory:/elsewhere\n0::/a/b\n")
    for place, limit, used, files in ((inner, "5000", 1000, 300), (inner.parent, "3000", 1500, 100)):
        (place / "memory.max").write_text(f"{limit}\n")
        (place / "memory.current").write_text(f"{used}\n")
        (place / "memory.stat").write_text(f"anon 7\ninactive_file {files}\n")
    assert memory.container_bytes(tmp_path, groups) == 3000 - 1500 + 100
    (inner.parent / "memory.max").write_text("max\n")
    assert memory.container_bytes(tmp_path, groups) == 5000 - 1000 + 300
    (inner / "memory.max").write_text("max\n")
    assert memory.container_bytes(tmp_path, groups) is None


@pytest.mark.slow
def test_the_bound_is_near_what_a_build_takes():
    line = np.stack([np.linspace(0, 900, 40), np.zeros(40)], axis=1)
    World.from_centerline(course(circle(20.0, 30)))  # what is computed once for all worlds
    tracemalloc.start()
    try:
        world = World.from_centerline(course(line), closed=False)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    rows, columns = world.ground_m.shape
    need = memory.needed_bytes((rows, columns), world.grid.cell_m, 1.0)
    assert 0.5 * need < peak < need
