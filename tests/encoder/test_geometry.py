"""Tests of the encoder of geometry: what it learns, its loss, its fast twin, its file, and what is refused."""

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch

from tests.encoder.synthetic_frames import synthetic_frames
from thalweg.core import machine
from thalweg.core.run_folder import FolderKind
from thalweg.encoder import (
    VAE,
    Encoder,
    EncoderFileError,
    EncoderInputError,
    GeometryConfig,
    GeometryNetwork,
    VAEConfig,
    load_encoder,
    load_vae,
    save_geometry,
    save_vae,
)
from thalweg.encoder import geometry_training as training
from thalweg.encoder.checkpoint import check_folder
from thalweg.encoder.geometry import Scale, geometry_loss
from thalweg.encoder.geometry_training import Labelled, r_squared, train_geometry, write_geometry
from thalweg.encoder.reconstruction import to_batch

CONFIG = GeometryConfig(targets=("wet", "bright"), latent=4, size_px=64, hidden=8, batch=16)


def truths_of(frames: np.ndarray) -> np.ndarray:
    """Share of water in %, and mean brightness of the colours: both are linear in the pixels."""
    wet = 100.0 * (frames[..., 3] / 255).mean(axis=(1, 2))
    return np.stack([wet, frames[..., :3].mean(axis=(1, 2, 3))], axis=1)


class Synthetic:
    """Lessons of synthetic frames, the same in each epoch."""

    def __init__(self, count: int = 64) -> None:
        frames, others = synthetic_frames(count, 64, seed=1), synthetic_frames(32, 64, seed=2)
        self.lesson = Labelled(frames, truths_of(frames))
        self.held_out = Labelled(others, truths_of(others))
        self.scale = Scale.of(self.lesson.truths)

    def draw(self, epoch: int) -> Iterator[Labelled]:
        yield self.lesson


def trained_looking(config: GeometryConfig = CONFIG) -> GeometryNetwork:
    """A network whose norms and scale are far from the identity, as after training."""
    with torch.random.fork_rng():
        torch.manual_seed(4)
        count = len(config.targets)
        network = GeometryNetwork(config, Scale(np.arange(count) + 2.0, np.arange(count) + 0.5))
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm2d | torch.nn.BatchNorm1d):
                assert module.running_mean is not None and module.running_var is not None
                module.running_mean.normal_(0, 0.3)
                module.running_var.uniform_(0.5, 2.0)
    return network.eval()


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return synthetic_frames(40, 64, seed=5)


def test_what_is_linear_in_the_pixels_is_learnt_and_read_off_the_code(tmp_path: Path):
    network = train_geometry(Synthetic(256), CONFIG, tmp_path, epochs=25, precision="float32", progress=False)
    encoder, others = Encoder(network), Synthetic().held_out
    assert (r_squared(encoder.predict(encoder(others.frames)), others.truths) > 0.9).all()
    codes = encoder(Synthetic(256).lesson.frames)
    assert np.abs(codes.mean(0)).max() < 0.3 and np.abs(codes.std(0) - 1).max() < 0.3


def test_fast_codes_are_those_of_the_network_and_predictions_are_in_units(frames: np.ndarray):
    network = trained_looking()
    with torch.inference_mode():
        codes = network.encode(to_batch(frames[:8], CONFIG))
        in_deviations = network(to_batch(frames[:8], CONFIG)).numpy()
    encoder = Encoder(network)
    assert np.abs(encoder(frames[:8]) - codes.numpy()).max() < 1e-5 * max(1, float(codes.abs().max()))
    np.testing.assert_allclose(
        encoder.predict(codes.numpy()), in_deviations * np.array([0.5, 1.5]) + np.array([2.0, 3.0]), rtol=1e-5
    )


@pytest.mark.parametrize("inputs", ["rgb", "mask", "rgb+mask"])
def test_code_depends_on_its_own_frame_only(inputs: str, frames: np.ndarray):
    encoder = Encoder(trained_looking(replace(CONFIG, inputs=inputs, hidden=256, latent=32)))
    together = encoder(frames)
    for size in (1, 2, 3, 7, 16, 17, 33):
        parts = [encoder(frames[start : start + size]) for start in range(0, len(frames), size)]
        assert np.array_equal(np.concatenate(parts), together), f"batches of {size}"


def test_the_loss_is_the_weighted_huber_loss_of_what_is_defined():
    predicted = torch.tensor([[0.5, 3.0], [1.0, 1.0]])
    truths = torch.tensor([[0.0, 0.0], [0.0, torch.nan]])
    # Halves of squares up to 1, then |error| - 1/2; weights 1 and 2; the last one is not defined.
    expected = (0.125 + 2 * 2.5 + 0.5) / (1 + 2 + 1)
    assert geometry_loss(predicted, truths, torch.tensor([1.0, 2.0]), 1.0).item() == pytest.approx(expected)


def test_what_is_not_defined_has_no_gradient():
    predicted = torch.tensor([[0.5, 3.0]], requires_grad=True)
    geometry_loss(predicted, torch.tensor([[0.0, torch.nan]]), torch.ones(2), 1.0).backward()
    assert predicted.grad is not None and predicted.grad.tolist() == [[0.5, 0.0]]


def test_the_scale_is_that_of_defined_values():
    scale = Scale.of(np.array([[1.0, 5.0], [3.0, np.nan], [np.nan, 5.0]]))
    assert scale.mean.tolist() == [2.0, 5.0] and scale.deviation.tolist() == [1.0, 1.0]
    with pytest.raises(EncoderInputError, match=r"the quantities \[1\] are defined for none of 2 views"):
        Scale.of(np.array([[1.0, np.nan], [2.0, np.nan]]))


def test_r_squared_is_that_worked_by_hand():
    truths = np.array([[0.0, 1.0, 4.0], [2.0, 1.0, np.nan], [4.0, 1.0, 8.0]])
    predicted = np.array([[0.0, 1.0, 4.0], [2.0, 1.0, 0.0], [2.0, 1.0, 8.0]])
    found = r_squared(predicted, truths)
    assert found[0] == pytest.approx(1 - (4 / 3) / (8 / 3)) and np.isnan(found[1]) and found[2] == 1.0


def state_of(config: GeometryConfig) -> training._State:
    return training._State(config, Synthetic().scale, {"seed": 0, "precision": "float32", "epochs": 5}, "cpu")


def test_the_learning_rate_falls_along_a_half_cosine_to_its_least(monkeypatch: pytest.MonkeyPatch):
    taken: list[float] = []
    state = state_of(replace(CONFIG, learning_rate=0.01, least_rate=0.1, batch=64))
    monkeypatch.setattr(state, "_step", lambda *_: taken.append(state.optimizer.param_groups[0]["lr"]) or 0.0)
    monkeypatch.setattr(state, "_score", lambda _: None)
    lessons = Synthetic(16)
    told = [state.epoch(lessons, epoch)["learning_rate"] for epoch in range(5)]
    halves = [1.0, 0.5 + 0.125**0.5, 0.5, 0.5 - 0.125**0.5, 0.0]
    expected = [0.01 * (0.1 + 0.9 * half) for half in halves]
    assert taken == pytest.approx(expected) and told == pytest.approx(expected)


@pytest.mark.parametrize("weights", [(), (1.0, 0.25)])
def test_quantities_are_learnt_and_scored_by_their_weights(weights: tuple[float, ...], monkeypatch: pytest.MonkeyPatch):
    state, given, frames = state_of(replace(CONFIG, weights=weights)), [], Synthetic(16).lesson
    monkeypatch.setattr(training, "geometry_loss", lambda *all_: given.append(all_[2].tolist()) or geometry_loss(*all_))
    state._step(frames.frames, frames.truths)
    assert given == [[*(weights or (1.0, 1.0))]]
    for found, score in (([0.5, 1.0], 0.6 if weights else 0.75), ([0.5, np.nan], 0.5), ([np.nan, np.nan], None)):
        monkeypatch.setattr(training, "r_squared", lambda *_, found=found: np.array(found))
        assert state._score(frames) == (score if score is None else pytest.approx(score))


@pytest.mark.parametrize(("steep", "clipped"), [(1e6, True), (1e-6, False)])
def test_steep_gradients_are_clipped(steep: float, clipped: bool, monkeypatch: pytest.MonkeyPatch):
    state, norms, frames = state_of(CONFIG), [], Synthetic(16).lesson

    def note() -> None:
        norms.append(
            float(
                torch.stack([each.grad.norm() for each in state.network.parameters() if each.grad is not None]).norm()
            )
        )

    monkeypatch.setattr(state.optimizer, "step", note)
    monkeypatch.setattr(training, "geometry_loss", lambda *given: steep * geometry_loss(*given))
    state._step(frames.frames, frames.truths)
    assert norms[0] == pytest.approx(1.0, rel=1e-3) if clipped else 0.0 < norms[0] < 1e-3


def test_a_file_gives_the_same_codes_and_says_what_it_is(tmp_path: Path, frames: np.ndarray):
    network = trained_looking()
    save_geometry(tmp_path / "eye.safetensors", network, {"render_version": 3})
    loaded = load_encoder(tmp_path / "eye.safetensors")
    assert np.array_equal(loaded(frames), Encoder(network)(frames))
    assert (loaded.latent, loaded.inputs, loaded.render_version, loaded.config) == (4, "rgb+mask", 3, CONFIG)
    codes = loaded(frames[:2])
    assert np.array_equal(loaded.predict(codes), Encoder(network).predict(codes))


def test_a_copy_of_the_sources_that_is_not_installed_writes_its_file_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(machine, "version", Mock(side_effect=PackageNotFoundError))
    write_geometry(tmp_path / "eye.safetensors", trained_looking(), {})
    assert load_encoder(tmp_path / "eye.safetensors").about["thalweg"] == "unknown"


def test_files_of_the_other_kind_are_refused(tmp_path: Path):
    save_geometry(tmp_path / "eye.safetensors", trained_looking(), {})
    with pytest.raises(EncoderFileError, match=r"no encoder of Thalweg \(its kind: geometry encoder\)"):
        load_vae(tmp_path / "eye.safetensors")
    (tmp_path / "eye.safetensors").write_bytes((tmp_path / "eye.safetensors").read_bytes()[:-100])
    with pytest.raises(EncoderFileError, match="truncated, damaged or not a safetensors file"):
        load_encoder(tmp_path / "eye.safetensors")
    with pytest.raises(EncoderFileError, match="encodes to 4 numbers, but 16 are needed"):
        save_geometry(tmp_path / "eye.safetensors", trained_looking(), {})
        load_encoder(tmp_path / "eye.safetensors", latent=16)


def test_a_checkpoint_is_no_encoder(tmp_path: Path):
    train_geometry(Synthetic(), CONFIG, tmp_path, epochs=1, precision="float32", progress=False)
    with pytest.raises(EncoderFileError, match=r"no encoder of Thalweg \(its kind: geometry encoder training\)"):
        load_encoder(tmp_path / "checkpoint.safetensors")


def test_each_kind_of_encoder_refuses_what_only_the_other_can(tmp_path: Path):
    codes = np.zeros((2, 4), np.float32)
    with pytest.raises(EncoderInputError, match="an encoder of geometry has no decoder"):
        Encoder(trained_looking()).decode(codes)
    save_vae(tmp_path / "vae.safetensors", VAE(VAEConfig(latent=4, size_px=64)), {})
    with pytest.raises(EncoderInputError, match="only an encoder of geometry predicts quantities"):
        load_encoder(tmp_path / "vae.safetensors").predict(codes)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"targets": ()}, "targets must be at least one, each once, got none"),
        ({"targets": ("a", "a")}, "targets must be at least one, each once, got a, a"),
        ({"weights": (1.0,)}, "weights must be as many as targets, 2, got 1"),
        ({"weights": (0.0, 0.0)}, "weights must not all be 0"),
        ({"inputs": "sonar"}, "unknown inputs 'sonar'"),
        ({"size_px": (96, 8)}, r"size_px: it must be a whole number from 33, or height and width, got \(96, 8\)"),
        ({"batch": 1}, "batch must be"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict, message: str):
    with pytest.raises(EncoderInputError, match=message):
        replace(CONFIG, **settings)


def test_resumed_training_equals_an_uninterrupted_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def train(name: str) -> bytes:
        network = train_geometry(Synthetic(), CONFIG, tmp_path / name, epochs=3, precision="float32", progress=False)
        save_geometry(tmp_path / f"{name}.safetensors", network, {})
        return (tmp_path / f"{name}.safetensors").read_bytes()

    unbroken, done = train("unbroken"), training._State.epoch

    def stopped(self, lessons, epoch):
        if epoch == 2:
            raise KeyboardInterrupt
        return done(self, lessons, epoch)

    monkeypatch.setattr(training._State, "epoch", stopped)
    with pytest.raises(KeyboardInterrupt):
        train("broken")
    monkeypatch.setattr(training._State, "epoch", done)
    torch.manual_seed(99)  # nothing may depend on the global generator
    assert train("broken") == unbroken


def test_the_row_that_a_killed_process_did_not_write_is_written_after_resuming(tmp_path: Path):
    def train() -> str:
        train_geometry(Synthetic(), CONFIG, tmp_path, epochs=2, progress=False)
        return (tmp_path / "metrics.csv").read_text()

    whole = train()
    (tmp_path / "metrics.csv").write_text("".join(whole.splitlines(keepends=True)[:-1]))
    assert train() == whole


def test_the_folder_of_another_training_is_refused(tmp_path: Path):
    options = {"precision": "float32", "progress": False}
    train_geometry(Synthetic(), CONFIG, tmp_path, epochs=1, identity={"levels": ["Easy"]}, **options)
    with pytest.raises(EncoderFileError, match="belongs to another geometry encoder training: epochs"):
        train_geometry(Synthetic(), CONFIG, tmp_path, epochs=2, identity={"levels": ["Easy"]}, **options)
    with pytest.raises(EncoderFileError, match="levels is"):
        check_folder(tmp_path, training.GEOMETRY_FOLDER, {"levels": ["Hard"]})
    other = FolderKind("encoder training", "checkpoint.safetensors", EncoderFileError)
    with pytest.raises(EncoderFileError, match="no encoder training of Thalweg"):
        check_folder(tmp_path, other, {})
    with pytest.raises(EncoderInputError, match="epochs must be at least 1, not 0"):
        train_geometry(Synthetic(), CONFIG, tmp_path, epochs=0)
