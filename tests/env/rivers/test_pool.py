"""Tests of the rivers in memory: which are loaded, when, and how many at a time."""

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.env.handmade import canal, hairpin, ring
from thalweg.env import ConfigError, EnvConfig
from thalweg.env.rivers import pool as pool_module
from thalweg.env.rivers.courses import join_courses
from thalweg.env.rivers.memory import check_all_fit, drawn_bytes, slots_in_memory
from thalweg.env.rivers.pool import RiverPool
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.course_arrays import pack_courses
from thalweg.render.bake.scene_slots import SceneSlots
from thalweg.world import LEVELS, World, load_or_build

ROOT = Path(__file__).resolve().parents[3]
CONFIG = EnvConfig(observation="none")
BRIDGE = [(0.0, 5.0, 0.0, 8.0, 2.0, 6.0, 0.5, 2.0, 4.0, 0.2, 1.0)]


def different(count: int) -> list[World]:
    """Rings of different sizes."""
    return [ring(10.0 + index, 40 + index) for index in range(count)]


def test_joined_courses_equal_those_packed_together():
    worlds = [ring(bridges=BRIDGE * 2), canal(islands=[(5.0, 0.0, 2.0, 1.0, 0.1)]), hairpin(bridges=BRIDGE)]
    joined = join_courses([pack_courses([world], CONFIG) for world in worlds])
    for name, expected in pack_courses(worlds, CONFIG)._asdict().items():
        found = getattr(joined, name)
        assert np.array_equal(found, expected), name
        assert found.dtype == expected.dtype and found.flags.c_contiguous


def test_a_river_is_in_its_slot_until_it_is_given_back():
    pool = RiverPool(RiverList(different(9), in_memory=6), CONFIG, 2)
    assert pool.slots == 4
    held = [pool.take(river) for river in (7, 3, 5)]
    for river in (1, 2, 4, 6, 8):
        pool.leave(pool.take(river))
    assert [pool.river[slot] for slot in held] == [7, 3, 5]
    assert [int(pool.courses.segments[slot]) for slot in held] == [47, 43, 45]


def test_rivers_that_all_fit_are_prepared_in_several_threads(monkeypatch: pytest.MonkeyPatch):
    pool = RiverPool(RiverList(different(9)), CONFIG, 2)
    prepare, lock, together = RiverPool._prepare, threading.Lock(), threading.Event()
    running, most = 0, 0

    def noted(self: RiverPool, river: int):
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
            if running == 3:
                together.set()
        together.wait(10.0)  # until three are prepared at the same time
        time.sleep(0.02)  # so that a fourth one would be among them
        prepared = prepare(self, river)
        with lock:
            running -= 1
        return prepared

    monkeypatch.setattr(RiverPool, "_prepare", noted)
    monkeypatch.setattr(pool_module, "get_num_threads", lambda: 3)
    wanted = [4, 0, 8, 4, 2, 1, 7, 3]
    slots = list(pool.take_all(wanted))
    assert [pool.river[slot] for slot in slots] == wanted
    assert [int(pool.courses.segments[slot]) for slot in slots] == [40 + river for river in wanted]
    assert most == 3
    assert pool._uses[slots[0]] == 2


def test_a_river_of_several_environments_is_prepared_once(monkeypatch: pytest.MonkeyPatch):
    pool = RiverPool(RiverList(different(9)), CONFIG, 2)
    prepare, prepared = RiverPool._prepare, []
    monkeypatch.setattr(RiverPool, "_prepare", lambda own, river: prepared.append(river) or prepare(own, river))
    monkeypatch.setattr(pool_module, "get_num_threads", lambda: 3)
    slots = list(pool.take_all([4, 2, 4, 4, 2, 1, 4, 1, 4]))
    assert [pool.river[slot] for slot in slots] == [4, 2, 4, 4, 2, 1, 4, 1, 4]
    assert sorted(prepared) == [1, 2, 4]


def test_of_more_rivers_than_fit_one_is_prepared_at_a_time():
    pool = RiverPool(RiverList(different(9), in_memory=6), CONFIG, 2)
    for slot, river in zip(pool.take_all([1, 5, 3, 8, 7, 2]), [1, 5, 3, 8, 7, 2], strict=True):
        assert pool.river[slot] == river
        pool.leave(slot)
    assert pool.most_loaded <= 6


def test_the_river_that_was_not_used_for_longest_makes_room():
    pool = RiverPool(RiverList(different(9), in_memory=6), CONFIG, 2)
    for river in (1, 2, 3, 1, 4):
        pool.leave(pool.take(river))
    assert set(pool.river) == {1, 2, 3, 4}
    pool.leave(pool.take(5))
    assert set(pool.river) == {1, 3, 4, 5}


def test_a_river_that_is_expected_stays_longer():
    pool = RiverPool(RiverList(different(9), in_memory=6), CONFIG, 2)
    for river in (1, 2, 3, 4):
        pool.leave(pool.take(river))
    pool.expect([1])
    pool.leave(pool.take(5))
    assert set(pool.river) == {1, 3, 4, 5}


class Levels(RiverList):
    """Rivers of five levels, whose rings are the larger the higher the level."""

    def __init__(self, in_memory: int | None = None) -> None:
        super().__init__([(replace(LEVELS["Easy"], name=str(index % 5)), index) for index in range(15)], in_memory)

    def course(self, index: int) -> World:
        return different(5)[index % 5]


def test_the_memory_of_a_slot_is_that_of_the_largest_level():
    pool = RiverPool(Levels(), CONFIG, 2)
    assert pool.river == [0, 1, 2, 3, 4]
    assert pool.bytes_each == sum(array.nbytes for array in pack_courses([different(5)[4]], CONFIG))


def test_first_rivers_of_levels_that_do_not_fit_are_left_for_later():
    assert RiverPool(Levels(in_memory=6), CONFIG, 2).river == [0, 1, 2, 3]


def test_of_given_worlds_one_is_prepared_at_once():
    assert RiverPool(RiverList(different(9)), CONFIG, 2).river == [0]


class Gate(RiverList):
    """Rivers of which one is not ready until it is let through."""

    def __init__(self, count: int, shut: int) -> None:
        super().__init__(different(count), in_memory=6)
        self.shut, self.gate, self.reached = shut, threading.Event(), threading.Event()
        self.asked: list[int] = []

    def course(self, index: int) -> World:
        self.asked.append(index)
        if index == self.shut and threading.current_thread() is not threading.main_thread():
            self.reached.set()
            assert self.gate.wait(30)
        return super().course(index)


def test_a_river_that_waits_behind_another_is_prepared_by_who_needs_it():
    rivers = Gate(9, shut=3)
    pool = RiverPool(rivers, CONFIG, 2)
    pool.expect([3])
    assert rivers.reached.wait(30)
    pool.expect([3, 4])
    assert pool.river[pool.take(4)] == 4
    rivers.gate.set()
    assert pool.river[pool.take(3)] == 3
    assert sorted(rivers.asked) == [0, 3, 4]
    pool.close()


def test_an_expected_river_is_prepared_once_and_never_more_than_the_limit_are_in_memory():
    rivers = Gate(9, shut=-1)
    pool = RiverPool(rivers, CONFIG, 2)
    rng = np.random.default_rng(0)
    for _ in range(60):
        following = rng.integers(9, size=2)
        pool.expect(following)
        for slot in [pool.take(int(river)) for river in following]:
            pool.leave(slot)
    assert 4 < pool.most_loaded <= 6
    pool.close()


def test_rivers_that_are_no_longer_expected_do_not_stay_in_memory():
    pool = RiverPool(Gate(9, shut=-1), CONFIG, 2)
    for following in ([3, 4], [5, 6], [7, 8]):
        pool.expect(following)
        assert pool.loaded == 3
    pool.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_waits_for_none_of_its_parents_threads():
    rivers = Gate(9, shut=3)
    pool = RiverPool(rivers, CONFIG, 2)
    pool.expect([3])
    assert rivers.reached.wait(30)
    child = os.fork()
    if child == 0:
        os._exit(0 if pool.river[pool.take(3)] == 3 else 1)
    until = time.monotonic() + 30
    ended, status = os.waitpid(child, os.WNOHANG)
    while not ended and time.monotonic() < until:
        time.sleep(0.01)
        ended, status = os.waitpid(child, os.WNOHANG)
    if not ended:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    rivers.gate.set()
    pool.close()
    assert (ended, status) == (child, 0)


def test_python_ends_without_what_nobody_waits_for_any_more():
    script = """
import time
from tests.env.rivers.test_pool import CONFIG, RiverPool, Gate
rivers = Gate(9, shut=3)
pool = RiverPool(rivers, CONFIG, 2)
pool.expect([3, 4])
assert rivers.reached.wait(30)
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=25, cwd=ROOT)


class Broken(RiverList):
    def course(self, index: int) -> World:
        if index:
            raise OSError(f"river {index} is broken")
        return super().course(index)


def test_an_error_of_a_river_is_raised_where_it_is_needed():
    pool = RiverPool(Broken(different(9), in_memory=6), CONFIG, 2)
    pool.expect([5])
    with pytest.raises(OSError, match="river 5 is broken"):
        pool.take(5)
    pool.close()


def test_a_river_that_an_error_left_half_placed_is_placed_again(monkeypatch: pytest.MonkeyPatch):
    pool = RiverPool(RiverList(different(12), in_memory=6), CONFIG, 2)
    for river in range(6):
        pool.leave(pool.take(river))

    def stopped(_: object):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(pool_module, "join_courses", stopped)
        pool.take(9)
    slot = pool.take(9)
    assert pool.courses.segments[slot] == pool.part(slot).segments[0] == 49
    pool.close()


def test_a_pool_that_is_dropped_after_an_error_in_the_background_is_freed():
    pool = RiverPool(Broken(different(9), in_memory=6), CONFIG, 2)
    pool.expect([5])
    assert pool._worker is not None
    thread, kept = pool._worker._thread, weakref.ref(pool)
    assert isinstance(pool._coming[5].exception(30), OSError)
    del pool
    until = time.monotonic() + 30
    while thread.is_alive() and time.monotonic() < until:
        gc.collect()
        time.sleep(0.01)
    gc.collect()
    assert not thread.is_alive() and kept() is None


@pytest.mark.parametrize(
    ("rivers", "in_memory", "num_envs", "free", "slots"),
    [
        (16, None, 4, 2 * 16 * 10, 16),
        (16, None, 4, 2 * 15 * 10, 11),
        (16, None, 5, None, 16),
        (16, 16, 16, 160, 16),
        (16, 20, 16, 160, 16),
        (1000, 12, 4, 10_000, 8),
    ],
)
def test_all_rivers_are_in_memory_if_they_fit(rivers, in_memory, num_envs, free, slots):
    assert slots_in_memory(rivers, in_memory, num_envs, 10, free) == slots


@pytest.mark.parametrize(
    ("in_memory", "free", "message"),
    [
        (None, 2 * 110, r"at most 11 rivers fit, enough for 3 environments, or for lists of at most 11 rivers"),
        (11, 10_000, r"in_memory must be at least 12 for 100 rivers and 4 environments, not 11"),
        (50, 400, r"in_memory = 50 rivers .* at most 40 fit"),
    ],
)
def test_too_many_rivers_are_refused_with_the_number_that_fits(in_memory, free, message):
    with pytest.raises(ConfigError, match=message):
        slots_in_memory(100, in_memory, 4, 10, free)


def test_rivers_of_which_none_may_be_left_out_are_refused_with_the_number_that_fits():
    check_all_fit(7, 10, 2 * 70)
    check_all_fit(7, 10, None)
    with pytest.raises(ConfigError, match=r"8 rivers of 0.0 MB need .* 0.00 GB of memory are free.* at most 7 fit"):
        check_all_fit(8, 10, 2 * 79)


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_a_world_that_is_drawn_takes_its_own_bytes_and_those_of_its_tables(level: str):
    world = load_or_build(LEVELS[level], LEVELS[level].default_seed)
    assert drawn_bytes(world) == pytest.approx(len(pickle.dumps(world)) + SceneSlots().bake(world).nbytes, rel=0.1)
