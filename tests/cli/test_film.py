"""Tests of `thalweg film` on the command line."""

from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.pictures.film import FRAMES_PER_S, HOLD_S
from thalweg.bench.pictures.film_format import LARGE
from thalweg.cli.main import main
from thalweg.core.video import read_video
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


@pytest.mark.parametrize("given", [["--look", "mist"], ["--world-seed", "4"]])
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
    ],
)
def test_a_wrong_option_is_refused_before_anything_is_flown(
    options: list[str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    assert main(["film", *options]) == 2
    assert error in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
