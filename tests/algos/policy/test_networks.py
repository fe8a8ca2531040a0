"""Perceptrons computed together, against torch's own gradient of the same function."""

import copy
import math
from typing import Any

import gymnasium as gym
import pytest
import torch

from thalweg.algos.policy import mlp_autograd as chain
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.mlp_autograd import FUSED_LINEAR, MIN_ROWS, Activation, layers_of
from thalweg.algos.policy.networks import Actor, Critics, NetworkShape

F64 = torch.float64
K, B, D = 3, 7, 4
ACTIVATIONS: tuple[Activation, ...] = ("tanh", "relu")


def stack(
    activation: Activation = "tanh", hidden: tuple[int, ...] = (6, 5), count: int = K, **settings: Any
) -> StackedMLP:
    generator = torch.Generator().manual_seed(0)
    made = StackedMLP(count, D, hidden, 2, activation=activation, generator=generator, **settings).double()
    with torch.no_grad():  # zero biases would hide a wrong gradient of theirs
        made.flat.add_(0.1 * torch.randn(made.flat.shape, dtype=F64, generator=generator))
    return made


def inputs(shared: bool) -> torch.Tensor:
    shape = (B, D) if shared else (K, B, D)
    return torch.randn(shape, dtype=F64, generator=torch.Generator().manual_seed(1)).requires_grad_()


def by_hand(one: StackedMLP, x: torch.Tensor) -> torch.Tensor:
    """Network after network, layer after layer, with weights cut from the vector one by one."""
    found = []
    for k in range(one.count):
        hidden, at = x if x.dim() == 2 else x[k], 0
        for layer, (before, after) in enumerate(zip(one.sizes, one.sizes[1:], strict=False)):
            weights = one.flat[at : at + one.count * before * after].view(one.count, before, after)
            at += weights.numel()
            biases = one.flat[at : at + one.count * after].view(one.count, after)
            at += biases.numel()
            hidden = hidden @ weights[k] + biases[k]
            if layer < len(one.sizes) - 2:
                hidden = hidden.tanh() if one.activation == "tanh" else hidden.clamp(min=0)
        found.append(hidden)
    return torch.stack(found)


@pytest.mark.parametrize("shared", [True, False], ids=["shared", "apart"])
@pytest.mark.parametrize("activation", ACTIVATIONS)
class TestStack:
    def test_its_values_are_those_of_each_network_alone(self, activation: Activation, shared: bool):
        one, x = stack(activation), inputs(shared)
        assert torch.allclose(one(x), by_hand(one, x), atol=1e-12)
        assert torch.allclose(one.reference(x), by_hand(one, x), atol=1e-12)

    def test_its_gradient_is_the_one_that_torch_records(self, activation: Activation, shared: bool):
        one, x = stack(activation), inputs(shared)
        weights = torch.randn(K, B, 2, dtype=F64, generator=torch.Generator().manual_seed(2))
        found = torch.autograd.grad((one(x) * weights).sum(), (x, one.flat))
        expected = torch.autograd.grad((one.reference(x) * weights).sum(), (x, one.flat))
        for ours, theirs in zip(found, expected, strict=True):
            assert torch.allclose(ours, theirs, atol=1e-12) and theirs.abs().sum() > 0

    def test_without_a_gradient_of_its_input_that_of_the_parameters_is_the_same(
        self, activation: Activation, shared: bool
    ):
        one, x = stack(activation), inputs(shared)
        (both, _), (alone,) = (
            torch.autograd.grad(one(x).sum(), (one.flat, x)),
            torch.autograd.grad(one(x.detach()).sum(), one.flat),
        )
        assert torch.equal(both, alone)

    def test_its_gradient_is_that_of_small_differences(self, activation: Activation, shared: bool):
        one, x = stack(activation), inputs(shared)

        def of(x: torch.Tensor, flat: torch.Tensor) -> torch.Tensor:
            return torch.func.functional_call(one, {"flat": flat}, (x,))

        assert torch.autograd.gradcheck(of, (x, one.flat.detach().clone().requires_grad_()))

    def test_frozen_the_parameters_are_constants_and_the_input_is_not(self, activation: Activation, shared: bool):
        one, x = stack(activation), inputs(shared)
        (expected,) = torch.autograd.grad(one(x).square().sum(), x)
        one(x, frozen=True).square().sum().backward()
        assert x.grad is not None and torch.equal(x.grad, expected)
        assert one.flat.grad is None


@pytest.mark.skipif(FUSED_LINEAR is None, reason="this torch has no product of oneDNN's")
@pytest.mark.parametrize("shared", [True, False], ids=["shared", "apart"])
@pytest.mark.parametrize("activation", ["tanh", "relu", "swish"])
@pytest.mark.parametrize("processor", ["znver4", "znver5"])
def test_wide_networks_by_onednn_are_those_that_torch_records(
    activation: Any, shared: bool, processor: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(chain, "WEIGHT_GRADS_BY_MKL", chain.mkl_is_faster_for_weight_grads(processor))
    generator = torch.Generator().manual_seed(0)
    one = StackedMLP(K, D, (200, 130), 2, activation=activation, generator=generator)
    with torch.no_grad():
        one.flat.add_(0.02 * torch.randn(one.flat.shape, generator=generator))
    shape = (MIN_ROWS, D) if shared else (K, MIN_ROWS, D)
    x = torch.randn(shape, generator=generator).requires_grad_()
    above = torch.randn(K, MIN_ROWS, 2, generator=generator)
    assert torch.allclose(one(x), one.reference(x), atol=1e-5)
    found = torch.autograd.grad((one(x) * above).sum(), (x, one.flat))
    expected = torch.autograd.grad((one.reference(x) * above).sum(), (x, one.flat))
    for ours, theirs in zip(found, expected, strict=True):
        assert torch.allclose(ours, theirs, rtol=1e-4, atol=2e-4) and theirs.abs().max() > 0.1
    (alone,) = torch.autograd.grad((one(x, frozen=True) * above).sum(), x)
    assert torch.equal(alone, found[0])
    _, back = one.forward_and_backward(x.detach())
    back(above)
    assert one.flat.grad is not None and torch.equal(one.flat.grad, found[1])
    if shared:
        some = slice(0, 2)
        said, through = one.forward_and_input_backward(x.detach(), some)
        (expected,) = torch.autograd.grad((one.reference(x)[some] * above[some]).sum(), x)
        assert torch.equal(said, one(x)[some].detach())
        assert torch.allclose(through(above[some]), expected, rtol=1e-4, atol=2e-4)


def test_a_copy_learns_by_itself_even_where_its_original_lay():
    generator = torch.Generator().manual_seed(0)
    for _ in range(20):
        one = StackedMLP(1, D, (160,), 1, activation="relu", generator=generator)
        x, above = torch.randn(MIN_ROWS, D, generator=generator), torch.ones(1, MIN_ROWS, 1)
        one.forward_and_backward(x)[1](above)
        twin = copy.deepcopy(one)
        twin.flat.grad = None
        del one
        twin.forward_and_backward(x)[1](above)
        (expected,) = torch.autograd.grad(twin.reference(x).sum(), twin.flat)
        assert twin.flat.grad is not None and torch.allclose(twin.flat.grad, expected, rtol=1e-4, atol=1e-3)


def test_without_hidden_layers_it_is_linear():
    one, x = stack(hidden=()), inputs(shared=True)
    weight, bias = one.flat[: K * D * 2].view(K, D, 2), one.flat[K * D * 2 :].view(K, 1, 2)
    assert torch.allclose(one(x), x @ weight + bias, atol=1e-12)


def test_other_parameters_can_stand_for_its_own():
    one, other, x = stack(), stack("tanh"), inputs(shared=True)
    with torch.no_grad():
        other.flat.mul_(0.5)
    assert torch.equal(one.reference(x, other.flat), other.reference(x))


def test_the_autograd_reference_can_be_differentiated_twice():
    one, x = stack(), inputs(shared=True)
    (slope,) = torch.autograd.grad(one.reference(x).sum(), x, create_graph=True)
    (curve,) = torch.autograd.grad(slope.square().sum(), one.flat)
    assert torch.isfinite(curve).all() and curve.abs().sum() > 0
    (slope,) = torch.autograd.grad(one(x).sum(), x, create_graph=True)
    with pytest.raises(RuntimeError, match="does not require grad"):
        torch.autograd.grad(slope.square().sum(), one.flat)


def test_parameters_changed_before_the_gradient_are_noticed():
    one, x = stack(), inputs(shared=True)
    loss = one(x).sum()
    with torch.no_grad():
        one.flat.mul_(2.0)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        loss.backward()


def layers(one: StackedMLP) -> list[tuple[torch.Tensor, torch.Tensor]]:
    return [(weight.detach(), bias.detach()) for weight, bias in layers_of(one.flat, one.count, one.sizes)]


def test_orthogonal_weights_keep_lengths_times_their_gain():
    made = StackedMLP(2, 8, (8, 8), 8, last_gain=0.01, generator=torch.Generator().manual_seed(0))
    for (weight, bias), gain in zip(layers(made), (math.sqrt(2), math.sqrt(2), 0.01), strict=True):
        assert not bias.any()
        for k in range(2):
            assert torch.allclose(weight[k] @ weight[k].T, gain**2 * torch.eye(8), atol=1e-5)
    assert not torch.equal(layers(made)[0][0][0], layers(made)[0][0][1])


def test_kaiming_weights_and_biases_fill_the_range_of_torchs_own_layers():
    made = StackedMLP(1, 16, (256,), 64, initial="kaiming", generator=torch.Generator().manual_seed(0))
    for (weight, bias), bound in zip(layers(made), (1 / 4, 1 / 16), strict=True):
        for part in (weight, bias):
            assert 0.9 * bound < part.abs().max() <= bound
            assert part.std().item() == pytest.approx(bound / math.sqrt(3), rel=0.15)


def test_the_same_generator_makes_the_same_network():
    one, two = (StackedMLP(2, D, (8,), 1, generator=torch.Generator().manual_seed(5)) for _ in range(2))
    assert torch.equal(one.flat, two.flat)


def test_critics_computed_together_are_those_computed_alone():
    critics = Critics(2, D, NetworkShape((8, 8)), torch.Generator().manual_seed(0))
    x = torch.randn(B, D)
    assert torch.allclose(critics(x), by_hand(critics.stack, x).squeeze(-1), atol=1e-6)


def test_only_a_gaussian_has_deviations_of_its_own():
    box, generator = gym.spaces.Box(-1.0, 1.0, (2,)), torch.Generator()
    actors = {
        kind: Actor(D, actions_of(box, continuous=kind), NetworkShape((8,)), generator)
        for kind in ("gaussian", "squashed", "point")
    }
    assert {kind for kind, actor in actors.items() if actor.log_std is not None} == {"gaussian"}
    parameters = actors["gaussian"](torch.randn(B, D))
    assert parameters.shape == (B, 4) and not parameters[:, 2:].any()
    assert actors["squashed"](torch.randn(B, D)).shape == (B, 4) and actors["point"](torch.randn(B, D)).shape == (B, 2)
