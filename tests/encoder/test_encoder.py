"""Tests of the frozen encoder: equality with its model, bit-identical codes in any batch, and errors."""

import threading

import numpy as np
import pytest
import torch

from tests.encoder.synthetic_frames import synthetic_frames
from thalweg.core.compute.threads import get_num_threads
from thalweg.encoder import (
    VAE,
    Encoder,
    EncoderFileError,
    EncoderInputError,
    VAEConfig,
    check_render_version,
    load_encoder,
)
from thalweg.encoder.encoder import CHUNKS, PACKAGED
from thalweg.encoder.reconstruction import to_batch


def trained_looking(config: VAEConfig) -> VAE:
    """A model whose norms are far from the identity, as after training."""
    with torch.random.fork_rng():
        torch.manual_seed(3)
        vae = VAE(config)
        for module in vae.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                assert module.running_mean is not None and module.running_var is not None
                for tensor in (module.weight, module.running_var):
                    tensor.data.uniform_(0.5, 2.0)
                for tensor in (module.bias, module.running_mean):
                    tensor.data.normal_(0, 0.3)
    return vae.eval()


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return synthetic_frames(40, 128, seed=5)


@pytest.fixture(scope="module")
def encoder() -> Encoder:
    return Encoder(trained_looking(VAEConfig(latent=16)), {"render_version": 3, "path": "some.safetensors"})


@pytest.mark.parametrize("inputs", ["mask", "rgb+mask"])
@pytest.mark.parametrize("size", [(96, 120), (60, 84)], ids=str)
def test_frames_of_other_sizes_have_the_codes_of_the_model_in_any_batch(inputs, size, frames):
    cut = np.ascontiguousarray(frames[:6, : size[0], : size[1]])
    vae = trained_looking(VAEConfig(inputs=inputs, latent=8, size_px=size))
    with torch.inference_mode():
        expected = vae.encode(to_batch(cut, vae.config))[0].numpy()
    encoder = Encoder(vae)
    codes = encoder(cut)
    assert np.abs(codes - expected).max() < 1e-5 * max(1, np.abs(expected).max()) and expected.std(0).min() > 1e-4
    np.testing.assert_array_equal(encoder(cut[2:3])[0], codes[2])
    assert encoder.decode(codes).shape[:3] == (6, *size)
    with pytest.raises(EncoderInputError, match=f"frames of {size[0]} x {size[1]} pixels, not of 128 x 128"):
        encoder(frames)


@pytest.mark.parametrize("inputs", ["rgb", "mask", "rgb+mask"])
@pytest.mark.parametrize("architecture", ["lean", "paper"])
def test_folded_encoder_equals_the_model(inputs, architecture, frames):
    vae = trained_looking(VAEConfig(inputs=inputs, latent=8, architecture=architecture))
    with torch.inference_mode():
        expected = vae.encode(to_batch(frames[:8], vae.config))[0].numpy()
    codes = Encoder(vae)(frames[:8])
    assert codes.dtype == np.float32 and codes.shape == (8, 8)
    assert np.abs(codes - expected).max() < 1e-5 * max(1, np.abs(expected).max())
    assert expected.std(0).min() > 1e-4, "the frames must have different codes for this to mean anything"


@pytest.mark.parametrize("which", ["default", "rgb", "mask", "rgb+mask"])
def test_code_depends_on_its_own_frame_only(which, frames):
    encoder = load_encoder() if which == "default" else Encoder(trained_looking(VAEConfig(inputs=which, latent=4)))
    together = encoder(frames)
    for count in range(1, 34):
        assert np.array_equal(encoder(frames[:count]), together[:count]), f"{count} frames"
    for size in (1, 2, 3, 7, 16, 17):
        parts = [encoder(frames[start : start + size]) for start in range(0, len(frames), size)]
        assert np.array_equal(np.concatenate(parts), together), f"batches of {size}"
    assert np.array_equal(encoder(frames[::-1])[::-1], together)


@pytest.mark.parametrize("rest", [1, 2, 17])
def test_last_frames_of_a_batch_have_the_same_codes_as_the_first(encoder, frames, rest):
    many = np.concatenate([frames, frames])[: CHUNKS["cpu"] + rest]
    assert np.array_equal(encoder(many)[CHUNKS["cpu"] :], encoder(frames)[CHUNKS["cpu"] - len(frames) :][:rest])


def test_the_linear_layer_gives_the_same_bits_for_any_number_of_rows(encoder):
    features = torch.randn(64, 512, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        together = encoder._linear(features)
        for size in (1, 2, 3, 5, 7, 16, 17):
            assert torch.equal(torch.cat([encoder._linear(part) for part in features.split(size)]), together), size


def test_the_same_frames_give_the_same_bits(encoder, frames):
    assert np.array_equal(encoder(frames[:16]), encoder(frames[:16].copy()))


def test_codes_do_not_depend_on_the_batch_size(encoder, frames):
    many = np.concatenate([frames, frames, frames])
    assert np.array_equal(encoder(many)[80:96], encoder(frames[:16]))
    assert encoder(frames[:0]).shape == (0, 16)


@pytest.mark.parametrize(("inputs", "channels"), [("rgb", slice(0, 3)), ("mask", slice(3, 4))])
def test_channels_of_the_inputs_are_selected(inputs, channels, frames):
    encoder = Encoder(trained_looking(VAEConfig(inputs=inputs, latent=4)))
    assert np.array_equal(encoder(frames[:4]), encoder(frames[:4, ..., channels]))


def test_bfloat16_agrees_with_float32(frames):
    vae = trained_looking(VAEConfig(latent=8))
    exact, coarse = Encoder(vae)(frames[:16]), Encoder(vae, precision="bfloat16")(frames[:16])
    assert 0 < np.abs(exact - coarse).max() < 0.05 * np.abs(exact).max()


def test_decode_gives_frames_of_the_inputs_channels(encoder, frames):
    decoded = encoder.decode(encoder(frames[:3]))
    assert decoded.shape == (3, 128, 128, 4) and decoded.dtype == np.uint8
    with torch.inference_mode():
        expected = encoder.vae.decode(torch.from_numpy(encoder(frames[:3]))).permute(0, 2, 3, 1).numpy() * 255
    assert np.abs(decoded - expected).max() <= 0.5 + 1e-4


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((2, 64, 64, 4), np.uint8), "frames of 128 x 128 pixels, not of 64 x 64"),
        (np.zeros((128, 128, 4), np.uint8), r"not \[128, 128, 4\]"),
        (
            np.zeros((2, 128, 128, 3), np.uint8),
            r"^an encoder of rgb\+mask takes frames \[N, 128, 128, 4\], not \[2, 128, 128, 3\]$",
        ),
        (
            np.zeros((2, 96, 160, 4), np.uint8),
            r"^this encoder takes frames of 128 x 128 pixels, not of 96 x 160 \(height x width\): give the camera"
            " height_px=128 and width_px=128, or use another encoder$",
        ),
        (np.zeros((2, 128, 128, 4), np.float32), "frames must be uint8, not float32"),
    ],
)
def test_wrong_frames_are_named(encoder, frames, message):
    with pytest.raises(EncoderInputError, match=message):
        encoder(frames)


def test_codes_of_the_wrong_size_are_named(encoder):
    with pytest.raises(EncoderInputError, match=r"shape \[N, 16\], not \[2, 8\]"):
        encoder.decode(np.zeros((2, 8), np.float32))


def test_another_render_version_is_refused(encoder):
    check_render_version(encoder, 3)
    with pytest.raises(EncoderFileError, match=r"some.safetensors: trained on .* version 3, .* is version 4"):
        check_render_version(encoder, 4)


def test_an_unknown_precision_is_named():
    with pytest.raises(EncoderInputError, match="unknown precision 'float8'; known: float32, bfloat16"):
        Encoder(VAE(VAEConfig(size_px=64)), precision="float8")


@pytest.mark.parametrize(("setting", "count", "batches"), [("1", 12, [12]), ("2", 12, [6, 6]), ("2", 7, [7])])
def test_each_of_the_configured_threads_uses_one_thread_of_pytorch(
    encoder, frames, monkeypatch, setting, count, batches
):
    if int(setting) > get_num_threads():
        pytest.skip("one core")
    seen = []
    hook = encoder._convolutions.register_forward_hook(
        lambda _, inputs, __: seen.append((threading.get_ident(), torch.get_num_threads(), len(inputs[0])))
    )
    before = torch.get_num_threads()
    monkeypatch.setenv("OMP_NUM_THREADS", setting)
    try:
        torch.set_num_threads(3)  # as a user or another library may do
        codes = encoder(np.resize(frames, (count, *frames.shape[1:])))
        assert torch.get_num_threads() == 3
    finally:
        hook.remove()
        torch.set_num_threads(before)
    assert len({thread for thread, _, _ in seen}) == len(batches)
    assert [threads for _, threads, _ in seen] == [1] * len(batches)
    assert [size for _, _, size in seen] == batches
    np.testing.assert_array_equal(codes, encoder(np.resize(frames, (count, *frames.shape[1:]))))


@pytest.mark.parametrize("name", PACKAGED)
def test_loading_one_leaves_the_global_generator_alone(name: str):
    before = torch.get_rng_state()
    load_encoder(name)
    assert torch.equal(torch.get_rng_state(), before)
