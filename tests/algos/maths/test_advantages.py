"""Advantages by hand, at ends and at cuts, and in a world without an end, whose worth is known."""

import pytest
import torch

from thalweg.algos.maths.advantages import centred, gae, standardised, td_target

F64 = torch.float64


def column(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=F64).unsqueeze(1)


def flags(*numbers: int) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.bool).unsqueeze(1)


def test_three_steps_by_hand():
    # δ = 1 + 0.5·2 - 1 = 1;  2 + 0.5·4 - 2 = 2;  3 + 0.5·8 - 4 = 3;  γλ = 0.25
    found = gae(
        column(1, 2, 3), column(1, 2, 4), column(2, 4, 8), flags(0, 0, 0), flags(0, 0, 0), discount=0.5, trace=0.5
    )
    assert found.squeeze().tolist() == [1 + 0.25 * (2 + 0.25 * 3), 2 + 0.25 * 3, 3]


def test_a_termination_is_worth_nothing_afterwards_and_passes_nothing_back():
    # Step 1 ends: δ₁ = 2 - 2 = 0 although V(s₂) = 100; δ₀ = 1 + 0.5·2 - 1 = 1 and Â₀ = 1 + 0.25·0.
    found = gae(
        column(1, 2, 3), column(1, 2, 4), column(2, 100, 8), flags(0, 1, 0), flags(0, 0, 0), discount=0.5, trace=0.5
    )
    assert found.squeeze().tolist() == [1, 0, 3]


def test_a_truncation_is_worth_what_the_critic_says_of_the_final_observation_and_passes_nothing_back():
    # Step 1 is cut off where V = 100: δ₁ = 2 + 50 - 2 = 50, without the 0.25·3 of the next episode.
    found = gae(
        column(1, 2, 3), column(1, 2, 4), column(2, 100, 8), flags(0, 0, 0), flags(0, 1, 0), discount=0.5, trace=0.5
    )
    assert found.squeeze().tolist() == [1 + 0.25 * 50, 50, 3]


def endless_world(as_terminated: bool) -> float:
    """The value that targets settle at where every step pays 1 and the clock cuts every tenth."""
    steps, discount, value = 400, 0.9, 0.0
    cut = torch.zeros(steps, 1, dtype=torch.bool)
    cut[9::10] = True
    never = torch.zeros_like(cut)
    for _ in range(300):
        values = torch.full((steps, 1), value, dtype=F64)
        terminated, truncated = (cut, never) if as_terminated else (never, cut)
        rewards = torch.ones_like(values)
        found = gae(rewards, values, values, terminated, truncated, discount=discount, trace=0.95)
        value = float((found + values).mean())
    return value


def test_an_endless_world_is_worth_one_over_one_minus_gamma():
    assert endless_world(as_terminated=False) == pytest.approx(1 / (1 - 0.9), abs=1e-9)


def test_cutting_off_taken_for_an_end_misses_that_value():
    assert endless_world(as_terminated=True) < 8.0


def test_environments_do_not_mix():
    torch.manual_seed(0)
    rewards, values, after = (torch.randn(20, 3, dtype=F64) for _ in range(3))
    ends, cuts = torch.rand(20, 3) < 0.1, torch.rand(20, 3) < 0.1
    together = gae(rewards, values, after, ends, cuts, discount=0.99, trace=0.95)
    alone = gae(rewards[:, 1:2], values[:, 1:2], after[:, 1:2], ends[:, 1:2], cuts[:, 1:2], discount=0.99, trace=0.95)
    assert torch.equal(together[:, 1:2], alone)


def test_shapes_that_would_broadcast_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        gae(torch.ones(5, 1), torch.ones(5), torch.ones(5), flags(0), flags(0), discount=0.9, trace=0.9)


def test_standardised_and_centred_by_hand():
    numbers = torch.tensor([1.0, 3.0], dtype=F64)
    assert standardised(numbers).tolist() == pytest.approx([-1.0, 1.0])
    assert centred(numbers).tolist() == [-1.0, 1.0]
    assert standardised(torch.tensor([2.0, 2.0], dtype=F64)).tolist() == [0.0, 0.0]


def test_td_targets_of_two_signals_with_different_discounts():
    found = td_target(
        torch.tensor([[1.0, 2.0], [0.0, 1.0]], dtype=F64),
        torch.tensor([[1.0, 0.0], [1.0, 0.0]], dtype=F64),
        torch.tensor([[4.0, 100.0], [0.5, 100.0]], dtype=F64),
        torch.tensor([[0.5], [0.8]], dtype=F64),
    )
    # 1 + 0.5·4 = 3, and 2 at the end; 0 + 0.8·0.5 = 0.4, and 1 at the end
    assert found.tolist() == [[3.0, 2.0], [0.4, 1.0]]


def test_a_signal_may_go_on_where_another_one_ends():
    rewards, goes_on = torch.tensor([[1.0], [1.0]], dtype=F64), torch.tensor([[1.0], [0.0]], dtype=F64)
    values, discounts = torch.tensor([[4.0], [4.0]], dtype=F64), torch.tensor([[0.5], [0.5]], dtype=F64)
    found = td_target(rewards, goes_on, values, discounts)
    assert found.tolist() == [[3.0], [1.0]]


def test_td_targets_refuse_shapes_that_would_broadcast():
    with pytest.raises(ValueError, match="same shape"):
        td_target(torch.zeros(2, 3), torch.zeros(3), torch.zeros(2, 3), torch.zeros(2, 1))
    with pytest.raises(ValueError, match="dimensions"):
        td_target(torch.zeros(2, 3), torch.zeros(2, 3), torch.zeros(2, 3), torch.zeros(2))
