"""Tests of the loss of a model: it is written out another way, and its minimum predicts what was seen."""

import math

import pytest
import torch

from thalweg.algos.maths import dynamics

F64 = torch.float64


def test_the_bounded_variance_is_that_of_two_soft_clamps():
    raw = torch.linspace(-30, 30, 61, dtype=F64)
    low, high = torch.tensor(-10.0, dtype=F64), torch.tensor(0.5, dtype=F64)
    softplus = torch.nn.functional.softplus
    clamped = high - softplus(high - raw)
    clamped = low + softplus(clamped - low)
    assert dynamics.bounded_variance(raw, low, high).log().tolist() == pytest.approx(clamped.tolist(), rel=1e-9)


def test_the_likelihood_is_that_of_a_gaussian_without_its_constant():
    mean, variance, target = (torch.tensor([x], dtype=F64) for x in (0.3, 0.7, -1.1))
    normal = torch.distributions.Normal(mean, variance.sqrt())
    wanted = -normal.log_prob(target) - 0.5 * math.log(2 * math.pi)
    assert float(dynamics.gaussian_nll(mean, variance, target)) == pytest.approx(float(wanted))


@pytest.mark.parametrize(("rate", "weight"), [(0.03, 1.0), (0.03, 10.0), (0.4, 5.0)])
def test_balancing_does_not_shift_what_is_predicted(rate, weight):
    """The gradient of the loss is zero where σ(z) is the mean of the targets, whatever the weight."""
    logit = torch.tensor([math.log(rate / (1 - rate))], dtype=F64, requires_grad=True)
    w = torch.tensor(weight, dtype=F64)
    expected = rate * dynamics.balanced_cross_entropy(logit, torch.ones_like(logit), w)
    expected = expected + (1 - rate) * dynamics.balanced_cross_entropy(logit, torch.zeros_like(logit), w)
    expected.backward()
    assert logit.grad is not None and float(logit.grad) == pytest.approx(0, abs=1e-12)


def test_without_a_weight_it_is_the_cross_entropy_and_targets_may_lie_between():
    logit, target = torch.tensor([0.4], dtype=F64), torch.tensor([0.25], dtype=F64)
    p = 1 / (1 + math.exp(-0.4))
    wanted = -(0.25 * math.log(p) + 0.75 * math.log(1 - p))
    found = dynamics.balanced_cross_entropy(logit, target, torch.tensor(1.0, dtype=F64))
    assert float(found) == pytest.approx(wanted)


def test_a_rare_event_counts_as_much_as_its_absence_within_bounds():
    rates = torch.tensor([0.2, 0.5, 0.9, 0.001, 0.0])
    assert dynamics.rarity(rates, 10.0).tolist() == pytest.approx([4, 1, 1, 10, 10])
