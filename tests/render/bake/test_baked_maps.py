"""Tests of the maps that are kept on the disk: read as they were baked, never for another world, and not too many."""

import os
from dataclasses import replace

import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.render.bake import baked_maps
from thalweg.world import World

SUN = np.array([0.6, 0.0, 0.8])
TOP = np.zeros((4, 4), np.float32)


def maps(scale: int) -> baked_maps.BakedMaps:
    """Small maps with values of their own."""
    cone = np.arange(12, dtype=np.float32).reshape(2, 3, 2) * scale
    codes = np.arange(6, dtype=np.uint32).reshape(2, 3) * np.uint32(scale)
    return baked_maps.BakedMaps(cone, codes, codes + np.uint32(1), codes.ravel())


@pytest.fixture
def world() -> World:
    return plane(plants=plants_at([(0.0, 0.0)], 3))


@pytest.fixture
def baked(tmp_path, monkeypatch) -> list[World]:
    """The worlds that were baked so far, into an empty cache folder."""
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    worlds = []

    def bake(world: World, sun: np.ndarray, top_m: np.ndarray, lit: np.ndarray) -> baked_maps.BakedMaps:
        worlds.append(world)
        return maps(len(worlds))

    monkeypatch.setattr(baked_maps, "bake", bake)
    return worlds


def assert_equal(found: baked_maps.BakedMaps, expected: baked_maps.BakedMaps) -> None:
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def test_maps_are_baked_once_for_a_world_and_read_back_for_an_equal_one(world, baked, tmp_path):
    lit = np.ones((4, 4, 3))
    assert_equal(baked_maps.baked_maps(world, SUN, TOP, lit), maps(1))
    assert_equal(baked_maps.baked_maps(plane(plants=plants_at([(0.0, 0.0)], 3)), SUN, TOP, lit), maps(1))
    assert_equal(baked_maps.baked_maps(replace(world, seed=world.seed + 1), SUN, TOP, lit), maps(2))
    assert len(baked) == 2
    assert len(list((tmp_path / "baked").iterdir())) == 2


def test_what_maps_are_baked_from_is_part_of_their_name(world, baked):
    lit = np.ones((4, 4, 3))
    for arguments in ((SUN, TOP, lit), (SUN * 0.5, TOP, lit), (SUN, TOP + 1, lit), (SUN, TOP, lit * 2)):
        baked_maps.baked_maps(world, *arguments)
    assert len(baked) == 4
    baked_maps.baked_maps(world, SUN, TOP + 1, lit)
    assert len(baked) == 4


@pytest.mark.parametrize("damage", ["half", "nothing", "other bytes", "one byte", "unknown compression"])
def test_a_damaged_file_is_replaced(world, baked, tmp_path, damage):
    lit = np.ones((4, 4, 3))
    baked_maps.baked_maps(world, SUN, TOP, lit)
    (file,) = (tmp_path / "baked").iterdir()
    whole = bytearray(file.read_bytes())
    at = bytes(whole).index(np.float32(7.0).tobytes())
    flipped = whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :]
    method = bytes(whole).index(b"PK\x01\x02") + 10  # of the first member, in the central directory
    packed = whole[:method] + b"\x63" + whole[method + 1 :]
    damaged = {"half": whole[: len(whole) // 2], "nothing": b"", "other bytes": b"x", "one byte": flipped}
    file.write_bytes({**damaged, "unknown compression": packed}[damage])
    assert_equal(baked_maps.baked_maps(world, SUN, TOP, lit), maps(2))
    assert_equal(baked_maps.baked_maps(world, SUN, TOP, lit), maps(2))


def test_the_files_that_were_not_used_for_longest_are_removed(world, baked, tmp_path, monkeypatch):
    lit = np.ones((4, 4, 3))
    seeds = [replace(world, seed=seed) for seed in range(4)]
    for age, one in zip((30, 20, 10), seeds[:3], strict=True):
        before = set((tmp_path / "baked").glob("*"))
        baked_maps.baked_maps(one, SUN, TOP, lit)
        (file,) = set((tmp_path / "baked").glob("*")) - before
        os.utime(file, (1e9 - age, 1e9 - age))
        monkeypatch.setattr(baked_maps, "MOST_BYTES", 3.5 * file.stat().st_size)
    baked_maps.baked_maps(seeds[0], SUN, TOP, lit)  # Used just now.
    baked_maps.baked_maps(seeds[3], SUN, TOP, lit)
    assert len(list((tmp_path / "baked").iterdir())) == 3
    for one in (seeds[0], seeds[2], seeds[3]):
        baked_maps.baked_maps(one, SUN, TOP, lit)
    assert len(baked) == 4
    baked_maps.baked_maps(seeds[1], SUN, TOP, lit)
    assert len(baked) == 5


def test_a_folder_that_cannot_be_written_costs_time_and_not_the_maps(world, baked, tmp_path):
    (tmp_path / "baked").write_text("a file, so that there can be no folder")
    lit = np.ones((4, 4, 3))
    assert_equal(baked_maps.baked_maps(world, SUN, TOP, lit), maps(1))
    assert_equal(baked_maps.baked_maps(world, SUN, TOP, lit), maps(2))


def test_maps_that_other_code_or_another_numpy_baked_are_not_read(world, baked, tmp_path, monkeypatch):
    lit = np.ones((4, 4, 3))
    for code, library in (("a", "1"), ("b", "1"), ("a", "2"), ("a", "1")):
        monkeypatch.setattr(baked_maps, "kernel_cache_dir", lambda code=code: tmp_path / code)
        monkeypatch.setattr(np, "__version__", library)
        baked_maps.baked_maps(world, SUN, TOP, lit)
    assert len(baked) == 3
