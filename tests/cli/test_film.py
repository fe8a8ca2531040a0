"""Tests of `thalweg film` on the command line."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.cli.calibration import LENS
from thalweg.bench.pictures.film import FRAMES_PER_S, HOLD_S
from thalweg.bench.pictures.film_format import LARGE, MARGIN_PX
from thalweg.cli.flight_options import ChosenFlight
from thalweg.cli.main import main
from thalweg.cli.options import UsageError
from thalweg.cli.views import camera_from
from thalweg.core.video import read_video
from thalweg.env import EnvConfig
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.env.physics.inertia import Inertia
from thalweg.render import Camera
from thalweg.viewer.flight.flight import Flight, env_of
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.world import World


@pytest.fixture
def saved(tmp_path: Path, easy_world: World) -> Path:
    """The file of a flight of three steps by hand on Easy."""
    options = FlightOptions(level="Easy", size_px=32, seed=3, look="autumn")
    flight = Flight(env_of(easy_world, options), options)
    for _ in range(3):
        flight.step(np.array([1, 1, 0, 1]), "hand")
    return tmp_path / f"{Folder(tmp_path).save(flight)}.npz"


def frames_of(path: Path) -> int:
    """Number of frames of a film; raises an error unless they have the usual size."""
    frames = list(read_video(path))
    assert {frame.shape[:2] for frame in frames} == {LARGE.size_px[::-1]}
    return len(frames)


HOLD = round(HOLD_S * FRAMES_PER_S)


def test_a_flight_of_a_pilot_is_filmed(tmp_path: Path, easy_world: World, capsys: pytest.CaptureFixture):
    out = tmp_path / "pilot.mp4"
    assert main(["film", "pilot", "--level", "easy", "--seed", "3", "--steps", "2", "--out", str(out)]) == 0
    assert frames_of(out) == 2 + HOLD
    assert out.with_suffix(".jpg").is_file()
    assert "2 steps on Easy, start 3: not ended, return " in capsys.readouterr().out


def test_a_saved_flight_is_filmed(saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "hand.mp4"
    assert main(["film", str(saved), "--out", str(out)]) == 0
    assert frames_of(out) == 3 + HOLD
    assert "3 steps on Easy, start 3: not ended" in capsys.readouterr().out


def test_a_film_has_the_shape_of_the_frames_of_its_camera(saved: Path, tmp_path: Path, easy_world: World):
    (tmp_path / "lens.yaml").write_text(LENS)
    out, given = tmp_path / "lens.mp4", (str(tmp_path / "lens.yaml"), "pitch_deg=10")
    assert main(["film", str(saved), "--camera", *given, "--out", str(out)]) == 0
    frames = list(read_video(out))
    assert frames[0].shape == (512, 1056, 3)
    options = FlightOptions(level="Easy", size_px=32, seed=3, look="autumn")
    start = Flight(env_of(easy_world, options), options)
    config = replace(start.env.config, camera=camera_from(given))
    wanted = FrameRenderer(start.env.worlds, 1, config).render(start.views())[0]
    shown = frames[0][MARGIN_PX : MARGIN_PX + 480, MARGIN_PX : MARGIN_PX + 640].astype(int)
    assert np.abs(shown[200:] - wanted[200:, :, :3]).mean() < 8  # below the mask; the video is lossy
    usual = FrameRenderer(start.env.worlds, 1, replace(config, camera=Camera(480, 640))).render(start.views())[0]
    assert np.abs(shown[200:] - usual[200:, :, :3]).mean() > 20


def test_without_a_size_the_frames_of_a_film_are_square(saved: Path, tmp_path: Path):
    out = tmp_path / "wide.mp4"
    assert main(["film", str(saved), "--camera", "fov_deg=90", "--steps", "1", "--out", str(out)]) == 0
    assert frames_of(out) == 1 + HOLD


@pytest.mark.parametrize("given", [["--look", "mist"], ["--world-seed", "4"], ["--action", "multidiscrete"]])
def test_options_beside_a_saved_flight_are_refused(
    given: list[str], saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture
):
    assert main(["film", str(saved), *given, "--out", str(tmp_path / "x.mp4")]) == 2
    told = f"{given[0]} does not go with {saved}, a flight with options of its own"
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "x.mp4").exists()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--out", "x.avi"], "--out must end in .mp4, not 'x.avi'"),
        (["--steps", "0"], "--steps must be at least 1, not 0"),
        (["missing.npz"], "missing.npz"),
        (["--look", "fog"], "look must be one of"),
        (["pilto"], "did you mean 'pilot'?"),
        (["--camera", "fov_deg=200"], "fov_deg must be a number from 5 to 150, got 200"),
        (["--camera", "fov=75"], "--camera has no setting 'fov' (did you mean 'fov_deg'?)"),
        (["--camera", "none.yaml"], "none.yaml cannot be read as a calibration"),
        (["--camera", "height_px=64", "width_px=300"], "at most 4 times the other, not 64 x 300 pixels"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_is_flown(
    options: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(["film", *options]) == 2
    assert error in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("trained", "given", "expected"),
    [
        ({"task": "Nests", "hard": True}, {}, {"task": "Nests", "hard": True, "level": "Medium"}),
        ({"task": "Nests", "hard": True}, {"task": "River"}, {"task": "River", "hard": False}),
        ({"vehicle": "asv"}, {}, {"vehicle": "asv", "level": "Medium-Deep"}),
        ({"vehicle": "asv"}, {"vehicle": "uav"}, {"vehicle": "uav", "level": "Medium"}),
        ({"dynamics": "inertial", "action": "continuous"}, {}, {"dynamics": "inertial", "action": "continuous"}),
        ({}, {}, {"task": "River", "hard": False, "vehicle": "uav", "dynamics": "kinematic"}),
    ],
    ids=str,
)
def test_a_policy_flies_what_it_was_trained_on_unless_something_else_is_chosen(
    trained: dict[str, Any], given: dict[str, Any], expected: dict[str, Any]
):
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={"env": trained}))
    _, options = ChosenFlight(**given).chosen(64, policy)
    assert {name: getattr(options, name) for name in expected} == expected
    assert ChosenFlight().chosen(64)[1] == FlightOptions(size_px=64)


def test_a_policy_with_inertia_of_its_own_is_not_filmed_with_the_usual_one():
    env = EnvConfig(action="continuous", dynamics="inertial", inertia=Inertia(forward_m_per_s=9.0)).as_data()
    policy: Any = SimpleNamespace(about=SimpleNamespace(context={"env": env}))
    with pytest.raises(UsageError, match="settings of inertia of its own"):
        ChosenFlight().chosen(64, policy)
