"""Tests of encoder training: learning, exact resumption, written files, and refused inputs."""

import csv
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from tests.encoder.synthetic_frames import synthetic_frames
from thalweg.encoder import (
    EncoderFileError,
    EncoderInputError,
    Source,
    VAEConfig,
    draw_reconstructions,
    load_encoder,
    load_vae,
    mean_image_mse,
    reconstruct,
    reconstruction_mse,
    train_encoder,
)
from thalweg.encoder.files import read_tensors, write_tensors
from thalweg.encoder.training import ENCODER_FOLDER, _State, epoch_generator, resolve_precision

CONFIG = VAEConfig(latent=6, size_px=64)


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    return synthetic_frames(60, 64, seed=2)


def train(images, folder, **settings):
    options = {"epochs": 4, "batch": 16, "seed": 7, "held_out": 10, "precision": "float32", "progress": False}
    return train_encoder(images, CONFIG, folder, **(options | settings))


def rows_of(folder) -> list[dict[str, str]]:
    """The rows of metrics.csv without the speed, which differs from run to run."""
    with (folder / "metrics.csv").open() as file:
        return [{name: value for name, value in row.items() if name != "images_per_s"} for row in csv.DictReader(file)]


@pytest.mark.slow
def test_learns_more_than_the_mean_image(tmp_path):
    frames = synthetic_frames(300, 64, seed=4)
    result = train_encoder(frames, CONFIG, tmp_path, epochs=20, batch=32, held_out=60, progress=False)
    assert result.train_mse < 0.4 * result.mean_image_mse
    assert result.held_out_mse is not None and result.held_out_mse < 0.5 * result.mean_image_mse
    draw_reconstructions(frames[:5], load_encoder(result.path), tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 5000


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.slow
def test_resumed_training_equals_an_uninterrupted_one(images, tmp_path, monkeypatch, precision):
    unbroken = train(images, tmp_path / "unbroken", precision=precision)
    torch.manual_seed(99)  # nothing may depend on the global generator
    done = _State.epoch

    def stopped(self, images, epoch):
        if epoch == 2:
            raise KeyboardInterrupt
        return done(self, images, epoch)

    monkeypatch.setattr(_State, "epoch", stopped)
    with pytest.raises(KeyboardInterrupt):
        train(images, tmp_path / "broken", precision=precision)
    assert len(rows_of(tmp_path / "broken")) == 2
    assert not (tmp_path / "broken" / "encoder.safetensors").exists()
    monkeypatch.setattr(_State, "epoch", done)
    resumed = train(images, tmp_path / "broken", precision=precision)
    assert rows_of(tmp_path / "broken") == rows_of(tmp_path / "unbroken")
    assert resumed.train_mse == unbroken.train_mse and resumed.held_out_mse == unbroken.held_out_mse
    assert resumed.path.read_bytes() == unbroken.path.read_bytes()


def test_a_finished_training_is_not_repeated(images, tmp_path, monkeypatch):
    first = train(images, tmp_path).path.read_bytes()
    monkeypatch.setattr(_State, "epoch", lambda *_: pytest.fail("trained again"))
    assert train(images, tmp_path).path.read_bytes() == first


def test_the_row_that_a_killed_process_did_not_write_is_written_after_resuming(images, tmp_path):
    train(images, tmp_path)
    whole = (tmp_path / "metrics.csv").read_text()
    (tmp_path / "metrics.csv").write_text("".join(whole.splitlines(keepends=True)[:-1]))
    (tmp_path / "encoder.safetensors").unlink()
    train(images, tmp_path)
    assert (tmp_path / "metrics.csv").read_text() == whole


def test_every_epoch_and_seed_has_its_own_order():
    runs = [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]
    orders = {tuple(torch.randperm(50, generator=epoch_generator(*run)).tolist()) for run in runs}
    assert len(orders) == 5
    again = [torch.randperm(50, generator=epoch_generator(0, 1)).tolist() for _ in range(2)]
    assert again[0] == again[1]


def test_another_seed_gives_another_encoder(images, tmp_path):
    one, two = train(images, tmp_path / "1", epochs=1), train(images, tmp_path / "2", epochs=1, seed=8)
    first, second = load_file(one.path), load_file(two.path)
    assert not torch.equal(first["mean.weight"], second["mean.weight"])


def test_file_contains_the_measured_errors(images, tmp_path):
    source = Source(level="Medium", seed=3, render_version=5, command="thalweg encoder train")
    result = train(images, tmp_path, source=source)
    vae, about = load_vae(result.path)
    aside = np.sort(np.random.default_rng([7, 0]).permutation(60)[:10])
    kept = np.setdiff1d(np.arange(60), aside)
    # The decoder lies on disk in half precision.
    assert reconstruction_mse(vae, images[kept]) == pytest.approx(result.train_mse, rel=1e-3)
    assert reconstruction_mse(vae, images[aside]) == pytest.approx(result.held_out_mse, rel=1e-3)
    assert about["train_mse"] == result.train_mse and about["held_out_mse"] == result.held_out_mse
    expected = {"level": "Medium", "image_seed": 3, "seed": 7, "render_version": 5, "images": 60, "epochs": 4}
    assert {name: about[name] for name in expected} == expected
    assert [row["epoch"] for row in rows_of(tmp_path)] == ["1", "2", "3", "4"]
    assert float(rows_of(tmp_path)[-1]["held_out_mse"]) == result.held_out_mse


def test_loss_of_an_epoch_is_the_error_and_the_weighted_kl(images, tmp_path):
    for row in train(images, tmp_path, epochs=2).rows:
        mse, kl = row["mse"], row["kl"]
        assert mse is not None and kl is not None
        assert row["loss"] == pytest.approx(mse + CONFIG.kl_weight * kl, rel=1e-5)


def test_without_images_held_out_the_column_is_empty(images, tmp_path):
    result = train(images, tmp_path, epochs=1, held_out=0)
    assert result.held_out_mse is None
    assert rows_of(tmp_path)[0]["held_out_mse"] == ""


def test_another_run_in_the_folder_is_refused(images, tmp_path):
    train(images, tmp_path, epochs=1)
    with pytest.raises(EncoderFileError, match="belongs to another encoder training: seed is 7 there and 8 here"):
        train(images, tmp_path, epochs=1, seed=8)
    with pytest.raises(EncoderFileError, match=r"images_hash is '\w+' there and '\w+' here\. Choose another folder"):
        train(images[::-1], tmp_path, epochs=1)


def _change_run(folder, change) -> None:
    """Change what the run in a checkpoint says of itself."""
    path = folder / "checkpoint.safetensors"
    tensors, about = read_tensors(path, ENCODER_FOLDER.owner)
    change(about["run"])
    write_tensors(path, tensors, about)


def test_a_training_on_another_kind_of_device_is_refused(images, tmp_path):
    train(images, tmp_path, epochs=1)
    _change_run(tmp_path, lambda run: run.update(device="cuda"))
    with pytest.raises(EncoderFileError, match="device is 'cuda' there and 'cpu' here"):
        train(images, tmp_path, epochs=1)


def test_a_training_from_before_devices_were_recorded_resumes_on_the_cpu(images, tmp_path):
    train(images, tmp_path, epochs=1)
    _change_run(tmp_path, lambda run: run.pop("device"))
    assert len(train(images, tmp_path, epochs=1).rows) == 1


def test_a_damaged_checkpoint_is_refused(images, tmp_path):
    train(images, tmp_path, epochs=1)
    checkpoint = tmp_path / "checkpoint.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    with pytest.raises(EncoderFileError, match=f"{checkpoint}: truncated"):
        train(images, tmp_path, epochs=1)


def test_mean_image_mse_equals_hand_computed_value():
    images = np.zeros((3, 64, 64, 4), np.uint8)
    images[2] = 255
    assert mean_image_mse(images, CONFIG) == pytest.approx(2 / 9)  # the variance of 0, 0, 1


def test_mse_is_the_mean_over_everything(images, tmp_path):
    vae, _ = load_vae(train(images, tmp_path, epochs=1).path)
    expected = np.square(reconstruct(vae, images) - images / 255.0).mean()
    assert reconstruction_mse(vae, images) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"epochs": 0}, "epochs must be at least 1 and batch at least 3, not 0 and 16"),
        ({"seed": -1}, "seed must be 0 or more, not -1"),
        ({"batch": 1}, "not 4 and 1"),
        ({"held_out": 59}, "of 60 images, 59 can't be held out"),
        ({"precision": "float8"}, "unknown precision 'float8'; known: auto, float32, bfloat16"),
    ],
)
def test_bad_settings_are_named(images, tmp_path, settings, message):
    with pytest.raises(EncoderInputError, match=message):
        train(images, tmp_path / "run", **settings)
    assert not (tmp_path / "run").exists() or not list((tmp_path / "run").iterdir())


@pytest.mark.parametrize(
    "bad", [np.zeros((9, 64, 64, 3), np.uint8), np.zeros((9, 64, 64, 4)), np.zeros((64, 64, 4), np.uint8)]
)
def test_bad_images_are_named(bad, tmp_path):
    with pytest.raises(EncoderInputError, match=r"images must be uint8 \[K, 64, 64, 4\], not "):
        train(bad, tmp_path)


def test_a_figure_needs_an_image(images, tmp_path):
    encoder = load_encoder(train(images, tmp_path, epochs=1).path)
    with pytest.raises(EncoderInputError, match="at least one image"):
        draw_reconstructions(images[:0], encoder, tmp_path / "sheet.png")


def test_an_explicit_precision_is_used():
    assert resolve_precision("float32") == "float32" and resolve_precision("bfloat16") == "bfloat16"
    assert resolve_precision("auto") in ("float32", "bfloat16")


def test_a_folder_in_which_another_process_trains_is_refused(images, tmp_path):
    with ENCODER_FOLDER.locked(tmp_path), pytest.raises(EncoderFileError, match="another command is writing to"):
        train(images, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_encoder_is_trained_in_the_precision_that_is_asked_for(images: np.ndarray, tmp_path: Path):
    kinds = ("float32", "bfloat16")
    found = [load_file(train(images, tmp_path / kind, epochs=1, precision=kind).path) for kind in kinds]
    assert not torch.equal(*(tensors["mean.weight"] for tensors in found))
