"""The compiled loops against torch, and against themselves uncompiled."""

import numpy as np
import pytest
import torch

from thalweg.algos.policy import mlp_numba as loops
from thalweg.algos.policy.networks import SMALL, StackedMLP, minibatch_bounds

K, B, D = 3, 7, 5
ACTIVATIONS = ("tanh", "relu")


def made(activation: str, hidden: tuple[int, ...] = (6, 9)) -> tuple[StackedMLP, torch.Tensor]:
    """A stack whose biases are not zero, and rows."""
    generator = torch.Generator().manual_seed(0)
    one = StackedMLP(K, D, hidden, 2, activation=activation, generator=generator)  # pyright: ignore[reportArgumentType]
    with torch.no_grad():
        one.flat.add_(0.1 * torch.randn(one.flat.shape, generator=generator))
    return one, torch.randn(B, D, generator=generator)


@pytest.mark.parametrize("hidden", [(6, 9), (16,), ()], ids=str)
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_outputs_and_gradients_are_those_of_torch(activation: str, hidden: tuple[int, ...]):
    one, x = made(activation, hidden)
    above = torch.randn(K, B, 2, generator=torch.Generator().manual_seed(1))
    assert one.small
    found, back = one.forward_and_backward(x)
    expected = one.reference(x)
    assert torch.allclose(found, expected, atol=2e-6) and not found.requires_grad
    back(above)
    assert one.flat.grad is not None
    (slope,) = torch.autograd.grad((expected * above).sum(), one.flat)
    assert torch.allclose(one.flat.grad, slope, atol=1e-5) and slope.abs().max() > 0.5


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_where_the_loops_are_not_for_it_the_same_comes_out(activation: str):
    one, x = made(activation)
    found, back = one.forward_and_backward(x)
    back(torch.ones_like(found))
    slope, one.flat.grad, one.small = one.flat.grad, None, False
    other, back = one.forward_and_backward(x)
    back(torch.ones_like(other))
    assert slope is not None and one.flat.grad is not None
    assert torch.allclose(found, other, atol=2e-6) and torch.allclose(slope, one.flat.grad, atol=1e-5)


def test_wide_networks_and_those_that_swish_are_left_to_torch():
    generator = torch.Generator()
    assert StackedMLP(1, SMALL, (SMALL,), 1, generator=generator).small
    assert not StackedMLP(1, 2, (SMALL + 1,), 1, generator=generator).small
    assert not StackedMLP(1, 2, (8,), 1, activation="swish", generator=generator).small


@pytest.mark.parametrize("activation", [loops.TANH, loops.RELU])
def test_compiled_they_give_the_bits_of_the_same_lines_in_python(activation: int, monkeypatch: pytest.MonkeyPatch):
    one, x = made(ACTIVATIONS[activation])
    flat, seen, above = one.flat.detach().numpy(), x.numpy(), np.ones((K, B, 2), np.float32)

    def both() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        hidden, found = np.empty((K, B * 15), np.float32), np.empty((K, B, 2), np.float32)
        slopes = np.empty_like(flat)
        loops.outputs(seen, flat, one.sizes_array, activation, hidden, found)
        loops.gradients(seen, flat, one.sizes_array, activation, hidden, above, slopes)
        return hidden, found, slopes

    compiled = both()
    for name in ("outputs", "gradients", "parameters", "affine", "activate", "through", "tanh"):
        monkeypatch.setattr(loops, name, getattr(loops, name).py_func)
    for ours, theirs in zip(compiled, both(), strict=True):
        assert np.array_equal(ours, theirs)


def test_the_tangent_is_near_the_librarys_and_never_beyond_one():
    x = np.linspace(-12.0, 12.0, 100_001).astype(np.float32)
    values = x[None].copy()
    loops.activate(values, loops.TANH)
    assert np.abs(values[0] - np.tanh(x.astype(np.float64))).max() < 4e-7
    assert np.abs(values).max() <= 1.0
    near = np.array([[1e-20, -3e-7, 0.0]], np.float32)
    expected = near.copy()
    loops.activate(near, loops.TANH)
    assert np.array_equal(near, expected)


def test_parts_are_those_that_torch_splits_into():
    for rows, minibatch in ((20_000, 64), (7, 3), (5, 64), (130, 64)):
        parts = torch.arange(rows).tensor_split(max(1, round(rows / minibatch)))
        assert np.diff(minibatch_bounds(rows, minibatch)).tolist() == [len(part) for part in parts]
