"""Tests of encoders of other cameras, from `encoder train` to a policy that flies with the codes."""

from pathlib import Path

import numpy as np
import pytest

from thalweg.cli.main import main
from thalweg.encoder import load_encoder
from thalweg.encoder.files import read_tensors
from thalweg.render import Camera
from thalweg.train import load_policy
from thalweg.train.encoder_of_run import camera_of_encoder
from thalweg.train.observations import camera_of
from thalweg.world import World

VIEW = ["--camera", "height_px=48", "width_px=80", "fov_deg=75", "pitch_deg=10"]
CAMERA = Camera(48, 80, 75.0, 10.0)
TINY = ["--level", "easy", "--images", "6", "--held-out", "2", "--epochs", "1", "--latent", "4", "--inputs", "mask"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, easy_world: World) -> Path:
    """A training of an encoder through another camera."""
    out = tmp_path_factory.mktemp("encoders") / "wide"
    assert main(["encoder", "train", *TINY, *VIEW, "--quality", "fast", "--out", str(out)]) == 0
    return out


def test_the_file_of_an_encoder_knows_its_camera(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    encoder = load_encoder(folder)
    assert camera_of_encoder(encoder) == CAMERA and encoder.about["quality"] == "fast"
    assert encoder.config.size_px == (48, 80)
    assert encoder(np.zeros((2, 48, 80, 1), np.uint8)).shape == (2, 4)
    assert main(["encoder", "show", "--path", str(folder), "--count", "2", "--out", str(tmp_path / "a.png")]) == 0
    assert "camera: {'fov_deg': 75.0, 'height_px': 48" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ([*VIEW[:-1], "pitch_deg=20", "--quality", "fast"], "camera.pitch_deg is 10.0 there and 20.0 here"),
        (["--camera", "height_px=48", "width_px=64", "--quality", "fast"], "config.size_px is [48, 80] there and [48,"),
        (VIEW, "quality is 'fast' there and absent here"),
        ([*VIEW, "--quality", "fast", "--randomise"], "randomise is absent there and True here"),
    ],
)
def test_a_folder_is_not_resumed_with_other_views(
    options: list[str], told: str, folder: Path, capsys: pytest.CaptureFixture
):
    assert main(["encoder", "train", *TINY, *options, "--out", str(folder)]) == 2
    assert told in " ".join(capsys.readouterr().err.split())


def test_frames_under_varied_looks_are_told_by_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    drawn = {}

    def collect(count: int, **options: object) -> np.ndarray:
        drawn.update(options)
        return np.random.default_rng(0).integers(256, size=(count, 32, 32, 4), dtype=np.uint8)

    monkeypatch.setattr("thalweg.train.encoder.frames.collect_frames", collect)
    out, small = tmp_path / "varied", ["--camera", "height_px=32", "width_px=32"]
    assert main(["encoder", "train", *TINY, *small, "--randomise", "--out", str(out)]) == 0
    assert drawn["randomisation"] is not None and drawn["quality"] == "full"
    checkpoint = read_tensors(out / "checkpoint.safetensors", "encoder training")[1]
    assert checkpoint["run"]["randomise"] is load_encoder(out).about["randomise"] is True
    assert "quality" not in checkpoint["run"]


def test_a_policy_of_its_codes_trains_is_evaluated_and_exported_through_the_same_camera(
    folder: Path, tmp_path: Path, easy_world: World, capsys: pytest.CaptureFixture
):
    run = tmp_path / "run"
    train = ["train", "--algorithm", "PPO", "--level", "easy", "--num-envs", "2", "--steps", "160"]
    train += ["--set", "steps_per_update=32", "--encoder", str(folder), "--out", str(run)]
    assert main(train) == 2
    assert "128 x 128 pixels (height x width), but the encoder" in " ".join(capsys.readouterr().err.split())
    assert main([*train, *VIEW]) == 0
    assert "another camera" not in capsys.readouterr().err
    assert camera_of(load_policy(run)) == CAMERA
    assert main(["evaluate", str(run), "--levels", "easy", "--episodes", "1"]) == 0
    film = ["film", str(run), "--level", "easy", "--steps", "2", "--out", str(tmp_path / "a.mp4")]
    assert main(film) == 0
    capsys.readouterr()
    assert main(["export", str(run), "--out", str(tmp_path / "policy.onnx")]) == 0
    assert "of 48 x 80 pixels, 75 degrees" in capsys.readouterr().out


def test_training_through_other_optics_than_those_of_the_encoder_is_told(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("thalweg.train.river.RiverTraining._envs", stop)
    train = ["train", "--level", "easy", "--encoder", str(folder), "--out", str(tmp_path / "run")]
    assert main([*train, *VIEW[:-1], "pitch_deg=20"]) == 130
    told = " ".join(capsys.readouterr().err.split())
    assert "was trained on frames of another camera: pitch_deg is 10.0 there and 20.0 here" in told
