"""Tests of `thalweg record` on the command line."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.calibration import LENS
from tests.image_policies import image_policy
from thalweg.cli.flown_files import flown_files
from thalweg.cli.main import main
from thalweg.cli.record import Record
from thalweg.cli.views import camera_from
from thalweg.core.config import to_plain
from thalweg.datasets import draft
from thalweg.datasets.recordings import read_recordings
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.render import Camera
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.observed import Observer
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.world import World


def test_flights_of_a_pilot_are_recorded_as_the_environment_has_them(
    tmp_path: Path, easy_world: World, capsys: pytest.CaptureFixture
):
    out = tmp_path / "flights"
    options = ["--level", "easy", "--episodes", "2", "--seed", "3", "--steps", "3", "--size", "32"]
    assert main(["record", "pilot", *options, "--out", str(out)]) == 0
    assert "2 flights, 6 steps (2 stopped) in the format of lerobot" in capsys.readouterr().out
    config = EnvConfig(observation=("rgb", "mask", "depth", "class", "proprioception"), camera=Camera(32, 32))
    env = RiverVectorEnv([easy_world], 1, config)
    about, flights = read_recordings(out)
    assert about.fps == 4 and about.camera["height_px"] == 32
    for seed, flight in zip((3, 4), flights, strict=True):
        seen, info = env.reset(seed=seed)
        for step in range(3):
            np.testing.assert_array_equal(flight.rgb[step], seen["rgb"][0])
            for name, layer in (("mask", flight.mask), ("depth", flight.depth_m), ("class", flight.class_id)):
                assert layer is not None
                np.testing.assert_array_equal(layer[step], seen[name][0, ..., 0], err_msg=name)
            np.testing.assert_array_equal(flight.proprioception[step], seen["proprioception"][0])
            np.testing.assert_array_equal(flight.poses[step], info["pose"][0])
            actions = env.pilot_actions()
            assert flight.options is not None
            np.testing.assert_array_equal(flight.options[step], actions[0])
            seen, reward, _, _, info = env.step(actions)
            assert flight.rewards[step] == np.float32(reward[0])
        assert not flight.terminated and flight.reason == -1 and set(flight.pilots) == {"pilot"}


def test_a_flight_that_was_saved_is_recorded_through_another_camera(tmp_path: Path, easy_world: World):
    options = FlightOptions(level="Easy", size_px=32, seed=3, look="autumn", action="continuous")
    flight = Flight(env_of(easy_world, options), options)
    flight.step(np.array([0.5, 0.0, 1.0, 0.0], np.float32), "hand")
    saved = tmp_path / f"{Folder(tmp_path).save(flight)}.npz"
    out = tmp_path / "flights"
    camera = ["--camera", "height_px=48", "width_px=64", "fov_deg=80", "pitch_deg=30", "--layers", "mask"]
    assert main(["record", str(saved), *camera, "--format", "minari", "--out", str(out)]) == 0
    about, flights = read_recordings(out)
    (found,) = flights
    assert (about.camera["fov_deg"], about.camera["pitch_deg"], about.layers) == (80.0, 30.0, ("mask",))
    assert found.size_px == (48, 64) and found.depth_m is None and found.options is None
    assert found.moves.tolist() == [[0.5, 0.0, 1.0, 0.0]]
    assert found.options_of_flight["look"] == "autumn" and found.pilots == ("hand",)


@pytest.mark.parametrize("form", [["--format", "minari"], ["--format", "lerobot"], ["--format", "lerobot", "--video"]])
def test_frames_that_are_not_square_are_recorded_through_a_lens(form: list[str], tmp_path: Path, easy_world: World):
    (tmp_path / "lens.yaml").write_text(LENS)
    texts = (str(tmp_path / "lens.yaml"), "height_px=36", "width_px=64", "pitch_deg=10")
    out, flown = tmp_path / "flights", ["--level", "easy", "--episodes", "1", "--seed", "3", "--steps", "2"]
    assert main(["record", "steady", *flown, "--camera", *texts, *form, "--out", str(out)]) == 0
    about, (flight,) = read_recordings(out)
    camera = camera_from(texts)
    assert about.camera["lens"] == to_plain(camera)["lens"] and about.camera["lens"]["model"] == "plumb_bob"
    assert about.camera["intrinsics"] == camera.intrinsics().tolist()
    config = EnvConfig(observation=("rgb", "mask", "depth", "class"), camera=camera)
    seen, _ = RiverVectorEnv([easy_world], 1, config).reset(seed=3)
    assert flight.rgb.shape[1:] == (36, 64, 3)
    lossy = 12 if "--video" in form else 0
    assert np.abs(flight.rgb[0].astype(int) - seen["rgb"][0]).mean() <= lossy
    for name, layer in (("mask", flight.mask), ("depth", flight.depth_m), ("class", flight.class_id)):
        assert layer is not None
        np.testing.assert_array_equal(layer[0], seen[name][0, ..., 0], err_msg=name)


def test_a_recording_is_not_resumed_through_another_lens(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    (tmp_path / "lens.yaml").write_text(LENS)
    command = ["record", "steady", "--level", "easy", "--episodes", "2", "--steps", "2", "--layers", "mask"]
    command += ["--camera", str(tmp_path / "lens.yaml"), "height_px=36", "width_px=48"]
    command += ["--out", str(tmp_path / "flights")]
    interrupt_second_flight(command, monkeypatch)
    (tmp_path / "lens.yaml").write_text(LENS.replace("-0.2,", "-0.19,"))
    assert main(command) == 2
    assert "about.camera.lens" in capsys.readouterr().err
    (tmp_path / "lens.yaml").write_text(LENS)
    moved = (tmp_path / "lens.yaml").rename(tmp_path / "same.yaml")
    assert main([str(moved) if word.endswith("lens.yaml") else word for word in command]) == 0
    assert len(list(read_recordings(tmp_path / "flights")[1])) == 2


def interrupt_second_flight(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    record, flown = Observer.record, []

    def interrupted(*arguments: Any) -> int:
        flown.append(1)
        if len(flown) == 2:
            raise KeyboardInterrupt
        return record(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(Observer, "record", interrupted)
        assert main(command) == 130


def test_an_interrupted_recording_says_what_it_has_and_the_same_command_makes_the_same_data_set(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    command = ["record", "steady", "--level", "easy", "--episodes", "3", "--steps", "3", "--size", "32"]
    assert main([*command, "--out", str(tmp_path / "whole")]) == 0
    again = [*command, "--out", str(tmp_path / "again")]
    interrupt_second_flight(again, monkeypatch)
    assert "Flights that are finished: 1. The same command records the others." in capsys.readouterr().err
    assert main([*again, "--seed", "5"]) == 2
    assert "options.seed is 0 there and 5 here" in capsys.readouterr().err
    assert main(again) == 0
    told = capsys.readouterr()
    assert "Resuming after 1 of 3 flights" in told.err and "3 flights, 9 steps (3 stopped)" in told.out
    for one, other in zip(*(read_recordings(tmp_path / name)[1] for name in ("whole", "again")), strict=True):
        for name in ("rgb", "mask", "depth_m", "class_id", "poses", "options", "rewards", "costs"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_a_recording_is_not_resumed_with_a_function_that_has_changed(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    mine = tmp_path / "mine.py"
    mine.write_text("def fly(image):\n    return 1, 1, 2, 1\n")
    command = ["record", f"{mine}:fly", "--level", "easy", "--episodes", "2", "--steps", "2", "--size", "32"]
    command += ["--layers", "mask", "--out", str(tmp_path / "flights")]
    interrupt_second_flight(command, monkeypatch)
    before = mine.read_text()
    mine.write_text("def fly(image):\n    return 1, 1, 1, 1\n")
    assert main(command) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert f"{mine}:fly has changed since the recording in" in told and "Restore the old file to resume" in told
    mine.write_text(before)
    assert main(command) == 0


def test_what_is_flown_counts_by_its_content_wherever_it_lies(tmp_path: Path):
    river, moved = tmp_path / "a.gpx", tmp_path / "other" / "a.gpx"
    river.write_text("<gpx/>")
    moved.parent.mkdir()
    moved.write_text("<gpx/>")
    mine = tmp_path / "mine.py"
    mine.write_text("from beside import MOVE\n\n\ndef fly(image):\n    return MOVE\n")
    (tmp_path / "beside.py").write_text("MOVE = (1, 1, 2, 1)\n")
    found = flown_files("steady", river, [mine])
    assert set(found) == {"river", "plugin 1"} and found["plugin 1"]["file"] == "mine.py"
    assert flown_files("steady", moved, [mine]) == found
    (tmp_path / "beside.py").write_text("MOVE = (1, 1, 1, 1)\n")
    river.write_text("<gpx></gpx>")
    changed = flown_files("steady", river, [mine])
    assert all(changed[what]["content"] != found[what]["content"] for what in found)


def test_what_follows_from_the_policy_is_recorded_as_if_it_were_given():
    flown = FlightOptions(level="Easy", task="Nests", vehicle="uav")
    told = Record()._what_is_flown(flown)
    assert told == Record(task="Nests", vehicle="uav", action="multidiscrete")._what_is_flown(flown)
    assert (told["task"], told["vehicle"], told["action"]) == ("Nests", "uav", "multidiscrete")


def test_a_policy_counts_by_its_file(tmp_path: Path):
    run, other = tmp_path / "run", tmp_path / "moved" / "run"
    run.mkdir()
    image_policy("rgb", 32).save(run / "policy.safetensors")
    shutil.copytree(run, other)
    found = flown_files(str(run), None, ())
    assert set(found) == {"policy"} and found["policy"]["file"] == "run"
    assert flown_files(str(other), None, ()) == found
    image_policy("mask", 32).save(run / "policy.safetensors")
    assert flown_files(str(run), None, ())["policy"]["content"] != found["policy"]["content"]


def test_a_policy_flies_whatever_its_folder_is_called(tmp_path: Path, easy_world: World):
    run, out = tmp_path / "steady", tmp_path / "flights"
    run.mkdir()
    image_policy("rgb+mask").save(run / "policy.safetensors")
    assert main(["record", str(run), "--level", "easy", "--episodes", "1", "--steps", "2", "--out", str(out)]) == 0
    (found,) = read_recordings(out)[1]
    assert set(found.pilots) == {"steady (2)"}


def test_a_function_steers_the_boat(tmp_path: Path):
    mine, out = tmp_path / "mine.py", tmp_path / "flights"
    mine.write_text("def fly(image):\n    return 1, 1, 2, 1\n")
    command = ["record", f"{mine}:fly", "--vehicle", "asv", "--level", "easy", "--episodes", "1", "--steps", "2"]
    assert main([*command, "--size", "32", "--layers", "mask", "--out", str(out)]) == 0
    assert [flight.steps for flight in read_recordings(out)[1]] == [2]


def test_flights_that_another_command_recorded_meanwhile_are_not_recorded_twice(
    tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    command = ["record", "steady", "--level", "easy", "--episodes", "3", "--steps", "2", "--size", "32"]
    command += ["--out", str(tmp_path / "flights")]
    interrupt_second_flight(command, monkeypatch)
    read, before_the_others = draft.finished_flights, iter([[]])
    with monkeypatch.context() as earlier:
        earlier.setattr(draft, "finished_flights", lambda folder: next(before_the_others, read(folder)))
        assert main(command) == 2
    assert "another command recorded flights there; run" in capsys.readouterr().err
    assert main(command) == 0 and len(list(read_recordings(tmp_path / "flights")[1])) == 3


@pytest.mark.parametrize("form", ["lerobot", "minari"])
def test_the_folder_may_be_relative(form: str, tmp_path: Path, easy_world: World, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    options = ["--level", "easy", "--episodes", "1", "--steps", "2", "--size", "32", "--layers", "mask"]
    assert main(["record", "pilot", *options, "--format", form, "--out", "new/flights"]) == 0
    assert [flight.steps for flight in read_recordings(Path("new/flights"))[1]] == [2]


def test_a_saved_flight_is_one_flight(capsys: pytest.CaptureFixture):
    assert main(["record", "x.npz", "--episodes", "3"]) == 2
    assert "--episodes and --world-seeds do not go with x.npz, which is one flight" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--episodes", "0"], "--episodes must be at least 1, not 0"),
        (["--steps", "0"], "--steps must be at least 1, not 0"),
        (["--size", "7"], "--size must be a whole number from 16 to 2048, got 7; such as --size 128"),
        (["--video", "--size", "33"], "--video needs frames with an even height and width, not 33 x 33 pixels"),
        (["--video", "--camera", "width_px=97"], "an even height and width, not 128 x 97 pixels"),
        (["--camera", "fov_deg=75", "--size", "64"], "--size goes without --camera, which has height_px and width_px"),
        (["--camera", "fov=75"], "--camera has no setting 'fov' (did you mean 'fov_deg'?)"),
        (["--video", "--format", "minari"], "Minari keeps no videos"),
        (["--format", "minari", "--out", "my flights"], "letters, digits, - and _, not 'my flights'"),
        (["--world-seed", "1", "--world-seeds", "2"], "give --world-seed or --world-seeds, not both"),
        (["--look", "fog"], "look must be one of"),
        (["--camera", "fov_deg=200"], "fov_deg must be a number from 5 to 150, got 200"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_is_flown(
    options: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(["record", "pilot", *options]) == 2
    assert error in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_flights_take_the_chosen_rivers_in_turn(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Record, "cockpits", lambda *given: iter(given[3]))
    record = Record("pilot", out=Path("flights"), episodes=3, world_seeds=("7", "9"), seed=5)
    assert list(record._flights(1)) == [{"seed": 6, "world_seed": 9}, {"seed": 7, "world_seed": 7}]
