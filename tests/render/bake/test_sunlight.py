"""Tests of worlds under other suns: lit once for each sun, and read back as they were lit."""

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.render.plain import plane, plants_at
from thalweg.render.bake import sunlight
from thalweg.render.bake.array_files import digest_of
from thalweg.world import World
from thalweg.world.record import Plants

SUN = 1.0, 0.6


@pytest.fixture
def world() -> World:
    return plane(plants=plants_at([(0.0, 0.0), (4.0, 3.0)], 3))


@pytest.fixture
def lit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[float, float]]]:
    """The suns under which worlds were lit so far, into an empty cache folder."""
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    suns: list[tuple[float, float]] = []
    relit = World.relit

    def counted(world: World, azimuth: float, elevation: float) -> World:
        suns.append((azimuth, elevation))
        return relit(world, azimuth, elevation)

    monkeypatch.setattr(World, "relit", counted)
    yield suns


def assert_equal(found: World, expected: World) -> None:
    """Compare all fields, arrays with their types."""
    assert digest_of(found) == digest_of(expected)
    assert found.sun.dtype == expected.sun.dtype
    assert found.plants.light.dtype == expected.plants.light.dtype


def test_a_world_is_lit_once_for_each_sun_and_is_the_same_when_read_back(world: World, lit: list):
    first = sunlight.relit(world, *SUN)
    again = sunlight.relit(replace(world, seed=world.seed + 1), *SUN)
    assert lit == [SUN]
    assert_equal(first, world.relit(*SUN))
    assert_equal(again, replace(first, seed=world.seed + 1))
    assert not np.array_equal(first.sun, world.relit(SUN[0] + 2.0, SUN[1]).sun)


def test_another_sun_is_other_light(world: World, lit: list):
    for sun in (SUN, (1.5, 0.6), (1.0, 0.9)):
        assert_equal(sunlight.relit(world, *sun), world.relit(*sun))
    assert lit[::2] == [SUN, (1.5, 0.6), (1.0, 0.9)]  # every second one is the comparison's


def test_whatever_light_falls_on_is_part_of_the_name(world: World, lit: list):
    lower = replace(world, ground_m=world.ground_m - np.float32(1.0))
    wet = replace(world, water_m=world.water_m + np.float32(1.0))
    crowns = {field.name: getattr(world.plants, field.name) for field in fields(Plants)}
    taller = replace(world, plants=Plants(**crowns | {"height_m": world.plants.height_m * np.float32(2.0)}))
    coarser = replace(world, grid=replace(world.grid, cell_m=2.0 * world.grid.cell_m))
    bridged = replace(world, bridges=np.array([[0.0, 0.0, 0.0, 12.0, 3.0, 8.0, 0.0, 2.0, 3.0, 0.3, 0.9]]))
    for other in (world, lower, wet, taller, coarser, bridged):
        sunlight.relit(other, *SUN)
    assert len(lit) == 6


def test_light_of_another_version_is_not_read(world: World, lit: list, monkeypatch: pytest.MonkeyPatch):
    for version in ("a" * 16, "b" * 16, "a" * 16):
        monkeypatch.setattr(sunlight, "GENERATOR_HASH", version)
        sunlight.relit(world, *SUN)
    assert len(lit) == 2


def test_a_damaged_file_is_replaced(world: World, lit: list, tmp_path: Path):
    first = sunlight.relit(world, *SUN)
    (file,) = (tmp_path / "sunlight").iterdir()
    file.write_bytes(file.read_bytes()[:-40])
    assert_equal(sunlight.relit(world, *SUN), first)
    assert_equal(sunlight.relit(world, *SUN), first)
    assert len(lit) == 2


def test_a_folder_that_takes_no_files_costs_time_alone(world: World, lit: list, tmp_path: Path):
    (tmp_path / "sunlight").write_text("not a folder")
    assert_equal(sunlight.relit(world, *SUN), sunlight.relit(world, *SUN))
    assert len(lit) == 2


@pytest.mark.parametrize("elevation", [0.0, math.radians(4.9), 2.0])
def test_a_sun_too_low_or_beyond_the_zenith_is_refused(world: World, lit: list, elevation: float, tmp_path: Path):
    with pytest.raises(ValueError, match="the sun must stand 5 to 90 degrees high"):
        sunlight.relit(world, 1.0, elevation)
    assert not (tmp_path / "sunlight").exists()
