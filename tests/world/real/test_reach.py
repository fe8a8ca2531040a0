"""Tests that a reach is identified by the content and the options of its file, not by its folder."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.world.real.geojson_files import EAST, feature, written
from thalweg.world import Reach, World, WorldFileError

LINE = '{"type": "LineString", "coordinates": [[9, 48], [9.0004, 48], [9.0008, 48], [9.0012, 48]]}'


@pytest.fixture
def brook(tmp_path: Path) -> Reach:
    path = tmp_path / "brook.geojson"
    path.write_text(LINE)
    return Reach(path, width_m=6.0, start_m=10.0, length_m=60.0, smooth_m=4.0)


@pytest.mark.slow
def test_a_reach_is_built_as_its_file_is_read(brook: Reach):
    built = brook.build(3)
    given = World.from_file(brook.path, width_m=6.0, start_m=10.0, length_m=60.0, smooth_m=4.0, seed=3)
    assert (brook.name, built.name, built.seed) == ("brook.geojson", "brook", 3)
    for name in ("ground_m", "albedo", "sun"):
        np.testing.assert_array_equal(getattr(built, name), getattr(given, name))


def test_a_reach_is_identified_by_file_name_and_content_not_by_folder(brook: Reach, tmp_path: Path):
    elsewhere = tmp_path / "elsewhere" / "brook.geojson"
    elsewhere.parent.mkdir()
    elsewhere.write_text(LINE)
    data = brook.as_data()
    assert replace(brook, path=elsewhere).as_data() == data
    assert {**data, "content": 0} == {
        "file": "brook.geojson",
        "content": 0,
        "width_m": 6.0,
        "start_m": 10.0,
        "length_m": 60.0,
        "smooth_m": 4.0,
    }
    assert data["content"] == "aab8b3032b572d80"
    elsewhere.write_text(LINE.replace("48]", "48.0]", 1))
    assert replace(brook, path=elsewhere).as_data()["content"] != data["content"]


def test_a_reach_of_a_missing_file_is_refused(tmp_path: Path):
    with pytest.raises(WorldFileError, match=r"none.geojson: there is no such file$"):
        Reach(tmp_path / "none.geojson").as_data()


def test_a_world_is_built_once_and_then_loaded_from_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path / "cache"))
    path = written(tmp_path, feature([[11.0, 48.0], [11.0003, 48.0], [11.0006, 48.0], [11.0009, 48.0]]))
    reach = Reach(path)
    assert not reach.is_cached(5)
    built = reach.build(5)
    assert reach.is_cached(5)
    assert not reach.is_cached(6)
    assert not Reach(path, reverse=True).is_cached(5)
    monkeypatch.setattr("thalweg.world.real.reach.from_file", None)
    loaded = reach.build(5)
    np.testing.assert_array_equal(loaded.ground_m, built.ground_m)
    assert (loaded.name, loaded.seed) == (built.name, built.seed)
    path.write_text(path.read_text() + " ")
    assert not reach.is_cached(5)


def test_options_that_are_as_by_default_leave_no_trace_in_the_data_of_a_run(tmp_path):
    path = written(tmp_path, feature(EAST))
    assert list(Reach(path).as_data()) == ["file", "content", "width_m", "start_m", "length_m", "smooth_m"]
    assert Reach(path, reverse=True, crs="EPSG:4326").as_data()["crs"] == "EPSG:4326"
    assert Reach(path, reverse=True).as_data()["reverse"] is True
