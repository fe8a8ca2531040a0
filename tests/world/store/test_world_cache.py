"""Built worlds are kept by the version that made them, and go when nobody uses them."""

import os
import time
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest

from tests.world.lines import circle, course
from tests.world.store.test_npz import assert_same
from thalweg.core.cache import PACKAGE
from thalweg.world import LEVELS, World, WorldError, load_or_build
from thalweg.world.store import world_cache as store

DAY_S = 86400.0


@pytest.fixture
def worlds(tmp_path, monkeypatch):
    """The folder of worlds of an empty cache, whose worlds are quick to build."""
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    monkeypatch.setattr(store, "build", lambda level, seed: small(seed))
    store.tidy_once.cache_clear()
    yield tmp_path / "worlds"
    store.tidy_once.cache_clear()


def small(seed: int) -> World:
    return World.from_centerline(course(circle(10.0, 24), 4.0), plants=False, seed=seed)


def never(*_):
    pytest.fail("built again")


def aged(path, days: float, now_s: float):
    then_s = now_s - days * DAY_S
    os.utime(path, (then_s, then_s))


def test_a_built_world_is_taken_from_the_folder_of_this_version(worlds, monkeypatch):
    first = load_or_build("easy", 3)
    (path,) = (worlds / store.STAMP).iterdir()
    assert path.name.startswith("easy-3-")
    monkeypatch.setattr(store, "build", never)
    assert_same(load_or_build("Easy", 3), first)


@pytest.mark.slow
def test_a_kept_world_is_the_built_one(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    first = load_or_build("Easy", 3)
    monkeypatch.setattr(store, "build", never)
    assert_same(load_or_build("Easy", 3), first)


def test_a_damaged_file_is_replaced_whatever_is_wrong_with_it(worlds):
    first = load_or_build("easy", 3)
    (path,) = (worlds / store.STAMP).iterdir()
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


def test_a_cache_that_cannot_be_written_to_costs_no_world(worlds):
    worlds.parent.mkdir(exist_ok=True)
    worlds.write_text("a file where the folder should be")
    assert_same(load_or_build("Easy", 3), small(3))


def test_levels_seeds_and_cases_lie_in_files_of_their_own(worlds):
    easy = LEVELS["Easy"]
    other = replace(easy, name="Easy +", length_m=281.0)
    paths = {store.place_of(level, seed) for level in (easy, other) for seed in (1, 2)}
    assert len(paths) == 4
    assert {path.parent for path in paths} == {worlds / store.STAMP}
    assert store.place_of(replace(easy, name="A .. b"), 10**40).name.startswith("a-b-100000000000-")
    assert len(store.place_of(easy, 10**400).name) < 60


def test_the_stamp_covers_all_code_that_makes_a_world():
    world = PACKAGE / "world"
    modules = {path for path in world.rglob("*.py") if path.name != "__init__.py"}
    assert set(store.SOURCES) == modules - {world / "map_image.py"} | {PACKAGE / "core" / "jit.py"}


def test_another_numpy_is_another_version(monkeypatch):
    monkeypatch.setattr(store, "version", lambda name: "0.0" if name == "numba" else version(name))
    assert store.stamp() != store.STAMP
    monkeypatch.undo()
    assert store.stamp() == store.STAMP


def test_the_first_write_removes_versions_that_nobody_used_for_a_fortnight(worlds):
    now = time.time()
    for name, days in (("0" * 16, 15), ("1" * 16, 13), ("2" * 16, 15), ("mine", 99)):
        (worlds / name).mkdir(parents=True)
        (worlds / name / "easy-1-abc.npz").write_bytes(b"old")
        if name == "2" * 16:
            (worlds / name / "notes.txt").write_text("somebody's own")
        aged(worlds / name, days, now)
    load_or_build("Easy", 3)
    left = sorted(str(path.relative_to(worlds)) for path in worlds.rglob("*") if path.is_file())
    assert left[:3] == [f"{'1' * 16}/easy-1-abc.npz", f"{'2' * 16}/notes.txt", left[2]]
    assert not (worlds / ("0" * 16)).exists()
    assert "mine/easy-1-abc.npz" in left
    (worlds / ("0" * 16)).mkdir()
    aged(worlds / ("0" * 16), 15, now)
    load_or_build("Easy", 4)
    assert (worlds / ("0" * 16)).exists()  # Only the first write of a process looks.


def test_the_folder_of_this_version_stays_and_use_keeps_a_folder_young(worlds):
    load_or_build("Easy", 3)
    mine = worlds / store.STAMP
    aged(mine, 30, time.time())
    store.tidy(worlds, time.time())
    assert len(list(mine.iterdir())) == 1
    load_or_build("Easy", 3)
    assert time.time() - mine.stat().st_mtime < 60


def test_old_drafts_go_and_young_ones_stay(worlds):
    mine = worlds / store.STAMP
    mine.mkdir(parents=True)
    now = time.time()
    for name, days in ((".a.00.part.npz", 2.0), (".b.00.part.npz", 0.5)):
        (mine / name).write_bytes(b"half")
        aged(mine / name, days, now)
    store.tidy(worlds, now)
    assert [path.name for path in mine.iterdir()] == [".b.00.part.npz"]


def test_an_unknown_level_is_refused():
    with pytest.raises(WorldError, match="unknown level 'Swamp'; known: Easy, Medium, Hard"):
        load_or_build("Swamp", 1)
