"""Tests of the frozen convolutions: equality of oneDNN's one operation with the two layers that it stands for."""

import pytest
import torch

from thalweg.encoder import leaky_convolution
from thalweg.encoder.leaky_convolution import LeakyConvolution
from thalweg.encoder.vae import LEAK


@pytest.fixture
def layer() -> torch.nn.Conv2d:
    generator = torch.Generator().manual_seed(0)
    layer = torch.nn.Conv2d(4, 16, 3, 2, 1).requires_grad_(False)
    layer.weight.normal_(generator=generator)
    assert layer.bias is not None
    layer.bias.normal_(generator=generator)
    return layer.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("count", [2, 8, 11])
@pytest.mark.parametrize("fused", [True, False])
def test_it_is_the_convolution_followed_by_the_leaky_relu(layer, monkeypatch, count, fused):
    if not fused:
        monkeypatch.setattr(leaky_convolution, "FUSED", None)
    elif leaky_convolution.FUSED is None:
        pytest.skip("PyTorch without oneDNN")
    images = torch.randn(count, 4, 32, 32, generator=torch.Generator().manual_seed(1))
    images = images.contiguous(memory_format=torch.channels_last)
    with torch.inference_mode():
        expected = torch.nn.functional.leaky_relu(layer(images), LEAK)
        found = LeakyConvolution(layer, (32, 32))(images)
    assert (expected < 0).any() and (expected > 0).any()
    assert found.shape == (count, 16, 16, 16) and torch.equal(found, expected)


def test_an_operation_that_computes_something_else_is_not_used(monkeypatch):
    monkeypatch.setattr(torch.ops.mkldnn, "_convolution_pointwise", lambda images, *_: images[:, :, ::2, ::2])
    assert leaky_convolution._fused_operation() is None
