"""Tests of critics of several signals, and of target networks."""

import pytest
import torch

from thalweg.algos.offpolicy.critics import Critics, TargetNetworks
from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.networks import NetworkShape


def critics(reward_critics: int, costs: int, cost_critics: int) -> Critics:
    generator = torch.Generator().manual_seed(0)
    return Critics(
        reward_critics, costs, cost_critics, inputs=3, outputs=1, shape=NetworkShape((4,), "relu"), generator=generator
    )


@pytest.mark.parametrize(
    ("counts", "values", "expected"),
    [
        ((1, 1, 1), [5.0, 1.0], [5.0, 1.0]),
        ((2, 1, 1), [5.0, 4.0, 1.0], [4.0, 1.0]),
        ((2, 1, 2), [4.0, 5.0, 1.0, 2.0], [4.0, 2.0]),
        ((1, 2, 2), [7.0, 1.0, 20.0, 2.0, 10.0], [7.0, 2.0, 20.0]),
        ((2, 2, 1), [7.0, 8.0, 1.0, 2.0], [7.0, 1.0, 2.0]),
    ],
)
def test_pessimistic_takes_the_rewards_smallest_and_each_costs_largest_estimate(counts, values, expected):
    one = critics(*counts)
    assert one.pessimistic(torch.tensor(values).view(-1, 1)).flatten().tolist() == expected
    assert one.pessimistic(torch.tensor(values).view(-1, 1, 1).expand(-1, 2, 3)).shape == (len(expected), 2, 3)


@pytest.mark.parametrize("counts", [(1, 1, 1), (2, 1, 1), (2, 2, 2), (1, 2, 2), (2, 1, 2)])
def test_one_per_signal_selects_one_critic_of_each_signal(counts):
    one, x = critics(*counts), torch.randn(5, 3)
    assert one.signal[one.one_per_signal].tolist() == list(range(1 + counts[1]))
    assert torch.equal(one.stack.forward_and_input_backward(x, one.one_per_signal)[0], one.stack(x)[one.one_per_signal])
    assert one.signal.tolist() == [0] * counts[0] + [k for _ in range(counts[2]) for k in range(1, 1 + counts[1])]


def stacks() -> list[StackedMLP]:
    generator = torch.Generator().manual_seed(0)
    return [StackedMLP(count, 3, (4,), 2, generator=generator) for count in (1, 3)]


def test_soft_update_moves_the_copies_by_tau():
    both = stacks()
    targets, x = TargetNetworks(both), torch.randn(5, 3)
    before = [stack.flat.detach().clone() for stack in both]
    with torch.no_grad():
        for stack in both:
            stack.flat.add_(1.0)
    assert all(torch.equal(target.flat, old) for target, old in zip(targets.copies, before, strict=True))
    targets.soft_update(0.25)
    for stack, target, old in zip(both, targets.copies, before, strict=True):
        assert torch.allclose(target.flat, 0.75 * old + 0.25 * stack.flat.detach())  # (1 - τ) θ' + τ θ
        assert torch.allclose(target(x), target.reference(x)) and not torch.allclose(target(x), stack(x))


def test_an_optimiser_step_changes_the_online_parameters_only():
    both = stacks()
    targets = TargetNetworks(both)
    optimiser = torch.optim.Adam([stack.flat for stack in both], lr=0.1, fused=True)
    sum(stack(torch.ones(2, 3)).sum() for stack in both).backward()  # pyright: ignore
    optimiser.step()
    assert torch.equal(targets.online, torch.cat([stack.flat.detach() for stack in both]))
    assert not torch.equal(targets.online, targets.target)
    assert not any(target.flat.requires_grad for target in targets.copies)
