"""Tests of fast inference and of the gradients of stacked perceptrons against plain products and autograd."""

import pytest
import torch

from tests.algos.planning.planning_fixtures import ensemble_for, generator
from thalweg.algos.planning.model.mlp_inference import FEW_ROWS, ROWS_AT_ONCE, MLPInference
from thalweg.algos.policy import mlp_autograd
from thalweg.algos.policy.mlp import StackedMLP


def stack_of() -> StackedMLP:
    return StackedMLP(3, 5, (24, 16), 7, generator=generator(), activation="swish", initial="truncated")


@pytest.mark.parametrize("rows", [1, FEW_ROWS, FEW_ROWS + 1, ROWS_AT_ONCE + 5])
def test_fused_products_equal_plain_ones(rows: int):
    stack, x = stack_of(), torch.randn(3, rows, 5, generator=generator(1))
    with torch.no_grad():
        wanted = stack.reference(x)
    assert torch.allclose(MLPInference(stack.layers)(x), wanted, atol=1e-5)


def test_products_without_onednn_equal_plain_ones(monkeypatch):
    monkeypatch.setattr(mlp_autograd, "FUSED_LINEAR", None)
    stack, x = stack_of(), torch.randn(3, 300, 5, generator=generator(1))
    with torch.no_grad():
        wanted = stack.reference(x)
    assert torch.allclose(MLPInference(stack.layers)(x), wanted, atol=1e-5)


def test_bfloat16_is_close_and_returns_float32():
    stack, x = stack_of(), torch.randn(3, 300, 5, generator=generator(1))
    with torch.no_grad():
        wanted = stack.reference(x)
    found = MLPInference(stack.layers, torch.bfloat16)(x)
    assert found.dtype == torch.float32 and 0 < float((found - wanted).abs().max()) < 0.05


def test_inference_copies_the_weights():
    stack, x = stack_of(), torch.randn(3, 4, 5, generator=generator(1))
    copied = MLPInference(stack.layers)
    before = copied(x)
    stack.flat.data.zero_()
    assert torch.equal(copied(x), before)


@pytest.mark.parametrize("activation", ["tanh", "relu", "swish"])
def test_explicit_gradient_equals_autograd(activation):
    stack = StackedMLP(3, 5, (7, 6), 4, generator=generator(), activation=activation, initial="truncated").double()
    x = torch.randn(3, 9, 5, dtype=torch.float64, generator=generator(1)).requires_grad_()
    found = []
    for forward in (stack.forward, stack.reference):
        stack.flat.grad = x.grad = None
        forward(x).square().sum().backward()
        assert stack.flat.grad is not None and x.grad is not None
        found.append((stack.flat.grad.clone(), x.grad.clone()))
    for ours, theirs in zip(*found, strict=True):
        assert torch.allclose(ours, theirs, atol=1e-12)


def test_truncated_weights_lie_within_two_standard_deviations_and_biases_are_zero():
    stack = StackedMLP(2, 100, (50,), 3, generator=generator(), initial="truncated")
    (weight, bias), _ = stack.layers
    assert float(weight.abs().max()) <= 0.1 and float(weight.std()) == pytest.approx(0.05 * 0.88, rel=0.03)
    assert bias.abs().sum() == 0


def test_network_sizes_match_the_output_layout():
    ensemble = ensemble_for(costs=2)
    assert ensemble.stack.sizes == (3 + 5, 16, 16, 2 * 3 + 2 + 2)
