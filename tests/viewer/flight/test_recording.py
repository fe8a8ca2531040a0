"""Tests of the file of a flight, and of the table of those that ended."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.env import handmade
from tests.viewer.flight.conftest import Fly
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import read_episodes
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.env import EnvConfig
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.flyers import Pilot
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import DUE, Folder, Recording, read_recording, write_recording
from thalweg.world import World


def pilot_flight(flight: Flight, steps: int = 10_000) -> Flight:
    pilot = Pilot("pilot")
    while not flight.ended and flight.steps < steps:
        flight.step(pilot.action(flight), "pilot")
    return flight


def test_a_flight_is_read_back_as_it_was(fly: Fly, tmp_path: Path):
    recording = Recording.of(pilot_flight(fly(seed=1, action="continuous", look="autumn"), 5))
    write_recording(tmp_path / "a.npz", recording)
    read = read_recording(tmp_path / "a.npz")
    for name, value in vars(recording).items():
        found = vars(read)[name]
        if isinstance(value, np.ndarray):
            assert np.array_equal(found, value) and found.dtype == value.dtype, name
        elif name != "ahead":  # NaN on a loop
            assert found == value, name


@pytest.mark.parametrize(
    ("closed", "task"), [(True, "River"), (False, "River"), (False, "Portage")], ids=["loop", "open", "station"]
)
def test_a_finished_flight_is_the_row_of_an_evaluation_from_the_same_start(closed: bool, task: str, tmp_path: Path):
    world = handmade.ring() if closed else handmade.canal(length_m=60.0)
    options = FlightOptions(level=world.name, seed=3, task=task)
    flight = pilot_flight(Flight(env_of(world, options), options))
    folder = Folder(tmp_path)
    folder.save(flight)
    course = Course(world, flight.poses[0][None], np.array(flight.times_s[:1]), np.zeros(1, np.int64))
    config = EvaluationConfig(env=EnvConfig(task=task, observation="none"))
    evaluated = evaluate(BASELINES["pilot"], course, Label("pilot", 3, world.name), config)
    (table,) = tmp_path.glob("*.csv")
    assert read_episodes(table) == evaluated
    assert (evaluated[0].ahead is None) == closed


def test_each_flight_has_a_name_of_its_own_and_a_row_if_it_ended(fly: Fly, tmp_path: Path):
    folder, flight = Folder(tmp_path / "new"), pilot_flight(fly(seed=1), 2)
    names = [folder.save(flight), folder.save(pilot_flight(flight)), folder.save(flight)]
    assert names == [f"Easy-River-pilot-00{number}" for number in (1, 2, 3)]
    assert sorted(folder.names()) == names
    assert [row.episode for row in read_episodes(folder.path / "episodes.csv")] == [0, 1]
    assert folder.read(names[0]).actions.shape == (2, 4)


def test_what_a_killed_server_was_writing_is_no_flight(fly: Fly, tmp_path: Path):
    name = Folder(tmp_path).save(pilot_flight(fly(seed=1), 2))
    (tmp_path / f".{name}.0123456789abcdef.part.npz").write_bytes(b"half")
    assert Folder(tmp_path).names() == [name]


def test_the_newest_flight_comes_first(tmp_path: Path):
    for name, seconds in (("b", 10), ("a", 30), ("d", 20), ("c", 20)):
        (tmp_path / f"{name}.npz").touch()
        os.utime(tmp_path / f"{name}.npz", (seconds, seconds))
    assert Folder(tmp_path).names() == ["a", "c", "d", "b"]


def test_tasks_and_vehicles_have_tables_of_their_own(fly: Fly, tmp_path: Path):
    flight = fly(task="Swimmers", seed=1)
    while not flight.ended:
        flight.step(np.array([0, 1, 1, 1]), "hand")
    Folder(tmp_path).save(flight)
    assert [path.name for path in tmp_path.glob("*.csv")] == ["episodes-Swimmers.csv"]


def names_in(folder: Path) -> list[str]:
    """The names of files without those of locks."""
    return sorted(path.name for path in folder.iterdir() if path.suffix != ".lock")


def test_a_table_that_cannot_be_read_is_left_and_the_flight_is_kept(
    fly: Fly, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    table, flight = tmp_path / "episodes.csv", pilot_flight(fly(seed=1))
    table.write_text("mine\n")
    name = Folder(tmp_path).save(flight)
    told = capsys.readouterr().err
    assert f"the flight {name} is saved in {tmp_path}, but has no row in episodes.csv yet: episodes.csv lacks" in told
    assert Folder(tmp_path).names() == [name] and table.read_text() == "mine\n"
    table.unlink()
    Folder(tmp_path).save(flight)
    assert [row.episode for row in read_episodes(table)] == [0, 1]
    assert names_in(tmp_path) == sorted(["episodes.csv", *(f"{each}.npz" for each in Folder(tmp_path).names())])


@pytest.mark.parametrize("number", range(5))
def test_a_server_that_is_killed_at_any_replacing_of_a_file_loses_neither_flight_nor_row(
    number: int, fly: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    class Killed(BaseException):
        """Stands for the end of the process: nothing is removed on its way."""

    def kill(old: Path, new: Path, left: list[int] = [number]) -> None:  # noqa: B006
        if not left[0]:
            monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)
            raise Killed
        left[0] -= 1
        replace_file(old, new)

    folder, flight, replace_file = Folder(tmp_path), pilot_flight(fly(seed=1)), os.replace
    folder.save(flight)
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", kill)
        if number < 4:
            with pytest.raises(Killed):
                folder.save(flight)
        else:
            folder.save(flight)
        monkeypatch.undo()
    folder.save(flight)
    rows = read_episodes(tmp_path / "episodes.csv")
    assert len(rows) == len(folder.names()) and [row.episode for row in rows] == list(range(len(rows)))
    assert len(rows) == (2 if number < 2 else 3)


def test_two_servers_never_take_the_same_name(fly: Fly, tmp_path: Path):
    recording = Recording.of(pilot_flight(fly(seed=1), 2))
    with Folder(tmp_path)._free_name(recording) as one, Folder(tmp_path)._free_name(recording) as other:
        assert one != other
    (tmp_path / f"{one}.npz").touch()
    with Folder(tmp_path)._free_name(recording) as third:
        assert third == other  # which has become free


def test_servers_that_save_at_once_lose_no_row(fly: Fly, tmp_path: Path):
    flight = pilot_flight(fly(seed=1))
    with ThreadPoolExecutor(4) as pool:
        names = list(pool.map(lambda _: Folder(tmp_path).save(flight), range(12)))
    assert len(set(names)) == 12
    assert [row.episode for row in read_episodes(tmp_path / "episodes.csv")] == list(range(12))


@pytest.mark.parametrize("content", ["", "algorithm,seed\n"])
def test_a_row_that_cannot_be_read_does_not_keep_others_from_the_table(content: str, fly: Fly, tmp_path: Path):
    folder = Folder(tmp_path)
    first = folder.save(pilot_flight(fly(seed=1)))
    table = next(path.name for path in tmp_path.glob("*.csv"))
    (tmp_path / f".{first}{DUE}{table}").write_text(content)
    folder.save(pilot_flight(fly(seed=1)))
    assert [row.episode for row in read_episodes(tmp_path / table)] == [0, 1]


def test_a_flight_without_a_step_is_not_saved(fly: Fly, tmp_path: Path):
    with pytest.raises(ViewerError, match="nothing has been flown yet"):
        Folder(tmp_path / "new").save(fly())
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/b", "", "missing"])
def test_only_flights_of_the_folder_are_read(name: str, tmp_path: Path):
    (tmp_path / "secret.npz").write_bytes(b"")
    (tmp_path / "in").mkdir()
    with pytest.raises(ViewerError, match="no flight"):
        Folder(tmp_path / "in").read(name)


def test_other_files_are_refused_by_name(tmp_path: Path):
    (tmp_path / "a.npz").write_bytes(b"no archive")
    np.savez(tmp_path / "b.npz", actions=np.zeros(3))
    np.savez(tmp_path / "c.npz", about=np.array({"format": 1}, dtype=object))  # a pickle, which is never loaded
    for name in ("a", "b", "c"):
        with pytest.raises(ViewerError, match=f"{name}.npz is not a recorded flight"):
            read_recording(tmp_path / f"{name}.npz")


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"actions": np.zeros((2, 3), np.int64)}, "actions is int64"),
        ({"poses": np.full((3, 4), np.nan)}, "poses has a number that is not finite"),
        ({"actions": np.zeros((2, 4))}, "actions are float64, but the flight's are multidiscrete"),
        ({"reason": 99}, "unknown reason 99"),
        ({"reason": 1.0}, "unknown reason 1.0"),
        ({"progress": 1.5}, "progress must be from 0 to 1, got 1.5"),
        ({"progress": float("nan")}, "progress must be from 0 to 1, got nan"),
        ({"ahead": 0.0}, "ahead must be above 0 and at most 1"),
        ({"rewards": np.zeros(2, complex)}, "rewards is complex128"),
        ({"pilots": "pilot"}, "pilots must be a list of names"),
        ({"cost_kinds": ("tight", 3)}, "cost_kinds must be a list of names"),
        ({"cost_kinds": ("tight",)}, "cost_kinds must begin with tight and loose, got tight"),
        ({"versions": {"RULES": "1"}}, "versions must be whole numbers by name"),
    ],
)
def test_impossible_contents_are_refused_by_name(change: dict, error: str, fly: Fly, tmp_path: Path):
    recording = Recording.of(pilot_flight(fly(), 2))
    write_recording(tmp_path / "a.npz", replace(recording, **change))
    with pytest.raises(ViewerError, match=error):
        read_recording(tmp_path / "a.npz")


def test_another_river_is_refused(fly: Fly, medium_world: World):
    with pytest.raises(ViewerError, match="in another river than Medium, seed 1"):
        Recording.of(pilot_flight(fly(), 1)).check_river(medium_world)
