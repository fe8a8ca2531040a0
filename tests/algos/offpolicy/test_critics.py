"""Critics of several signals, and copies that follow them."""

import pytest
import torch

from thalweg.algos.offpolicy.critics import Critics, Slow
from thalweg.algos.policy.networks import NetworkShape, StackedMLP


def critics(rewards: int, costs: int, twins: int) -> Critics:
    generator = torch.Generator().manual_seed(0)
    return Critics(rewards, costs, twins, inputs=3, outputs=1, shape=NetworkShape((4,), "relu"), generator=generator)


@pytest.mark.parametrize(
    ("made", "values", "expected"),
    [
        ((1, 1, 1), [5.0, 1.0], [5.0, 1.0]),
        ((2, 1, 1), [5.0, 4.0, 1.0], [4.0, 1.0]),
        ((2, 1, 2), [4.0, 5.0, 1.0, 2.0], [4.0, 2.0]),
        ((1, 2, 2), [7.0, 1.0, 20.0, 2.0, 10.0], [7.0, 2.0, 20.0]),
        ((2, 2, 1), [7.0, 8.0, 1.0, 2.0], [7.0, 1.0, 2.0]),
    ],
)
def test_of_several_the_rewards_smallest_counts_and_each_costs_largest(made, values, expected):
    one = critics(*made)
    assert one.cautious(torch.tensor(values).view(-1, 1)).flatten().tolist() == expected
    assert one.cautious(torch.tensor(values).view(-1, 1, 1).expand(-1, 2, 3)).shape == (len(expected), 2, 3)


@pytest.mark.parametrize("made", [(1, 1, 1), (2, 1, 1), (2, 2, 2), (1, 2, 2), (2, 1, 2)])
def test_the_leading_critics_are_one_of_each_signal(made):
    one, x = critics(*made), torch.randn(5, 3)
    assert one.signal[one.leading].tolist() == list(range(1 + made[1]))
    assert torch.equal(one.stack.forward_and_input_backward(x, one.leading)[0], one.stack(x)[one.leading])
    assert one.signal.tolist() == [0] * made[0] + [k for _ in range(made[2]) for k in range(1, 1 + made[1])]


def stacks() -> list[StackedMLP]:
    generator = torch.Generator().manual_seed(0)
    return [StackedMLP(count, 3, (4,), 2, generator=generator) for count in (1, 3)]


def test_copies_follow_by_their_share_of_the_way():
    both = stacks()
    slow, x = Slow(both), torch.randn(5, 3)
    before = [stack.flat.detach().clone() for stack in both]
    with torch.no_grad():
        for stack in both:
            stack.flat.add_(1.0)
    assert all(torch.equal(twin.flat, old) for twin, old in zip(slow.copies, before, strict=True))
    slow.follow(0.25)
    for stack, twin, old in zip(both, slow.copies, before, strict=True):
        assert torch.allclose(twin.flat, 0.75 * old + 0.25 * stack.flat.detach())  # (1 - τ) θ' + τ θ
        assert torch.allclose(twin(x), twin.reference(x)) and not torch.allclose(twin(x), stack(x))


def test_an_optimiser_moves_what_the_copies_follow():
    both = stacks()
    slow = Slow(both)
    optimiser = torch.optim.Adam([stack.flat for stack in both], lr=0.1, fused=True)
    sum(stack(torch.ones(2, 3)).sum() for stack in both).backward()  # pyright: ignore
    optimiser.step()
    assert torch.equal(slow.fast, torch.cat([stack.flat.detach() for stack in both]))
    assert not torch.equal(slow.fast, slow.slow)
    assert not any(twin.flat.requires_grad for twin in slow.copies)
