"""Tests of the Adam optimiser against PyTorch's."""

import math

import numpy as np
import pytest
import torch

from thalweg.algos.common.adam import Adam, clip_grad_norm_


def pair(seed: int = 0) -> list[torch.nn.Parameter]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.nn.Parameter(torch.randn(*shape, generator=generator)) for shape in ((7, 3), (5,))]


def descend(parameters: list[torch.nn.Parameter], seed: int) -> None:
    """Some gradient."""
    generator = torch.Generator().manual_seed(seed)
    for parameter in parameters:
        parameter.grad = torch.randn(parameter.shape, generator=generator)


def test_it_is_torchs_adam_to_the_last_bit():
    ours, theirs = pair(), pair()
    one, other = Adam(ours, 0.01), torch.optim.Adam(theirs, lr=0.01, fused=True)
    for seed in range(20):
        for parameters, optimiser in ((ours, one), (theirs, other)):
            descend(parameters, seed)
            optimiser.step()
        assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


def test_a_long_gradient_is_shortened_as_torch_shortens_it():
    ours, theirs = pair(), pair()
    descend(ours, 1)
    descend(theirs, 1)
    assert torch.nn.utils.clip_grad_norm_(theirs, 0.5) > 1.0
    clip_grad_norm_([p.grad for p in ours if p.grad is not None], 0.5)
    for a, b in zip(ours, theirs, strict=True):
        assert a.grad is not None and b.grad is not None
        assert a.grad.numpy() == pytest.approx(b.grad.numpy(), rel=1e-5)


def test_a_short_gradient_stays():
    gradients = [torch.tensor([3.0]), torch.tensor([4.0])]
    clip_grad_norm_(gradients, 5.0)
    clip_grad_norm_(gradients, math.inf)
    assert [g.item() for g in gradients] == [3.0, 4.0]


def test_without_a_gradient_nothing_moves():
    parameters = pair()
    optimiser = Adam(parameters, 0.1)
    descend(parameters, 0)
    optimiser.step()
    optimiser.zero_grad()
    before = [p.detach().clone() for p in parameters]
    optimiser.step()
    assert all(torch.equal(a, b) for a, b in zip(before, parameters, strict=True))


def test_it_resumes_from_its_state_bit_for_bit():
    ours, theirs = pair(), pair()
    one = Adam(ours, 0.01)
    for seed in range(3):
        descend(ours, seed)
        one.step()
    other = Adam(theirs, 0.01)
    other.load_state(one.state())
    with torch.no_grad():
        for a, b in zip(ours, theirs, strict=True):
            b.copy_(a)
    for parameters, optimiser in ((ours, one), (theirs, other)):
        descend(parameters, 9)
        optimiser.step()
    assert all(np.array_equal(a.detach(), b.detach()) for a, b in zip(ours, theirs, strict=True))
