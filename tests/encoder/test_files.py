"""Tests of encoder files: loading restores the model, and invalid files are refused with path and reason."""

import json

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from tests.encoder.synthetic_frames import synthetic_frames
from thalweg.encoder import VAE, Encoder, EncoderFileError, VAEConfig, load_encoder, load_vae, save_vae
from thalweg.encoder.files import KEY, write_tensors

CONFIG = VAEConfig(latent=6, size_px=64)


@pytest.fixture
def vae() -> VAE:
    with torch.random.fork_rng():
        torch.manual_seed(1)
        return VAE(CONFIG).eval()


@pytest.fixture
def path(tmp_path, vae):
    save_vae(tmp_path / "encoder.safetensors", vae, {"render_version": 2, "level": "Medium"})
    return tmp_path / "encoder.safetensors"


def test_codes_are_the_same_after_saving(vae, path):
    frames = synthetic_frames(4, 64)
    loaded = load_encoder(path)
    assert np.array_equal(loaded(frames), Encoder(vae)(frames))
    assert (loaded.latent, loaded.inputs, loaded.render_version) == (6, "rgb+mask", 2)
    assert loaded.about["level"] == "Medium" and loaded.config == CONFIG


def test_half_precision_decoder_gives_nearly_the_same_image(vae, path):
    codes = np.random.default_rng(0).normal(size=(4, 6)).astype(np.float32)
    difference = load_encoder(path).decode(codes).astype(int) - Encoder(vae).decode(codes).astype(int)
    assert np.abs(difference).max() <= 1


def test_the_same_model_gives_the_same_bytes(tmp_path, vae, path):
    save_vae(tmp_path / "again.safetensors", vae, {"level": "Medium", "render_version": 2})
    assert (tmp_path / "again.safetensors").read_bytes() == path.read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["again.safetensors", "encoder.safetensors"]


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_a_truncated_file_is_refused(path, share):
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with pytest.raises(EncoderFileError, match=f"{path}: truncated, damaged or not a safetensors file"):
        load_encoder(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(EncoderFileError, match=f"{tmp_path / 'none.safetensors'}: no such file"):
        load_encoder(tmp_path / "none.safetensors")


def test_a_misspelt_name_of_a_packaged_encoder_is_named_with_what_there_is():
    known = "default, geometry, geometry-tasks"
    message = rf"geometri: no such file \(did you mean 'geometry'\?\); .* or one of: {known}$"
    with pytest.raises(EncoderFileError, match=message):
        load_encoder("geometri")


def test_the_folder_of_a_run_stands_for_the_file_in_it(path):
    codes = synthetic_frames(4, 64)
    loaded = load_encoder(path.parent)
    assert loaded.about["path"] == str(path)
    assert np.array_equal(loaded(codes), load_encoder(path)(codes))


def test_a_folder_without_an_encoder_is_refused(tmp_path):
    with pytest.raises(EncoderFileError, match=f"{tmp_path}: a folder without encoder.safetensors, which `thalweg enc"):
        load_encoder(tmp_path)


def test_a_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    save_file({"weight": torch.zeros(3)}, path)
    with pytest.raises(EncoderFileError, match="a safetensors file, but no encoder of Thalweg"):
        load_encoder(path)
    write_tensors(path, {"weight": torch.zeros(3)}, {"kind": "encoder training", "format": 1})
    with pytest.raises(EncoderFileError, match=r"no encoder of Thalweg \(its kind: encoder training\)"):
        load_encoder(path)


def changed(path, tensors=None, **about):
    """The same file with other tensors or another text."""
    from safetensors import safe_open

    with safe_open(path, "pt") as file:
        old = json.loads(file.metadata()[KEY])
    write_tensors(path, load_file(path) | (tensors or {}), old | about)


def test_another_format_is_refused(path):
    changed(path, format=99)
    with pytest.raises(EncoderFileError, match=f"{path}: format 99, but this Thalweg reads format 1"):
        load_encoder(path)


def test_an_unknown_key_in_the_configuration_is_refused(path):
    changed(path, config={"latent": 6, "colour": "blue"})
    with pytest.raises(EncoderFileError, match=f"{path}: the configuration has colour, latent, not "):
        load_encoder(path)


def test_a_bad_value_in_the_configuration_is_refused(path, vae):
    changed(path, config={**vars(vae.config), "inputs": "sonar"})
    with pytest.raises(EncoderFileError, match=f"{path}: bad configuration: unknown inputs 'sonar'"):
        load_encoder(path)


def test_tensors_that_do_not_fit_are_refused(path):
    changed(path, {"mean.bias": torch.zeros(7)})
    with pytest.raises(EncoderFileError, match=r"tensor mean.bias has shape \(7,\), not \(6,\)"):
        load_vae(path)


def test_numbers_that_are_not_finite_are_refused(path):
    changed(path, {"mean.bias": torch.full((6,), torch.nan)})
    with pytest.raises(EncoderFileError, match=r"mean.bias holds numbers that are not finite"):
        load_vae(path)


def test_tensors_too_large_for_half_precision_stay_float32(path):
    large = VAE(CONFIG)
    variances = [tensor for name, tensor in large.state_dict().items() if name.endswith("running_var")]
    for variance in variances:
        variance.fill_(1e6)
    save_vae(path, large, {})
    loaded, _ = load_vae(path)
    assert (
        all((tensor == 1e6).all() for name, tensor in loaded.state_dict().items() if name.endswith("running_var"))
        and len(variances) > 4
    )


def test_another_latent_size_is_refused(path):
    assert load_encoder(path, latent=6).latent == 6
    with pytest.raises(EncoderFileError, match=f"{path}: encodes to 6 numbers, but 16 are needed"):
        load_encoder(path, latent=16)


def test_a_write_that_fails_leaves_the_old_file(path, monkeypatch):
    before = path.read_bytes()

    def full(*_):
        raise OSError("disk full")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="disk full"):
        save_vae(path, VAE(CONFIG), {})
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["encoder.safetensors"]


def test_a_size_that_the_tensors_do_not_have_takes_no_memory(path, vae):
    for size in ({"latent": 10**12}, {"latent": 10**40}, {"size_px": 64 * 10**6}):
        changed(path, config={**vars(vae.config), **size})
        with pytest.raises(EncoderFileError, match=f"{path}: (tensor .* has shape|bad configuration)"):
            load_encoder(path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("mean.bias", torch.full((6,), 1e30), r"larger than 1e\+09"),
        ("encoder.1.running_var", torch.full((16,), -1.0), "negative, but variances"),
        ("mean.bias", torch.zeros(6, dtype=torch.int32), "int32"),
    ],
)
def test_numbers_that_give_no_code_are_refused(name, value, words, path):
    changed(path, {name: value})
    with pytest.raises(EncoderFileError, match=f"{path}: tensor {name} holds numbers that are {words}"):
        load_vae(path)


def test_a_description_that_is_nested_too_deep_is_refused(path):
    save_file(load_file(path), path, {KEY: "[" * 50_000})
    with pytest.raises(EncoderFileError, match=f"{path}: truncated, damaged or not a safetensors file"):
        load_encoder(path)
