"""Compiled loops compared with torch, and with the same lines run as Python."""

import numpy as np
import pytest
import torch

from thalweg.algos.policy import mlp_numba
from thalweg.algos.policy.mlp import MAX_COMPILED_WIDTH, StackedMLP
from thalweg.algos.policy.networks import minibatch_bounds

K, B, D = 3, 7, 5
ACTIVATIONS = ("tanh", "relu")


def stack_and_rows(activation: str, hidden: tuple[int, ...] = (6, 9)) -> tuple[StackedMLP, torch.Tensor]:
    """Return a stack whose biases are not zero, and rows."""
    generator = torch.Generator().manual_seed(0)
    one = StackedMLP(K, D, hidden, 2, activation=activation, generator=generator)  # pyright: ignore[reportArgumentType]
    with torch.no_grad():
        one.flat.add_(0.1 * torch.randn(one.flat.shape, generator=generator))
    return one, torch.randn(B, D, generator=generator)


@pytest.mark.parametrize("hidden", [(6, 9), (16,), ()], ids=str)
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_outputs_and_gradients_are_those_of_torch(activation: str, hidden: tuple[int, ...]):
    one, x = stack_and_rows(activation, hidden)
    above = torch.randn(K, B, 2, generator=torch.Generator().manual_seed(1))
    assert one.compilable
    found, back = one.forward_and_backward(x)
    expected = one.reference(x)
    assert torch.allclose(found, expected, atol=2e-6) and not found.requires_grad
    back(above)
    assert one.flat.grad is not None
    (slope,) = torch.autograd.grad((expected * above).sum(), one.flat)
    assert torch.allclose(one.flat.grad, slope, atol=1e-5) and slope.abs().max() > 0.5


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_batched_products_give_the_same_as_compiled_loops(activation: str):
    one, x = stack_and_rows(activation)
    found, back = one.forward_and_backward(x)
    back(torch.ones_like(found))
    slope, one.flat.grad, one.compilable = one.flat.grad, None, False
    other, back = one.forward_and_backward(x)
    back(torch.ones_like(other))
    assert slope is not None and one.flat.grad is not None
    assert torch.allclose(found, other, atol=2e-6) and torch.allclose(slope, one.flat.grad, atol=1e-5)


def test_wide_networks_and_swish_are_not_compiled():
    generator = torch.Generator()
    assert StackedMLP(1, MAX_COMPILED_WIDTH, (MAX_COMPILED_WIDTH,), 1, generator=generator).compilable
    assert not StackedMLP(1, 2, (MAX_COMPILED_WIDTH + 1,), 1, generator=generator).compilable
    assert not StackedMLP(1, 2, (8,), 1, activation="swish", generator=generator).compilable


@pytest.mark.parametrize("activation", [mlp_numba.TANH, mlp_numba.RELU])
def test_compiled_loops_give_the_bits_of_the_same_lines_in_python(activation: int, monkeypatch: pytest.MonkeyPatch):
    one, x = stack_and_rows(ACTIVATIONS[activation])
    flat, seen, above = one.flat.detach().numpy(), x.numpy(), np.ones((K, B, 2), np.float32)

    def both() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        hidden, found = np.empty((K, B * 15), np.float32), np.empty((K, B, 2), np.float32)
        slopes = np.empty_like(flat)
        mlp_numba.outputs(seen, one.arrays(), hidden, found)
        mlp_numba.gradients(seen, one.arrays(), hidden, above, slopes)
        return hidden, found, slopes

    compiled = both()
    for name in ("outputs", "gradients", "parameters", "affine", "activate", "through_activation", "tanh"):
        monkeypatch.setattr(mlp_numba, name, getattr(mlp_numba, name).py_func)
    for ours, theirs in zip(compiled, both(), strict=True):
        assert np.array_equal(ours, theirs)


def test_tanh_is_close_to_the_librarys_and_at_most_one():
    x = np.linspace(-12.0, 12.0, 100_001).astype(np.float32)
    values = x[None].copy()
    mlp_numba.activate(values, mlp_numba.TANH)
    assert np.abs(values[0] - np.tanh(x.astype(np.float64))).max() < 4e-7
    assert np.abs(values).max() <= 1.0
    near = np.array([[1e-20, -3e-7, 0.0]], np.float32)
    expected = near.copy()
    mlp_numba.activate(near, mlp_numba.TANH)
    assert np.array_equal(near, expected)


def test_minibatches_are_split_as_torch_splits_them():
    for rows, minibatch in ((20_000, 64), (7, 3), (5, 64), (130, 64)):
        parts = torch.arange(rows).tensor_split(max(1, round(rows / minibatch)))
        assert np.diff(minibatch_bounds(rows, minibatch)).tolist() == [len(part) for part in parts]
