"""Tests of data sets of Minari, which Minari itself reads."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium
import h5py
import minari
import numpy as np
import pytest

from tests.datasets.episodes import ABOUT, SIZE, assert_same, flight
from thalweg.datasets.draft import finished_flights
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.recordings import add_flight, read_recordings, recording

FLIGHTS = [flight(3), flight(5, seed=1, ended=False)]


@pytest.fixture
def written(tmp_path: Path) -> Path:
    with recording(tmp_path / "flights-v0", "minari", ABOUT) as writer:
        for episode in FLIGHTS:
            add_flight(writer, episode)
    return tmp_path / "flights-v0"


def test_minari_loads_the_data_set_by_its_name_with_all_layers_to_the_bit(
    written: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(written.parent))
    data = minari.load_dataset("flights-v0")
    assert (data.total_episodes, data.total_steps) == (2, 8)
    spaces = data.observation_space
    assert isinstance(spaces, gymnasium.spaces.Dict)
    assert {name: space.shape for name, space in spaces.items()} == {
        "rgb": (*SIZE, 3), "mask": SIZE, "depth": SIZE, "class": SIZE, "proprioception": (2,),
    }  # fmt: skip
    for found, wanted in zip(data.iterate_episodes(), FLIGHTS, strict=True):
        for name, values in {"rgb": wanted.rgb, "mask": wanted.mask, "depth": wanted.depth_m}.items():
            np.testing.assert_array_equal(found.observations[name], values)
        np.testing.assert_array_equal(found.actions, wanted.options)
        np.testing.assert_array_equal(found.rewards, wanted.rewards)
        np.testing.assert_array_equal(found.infos["costs"][1:], wanted.costs)
        np.testing.assert_allclose(found.infos["cost"], [0.0, *wanted.costs.sum(axis=1)])
        np.testing.assert_array_equal(found.infos["pose"], wanted.poses)
    assert [each["seed"] for each in data.storage.get_episode_metadata(range(2))] == [7, 8]
    first, second = data.iterate_episodes()
    assert first.terminations.tolist() == [False, False, True] and not first.truncations.any()
    assert second.truncations.tolist() == [False, False, False, False, True] and not second.terminations.any()
    assert first.infos["done_reason"].tolist() == [-1, -1, -1, 1]


def test_flights_are_read_as_they_were_recorded(written: Path):
    about, flights = read_recordings(written)
    assert about == ABOUT
    for found, wanted in zip(flights, FLIGHTS, strict=True):
        assert_same(found, wanted)


def test_masks_are_compressed(tmp_path: Path):
    still = replace(flight(9), mask=np.zeros((10, *SIZE), np.uint8))
    noisy = flight(9)
    sizes = []
    for name, episode in (("still", still), ("noisy", noisy)):
        with recording(tmp_path / name, "minari", ABOUT) as writer:
            add_flight(writer, episode)
        sizes.append((tmp_path / name / "data" / "main_data.hdf5").stat().st_size)
    assert sizes[0] < sizes[1]


def test_flights_of_other_actions_are_refused_and_those_before_them_are_kept(tmp_path: Path):
    with (
        pytest.raises(DatasetError, match="the same size of frames, layers and kind of actions"),
        recording(tmp_path / "mixed", "minari", ABOUT) as writer,
    ):
        add_flight(writer, flight(2))
        add_flight(writer, flight(2, discrete=False))
    assert [each["steps"] for each in finished_flights(tmp_path / "mixed")] == [2]


def test_a_data_set_of_others_is_refused(written: Path):
    meta = written / "data" / "metadata.json"
    told = json.loads(meta.read_text())
    del told["thalweg"]
    meta.write_text(json.dumps(told))
    with pytest.raises(DatasetError, match="was not recorded by Thalweg"):
        read_recordings(written)
    meta.write_text("{")
    with pytest.raises(DatasetError, match="cannot be read as a data set of Minari"):
        read_recordings(written)


def test_what_a_file_lacks_is_named(written: Path):
    with h5py.File(written / "data/main_data.hdf5", "a") as file:
        del file["episode_1/infos/pose"]
    with pytest.raises(DatasetError, match=r"main_data.hdf5 lacks 'pose'"):
        list(read_recordings(written)[1])
