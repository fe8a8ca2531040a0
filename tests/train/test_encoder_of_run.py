"""Tests of the encoder of a run: its file is found again, or named where it is missing."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from thalweg.core.cache import file_hash
from thalweg.encoder import PACKAGED, VAE, Encoder, VAEConfig, load_encoder, save_vae
from thalweg.env import EnvConfig
from thalweg.render import RENDER_VERSION, Camera
from thalweg.train.encoder_of_run import check_camera_fits, encoder_in_words, encoder_of, file_of_its_own
from thalweg.train.errors import TrainingError
from thalweg.train.folder.run_record import require_same
from thalweg.train.river import RiverTraining


@pytest.fixture
def own(tmp_path: Path) -> Encoder:
    with torch.random.fork_rng():
        torch.manual_seed(3)
        save_vae(tmp_path / "run" / "encoder.safetensors", VAE(VAEConfig()), {"render_version": RENDER_VERSION})
    return load_encoder(tmp_path / "run")


def trained_with(encoder: Encoder) -> Any:
    context = RiverTraining("Medium", 1)._context("frames", encoder)
    return SimpleNamespace(about=SimpleNamespace(context=context))


def test_the_encoder_of_a_run_is_the_file_that_it_was_trained_with(own: Encoder, tmp_path: Path):
    assert encoder_of(trained_with(own)) == tmp_path / "run" / "encoder.safetensors"
    assert file_of_its_own(own) == {"encoder_file": str(tmp_path / "run" / "encoder.safetensors")}


@pytest.mark.parametrize("name", PACKAGED)
def test_a_packaged_encoder_is_found_wherever_the_package_is(name: str):
    packaged, path = load_encoder(name), PACKAGED[name]
    assert file_of_its_own(packaged) == {}
    assert encoder_of(trained_with(packaged)) == path
    moved = {"encoder": file_hash(path), "encoder_file": "/gone"}
    assert encoder_of(SimpleNamespace(about=SimpleNamespace(context=moved))) == path
    assert encoder_in_words(moved) == f"the encoder '{name}' that comes with the package"


def test_a_policy_that_was_not_trained_names_no_encoder():
    assert encoder_of(SimpleNamespace()) is None


def test_a_missing_encoder_is_named(own: Encoder, tmp_path: Path):
    policy, file = trained_with(own), tmp_path / "run" / "encoder.safetensors"
    digest = file_hash(file)
    file.rename(tmp_path / "elsewhere.safetensors")
    message = rf"{file} \(its hash: {digest}\), but that file is not there any more; name the file with --encoder$"
    with pytest.raises(TrainingError, match=message):
        encoder_of(policy)


def test_an_encoder_that_has_changed_is_named(own: Encoder, tmp_path: Path):
    policy, file = trained_with(own), tmp_path / "run" / "encoder.safetensors"
    save_vae(file, VAE(VAEConfig()), {"render_version": RENDER_VERSION})
    with pytest.raises(
        TrainingError, match=f"{file} .*, but that file has changed since: its hash is {file_hash(file)}"
    ):
        encoder_of(policy)


def test_a_run_of_an_earlier_version_names_the_hash_that_is_needed():
    policy = SimpleNamespace(about=SimpleNamespace(context={"encoder": "0123456789abcdef"}))
    message = r"an encoder of its own \(its hash: 0123456789abcdef\), but its run did not record the file's name"
    with pytest.raises(TrainingError, match=message):
        encoder_of(policy)


def test_a_run_resumes_with_the_same_encoder_from_another_place(tmp_path: Path):
    recorded = {"algorithm": "PPO", "context": {"encoder": "1", "encoder_file": "/a"}}
    require_same(tmp_path, recorded, {"algorithm": "PPO", "context": {"encoder": "1", "encoder_file": "/b"}})
    require_same(tmp_path, recorded, {"algorithm": "PPO", "context": {"encoder": "1"}})
    with pytest.raises(TrainingError, match=r"context\.encoder is '1' there and '2' here"):
        require_same(tmp_path, recorded, {"algorithm": "PPO", "context": {"encoder": "2", "encoder_file": "/a"}})


def test_a_camera_of_another_size_than_the_encoders_is_refused_before_a_river_is_built(
    own: Encoder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(RiverTraining, "worlds", None)
    training = RiverTraining("Medium", 1, config=EnvConfig(camera=Camera(96, 160)))
    message = (
        rf"the camera draws frames of 96 x 160 pixels \(height x width\), but the encoder"
        rf" {tmp_path / 'run' / 'encoder.safetensors'} takes 128 x 128: give the camera height_px=128 and width_px=128,"
    )
    with pytest.raises(TrainingError, match=message):
        training.train("PPO", own, steps=16, seed=0, folder=tmp_path / "new")
    assert not (tmp_path / "new").exists()
    check_camera_fits(Camera(128, 128), own)
