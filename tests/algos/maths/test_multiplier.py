"""Tests of the moves and weights of a multiplier, by hand."""

import pytest
import torch

from thalweg.algos.maths.multiplier import (
    adam,
    combined,
    pid,
    projected_gradient,
    relative_violation,
    smoothed,
    winds_up,
)

F64 = torch.float64


def test_the_multiplier_rises_over_the_limit_and_falls_under_it_within_its_bounds():
    assert projected_gradient(1.0, 0.4, 0.25, 2.0) == pytest.approx(1.1)
    assert projected_gradient(1.0, -0.1, 0.5, 2.0) == pytest.approx(0.95)
    assert projected_gradient(0.01, -0.1, 0.5, 2.0) == 0.0
    assert projected_gradient(1.9, 0.9, 0.5, 2.0) == 2.0


def test_half_the_limit_and_twice_the_limit_are_equally_far_from_it():
    assert relative_violation(0.2, 0.1) == pytest.approx(0.5)
    assert relative_violation(0.05, 0.1) == pytest.approx(-0.5)
    assert relative_violation(50.0, 25.0) == pytest.approx(0.5)
    assert (relative_violation(0.0, 0.1), relative_violation(0.1, 0.1)) == (-1.0, 0.0)
    assert relative_violation(1.0, 0.1) == pytest.approx(0.9)


def test_any_cost_exceeds_a_limit_of_nothing():
    assert (relative_violation(0.3, 0.0), relative_violation(0.0, 0.0)) == (1.0, 0.0)


def test_an_integral_winds_up_only_where_it_would_push_a_clipped_output_further():
    # I + K_P δ = 1.5 + 2·0.4 = 2.3, above 2
    assert winds_up(2.3, 0.4, 2.0) and winds_up(2.0, 0.4, 2.0)
    assert not winds_up(1.9, 0.4, 2.0) and not winds_up(2.3, -0.1, 2.0) and not winds_up(-0.5, -0.1, 2.0)


def test_first_steps_of_adam_equal_its_rate_for_any_violation():
    for cost in (0.2, 25.0):
        value, moments = adam(0.001, (0.0, 0.0), 1, cost - 0.1, 0.035, 10.0)
        assert value == pytest.approx(0.036, abs=1e-6)
        value, _ = adam(value, moments, 2, cost - 0.1, 0.035, 10.0)
        assert value == pytest.approx(0.071, abs=1e-6)


def test_adam_agrees_with_torch():
    parameter = torch.nn.Parameter(torch.tensor(0.5, dtype=F64))
    optimiser, value, moments = torch.optim.Adam([parameter], lr=0.05), 0.5, (0.0, 0.0)
    for count, cost in enumerate((0.4, 0.0, 0.9, 0.05, 0.1), start=1):
        optimiser.zero_grad()
        (-parameter * (cost - 0.1)).backward()
        optimiser.step()
        value, moments = adam(value, moments, count, cost - 0.1, 0.05, 10.0)
        assert value == pytest.approx(parameter.item(), rel=1e-7)


def test_the_proportional_part_answers_at_once():
    assert pid(0.5, 0.2, 0.0, gain=5.0, derivative=0.0) == pytest.approx(1.5)
    assert pid(0.5, -0.1, 0.0, gain=10.0, derivative=0.0) == pytest.approx(-0.5)


def test_the_derivative_answers_to_growth_and_never_to_a_fall():
    assert pid(0.5, -0.1, 0.3, gain=1.0, derivative=2.0) == pytest.approx(1.0)
    assert pid(0.5, -0.1, -0.3, gain=1.0, derivative=2.0) == pytest.approx(0.4)


def test_an_exponential_mean_keeps_its_share():
    assert smoothed(1.0, 3.0, 0.75) == pytest.approx(1.5)
    assert smoothed(1.0, 3.0, 0.0) == 3.0


@pytest.mark.parametrize(("normalised", "expected"), [(False, [-0.75, 2.0]), (True, [-0.75 / 1.75, 2.0 / 1.75])])
def test_advantages_are_those_of_the_lagrangian(normalised: bool, expected: list[float]):
    # 1 - 0.5·2 - 0.25·3 and 2 - 0.5·(-1) - 0.25·2, over 1 + 0.5 + 0.25 if normalised
    rewards, costs = torch.tensor([1.0, 2.0], dtype=F64), torch.tensor([[2.0, -1.0], [3.0, 2.0]], dtype=F64)
    assert combined(rewards, costs, (0.5, 0.25), normalised=normalised).tolist() == pytest.approx(expected)


def test_each_cost_needs_its_multiplier_and_its_shape():
    with pytest.raises(ValueError, match="each cost needs one multiplier, got 2 costs and 1 multipliers"):
        combined(torch.zeros(3), torch.zeros(2, 3), (0.5,), normalised=False)
    with pytest.raises(ValueError, match="same shape"):
        combined(torch.zeros(3), torch.zeros(2, 4), (0.5, 0.5), normalised=False)
