"""Tests of the cache of built worlds: one folder per version, removed when it is unused."""

import os
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from llvmlite import binding

from tests.core.test_cache import refuse
from tests.world.lines import circle, course
from tests.world.store.test_npz import assert_same
from thalweg.core.cache import PACKAGE
from thalweg.world import LEVELS, World, WorldError, WorldFileError, load_or_build
from thalweg.world.store import world_cache as store

DAY_S = 86400.0


@pytest.fixture
def worlds(tmp_path, monkeypatch):
    """The folder of worlds of an empty cache, whose worlds are quick to build."""
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    monkeypatch.setattr(store, "build", lambda level, seed: small(seed))
    store.remove_stale_once.cache_clear()
    yield tmp_path / "worlds"
    store.remove_stale_once.cache_clear()


def small(seed: int) -> World:
    return World.from_centerline(course(circle(10.0, 24), 4.0), plants=False, seed=seed)


def never(*_):
    pytest.fail("built again")


def aged(path, days: float, now_s: float):
    then_s = now_s - days * DAY_S
    os.utime(path, (then_s, then_s))


def test_a_built_world_is_loaded_from_the_folder_of_this_version(worlds, monkeypatch):
    first = load_or_build("easy", 3)
    (path,) = (worlds / store.GENERATOR_HASH).iterdir()
    assert path.name.startswith("easy-3-")
    monkeypatch.setattr(store, "build", never)
    assert_same(load_or_build("Easy", 3), first)


@pytest.mark.slow
def test_a_cached_world_equals_the_built_one(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    first = load_or_build("Easy", 3)
    monkeypatch.setattr(store, "build", never)
    assert_same(load_or_build("Easy", 3), first)


def test_any_damaged_file_is_replaced(worlds):
    first = load_or_build("easy", 3)
    (path,) = (worlds / store.GENERATOR_HASH).iterdir()
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for place in [*rng.integers(len(whole) - 1700, len(whole), 12), 0, 8, len(whole) // 2]:
        data = bytearray(whole)
        data[place] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        assert_same(load_or_build("Easy", 3), first)
    path.write_bytes(whole[: len(whole) // 2])
    assert_same(load_or_build("Easy", 3), first)
    assert path.read_bytes() == whole


def test_an_unwritable_cache_still_gives_the_world(worlds):
    worlds.parent.mkdir(exist_ok=True)
    worlds.write_text("a file where the folder should be")
    assert_same(load_or_build("Easy", 3), small(3))


def test_a_cache_that_may_not_be_entered_still_gives_the_world(worlds, monkeypatch):
    first = load_or_build("Easy", 3)
    refuse(worlds, monkeypatch)
    assert_same(load_or_build("Easy", 3), first)


def test_levels_and_seeds_have_their_own_files(worlds):
    easy = LEVELS["Easy"]
    other = replace(easy, name="Easy +", length_m=281.0)
    paths = {store.cache_path(level, seed) for level in (easy, other) for seed in (1, 2)}
    assert len(paths) == 4
    assert {path.parent for path in paths} == {worlds / store.GENERATOR_HASH}
    assert store.cache_path(replace(easy, name="A .. b"), 10**40).name.startswith("a-b-100000000000-")
    assert len(store.cache_path(easy, 10**400).name) < 60


def test_the_generator_hash_covers_all_code_that_builds_a_world():
    world = PACKAGE / "world"
    modules = {path for path in world.rglob("*.py") if path.name != "__init__.py"}
    compilers = {PACKAGE / "core" / "compute" / name for name in ("jit.py", "kernel_compiler.py")}
    assert set(store.SOURCES) == modules - {world / "map_image.py"} | compilers


def test_another_width_of_vectors_changes_the_generator_hash(monkeypatch):
    hashes = set()
    for bits in ("256", "512"):
        monkeypatch.setenv("THALWEG_VECTOR_BITS", bits)
        hashes.add(store.generator_hash())
    assert len(hashes) == 2


def test_another_kind_of_machine_changes_the_generator_hash(monkeypatch):
    monkeypatch.setattr(binding, "get_host_cpu_name", lambda: "another")
    assert store.generator_hash() != store.GENERATOR_HASH


def test_the_worlds_that_were_not_used_for_longest_make_room(worlds, monkeypatch):
    now = time.time()
    load_or_build("easy", 0)
    (first,) = (worlds / store.GENERATOR_HASH).iterdir()
    load_or_build("easy", 1)
    monkeypatch.setattr(store, "MOST_BYTES", 2.5 * first.stat().st_size)
    for path in (worlds / store.GENERATOR_HASH).iterdir():
        aged(path, 2 if path == first else 1, now)
    load_or_build("easy", 0)  # used just now
    load_or_build("easy", 2)
    kept = sorted(path.name.split("-")[1] for path in (worlds / store.GENERATOR_HASH).iterdir())
    assert kept == ["0", "2"]


def test_a_world_that_cannot_be_read_for_lack_of_memory_is_not_removed(worlds, monkeypatch):
    load_or_build("easy", 3)
    (path,) = (worlds / store.GENERATOR_HASH).iterdir()

    def lacking(_: Path) -> World:
        raise WorldFileError("not a complete .npz file (Unable to allocate)")

    def building(*_: Any) -> World:
        assert path.is_file()
        return small(3)

    monkeypatch.setattr(World, "load", lacking)
    monkeypatch.setattr(store, "build", building)
    assert_same(load_or_build("Easy", 3), small(3))
    assert path.is_file()


def test_another_library_version_changes_the_generator_hash(monkeypatch):
    monkeypatch.setattr(store, "version", lambda name: "0.0" if name == "numba" else version(name))
    assert store.generator_hash() != store.GENERATOR_HASH
    monkeypatch.undo()
    assert store.generator_hash() == store.GENERATOR_HASH


def test_the_first_write_removes_versions_unused_for_two_weeks(worlds):
    now = time.time()
    for name, days in (("0" * 16, 15), ("1" * 16, 13), ("2" * 16, 15), ("mine", 99)):
        (worlds / name).mkdir(parents=True)
        (worlds / name / "easy-1-abc.npz").write_bytes(b"old")
        if name == "2" * 16:
            (worlds / name / "notes.txt").write_text("somebody's own")
        aged(worlds / name, days, now)
    load_or_build("Easy", 3)
    left = {path.relative_to(worlds).as_posix() for path in worlds.rglob("*") if path.is_file()}
    others = {name for name in left if not name.startswith(store.GENERATOR_HASH)}
    assert others == {f"{'1' * 16}/easy-1-abc.npz", f"{'2' * 16}/notes.txt", "mine/easy-1-abc.npz"} != left
    assert not (worlds / ("0" * 16)).exists()
    (worlds / ("0" * 16)).mkdir()
    aged(worlds / ("0" * 16), 15, now)
    load_or_build("Easy", 4)
    assert (worlds / ("0" * 16)).exists()  # Only the first write of a process looks.


def test_the_folder_of_this_version_stays_and_use_renews_its_age(worlds):
    load_or_build("Easy", 3)
    mine = worlds / store.GENERATOR_HASH
    aged(mine, 30, time.time())
    store.remove_stale(worlds, time.time())
    assert len(list(mine.iterdir())) == 1
    load_or_build("Easy", 3)
    assert time.time() - mine.stat().st_mtime < 60


def test_only_old_temporary_files_are_removed(worlds):
    mine = worlds / store.GENERATOR_HASH
    mine.mkdir(parents=True)
    now = time.time()
    old, young = (f".{letter}.{16 * '0'}.part.npz" for letter in "ab")
    for name, days in ((old, 2.0), (young, 0.5)):
        (mine / name).write_bytes(b"half")
        aged(mine / name, days, now)
    store.remove_stale(worlds, now)
    assert [path.name for path in mine.iterdir()] == [young]


def test_an_unknown_level_is_refused():
    with pytest.raises(WorldError, match="unknown level 'Swamp'; known: Easy, Medium, Hard"):
        load_or_build("Swamp", 1)
