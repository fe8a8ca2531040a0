"""Tests of the autoencoder's layers and loss against shapes and values computed by hand."""

import math

import pytest
import torch
from torch import nn

from thalweg.encoder import VAE, EncoderInputError, VAEConfig, kl_divergence, vae_loss


@pytest.mark.parametrize("architecture", ["lean", "paper"])
@pytest.mark.parametrize(("inputs", "channels"), [("rgb", 3), ("mask", 1), ("rgb+mask", 4)])
def test_shapes_follow_the_config(architecture, inputs, channels):
    vae = VAE(VAEConfig(inputs=inputs, latent=5, architecture=architecture, size_px=64))
    images = torch.rand(2, channels, 64, 64)
    reconstruction, mean, log_variance = vae(images, torch.zeros(2, 5))
    assert reconstruction.shape == images.shape
    assert mean.shape == log_variance.shape == (2, 5)
    assert reconstruction.min() >= 0 and reconstruction.max() <= 1


@pytest.mark.parametrize(("architecture", "size"), [("lean", (96, 160)), ("lean", (40, 84)), ("paper", (40, 84))])
def test_images_have_the_size_of_the_frames(architecture, size):
    vae, images = (
        VAE(VAEConfig(inputs="mask", latent=5, architecture=architecture, size_px=size)),
        torch.rand(2, 1, *size),
    )
    with torch.inference_mode():
        assert vae(images, torch.zeros(2, 5))[0].shape == images.shape


def test_the_paper_architecture_has_the_papers_layers():
    vae = VAE(VAEConfig(architecture="paper"))
    down = [layer for layer in vae.encoder if isinstance(layer, nn.Conv2d)]
    up = [layer for layer in vae.decoder if isinstance(layer, nn.ConvTranspose2d)]
    assert [layer.out_channels for layer in down] == [32, 64, 128, 256, 512, 1024]
    assert [layer.in_channels for layer in up] == [1024, 512, 256, 128, 64, 32]
    assert {(layer.kernel_size, layer.stride, layer.padding) for layer in down} == {((3, 3), (2, 2), (1, 1))}
    assert vae.mean.in_features == vae.log_variance.in_features == 1024 * 2 * 2


def test_layers_halve_each_side_and_round_up():
    # 96 x 160 after six halvings: 2 x 3 (1.5 x 2.5 before); the decoder begins with 3 x 5 blocks of 32 pixels.
    vae = VAE(VAEConfig(size_px=(96, 160)))
    assert vae.mean.in_features == 128 * 2 * 3 and vae.expand.out_features == 128 * 3 * 5


def test_noise_moves_the_code_by_its_standard_deviation():
    vae = VAE(VAEConfig(latent=3, size_px=64)).eval()
    images, noise = torch.rand(2, 4, 64, 64), torch.tensor([[1.0, -2.0, 0.5], [0.0, 3.0, -1.0]])
    reconstruction, mean, log_variance = vae(images, noise)
    expected = vae.decode(mean + noise * torch.exp(log_variance / 2))
    assert torch.equal(reconstruction, expected)
    assert not torch.equal(reconstruction, vae.decode(mean))


def test_kl_of_a_standard_normal_is_zero():
    assert kl_divergence(torch.zeros(4, 8), torch.zeros(4, 8)).item() == 0


def test_kl_equals_its_closed_form_by_hand():
    # One number with mean 1, variance 1: 1/2. One with mean 0, variance e: (e - 1 - 1) / 2. Averaged over two codes.
    mean, log_variance = torch.tensor([[1.0, 0.0], [0.0, 0.0]]), torch.tensor([[0.0, 1.0], [0.0, 0.0]])
    assert kl_divergence(mean, log_variance).item() == pytest.approx((0.5 + (math.e - 2) / 2) / 2)


def test_kl_equals_the_one_of_torch():
    torch.manual_seed(0)
    mean, log_variance = torch.randn(6, 4), torch.randn(6, 4)
    code = torch.distributions.Normal(mean, torch.exp(log_variance / 2))
    expected = torch.distributions.kl_divergence(code, torch.distributions.Normal(0.0, 1.0)).sum(1).mean()
    assert kl_divergence(mean, log_variance).item() == pytest.approx(expected.item(), rel=1e-5)


def test_loss_is_the_mean_square_and_the_weighted_kl():
    images = torch.tensor([[[[0.0, 1.0]]], [[[0.5, 0.5]]]])
    reconstruction = torch.tensor([[[[0.5, 1.0]]], [[[0.5, 0.0]]]])
    mean, log_variance = torch.tensor([[2.0], [0.0]]), torch.zeros(2, 1)
    loss, error, divergence = vae_loss(images, reconstruction, mean, log_variance, 0.01)
    assert error.item() == pytest.approx((0.25 + 0 + 0 + 0.25) / 4)
    assert divergence.item() == pytest.approx((2.0 + 0) / 2)
    assert loss.item() == pytest.approx(0.125 + 0.01 * 1.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"inputs": "depth"}, r"unknown inputs 'depth'; known: rgb, mask, rgb\+mask"),
        ({"architecture": "huge"}, "unknown architecture 'huge'; known: lean, paper"),
        ({"latent": 0}, "latent must be a whole number from 1 to 4096, got 0"),
        ({"size_px": 32}, "size_px: it must be a whole number from 33, or height and width, got 32"),
        ({"learning_rate": 0.0}, "learning_rate must be a finite number above 0, got 0.0"),
    ],
)
def test_bad_settings_name_the_value(settings, message):
    with pytest.raises(EncoderInputError, match=message):
        VAEConfig(**settings)
