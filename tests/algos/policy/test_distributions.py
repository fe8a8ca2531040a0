"""Policies of bounded numbers, against the change of variables done numerically."""

import math
from typing import Any

import pytest
import torch

from thalweg.algos.maths import gaussian
from thalweg.algos.policy.distributions import (
    LOG_STD_RANGE,
    Categoricals,
    Deterministic,
    Gaussians,
    SquashedGaussian,
    TapedDistribution,
)

F64 = torch.float64
CASES = [(0.0, 0.0), (0.4, -1.0), (-0.8, -0.3)]
"""Mean and log standard deviation before tanh."""


def squashed(mean: float, log_std: float, count: int = 1) -> SquashedGaussian:
    return SquashedGaussian(torch.full((count, 1), mean, dtype=F64), torch.full((count, 1), log_std, dtype=F64))


def density(actions: torch.Tensor, mean: float, log_std: float) -> torch.Tensor:
    """[B] of tanh(u), u normal: the slope of P(u < artanh a), without any formula of ours."""
    h = 1e-6
    normal = torch.distributions.Normal(torch.tensor(mean, dtype=F64), torch.tensor(math.exp(log_std), dtype=F64))
    return (normal.cdf((actions + h).atanh()) - normal.cdf((actions - h).atanh())) / (2 * h)


def grid(count: int = 200_001) -> torch.Tensor:
    """Actions all over -1..1."""
    return torch.linspace(-1 + 1e-5, 1 - 1e-5, count, dtype=F64)


@pytest.mark.parametrize(("mean", "log_std"), CASES)
def test_the_log_probability_is_that_of_the_change_of_variables(mean: float, log_std: float):
    actions = torch.tensor([-0.85, -0.6, 0.0, 0.3, 0.8, 0.95], dtype=F64)
    found = squashed(mean, log_std, 6).log_prob(actions.unsqueeze(1))
    assert found.numpy() == pytest.approx(density(actions, mean, log_std).log().numpy(), abs=1e-4)


def test_the_log_probability_adds_up_over_the_numbers_of_an_action():
    both = SquashedGaussian(torch.tensor([[0.0, 0.4]], dtype=F64), torch.tensor([[0.0, -1.0]], dtype=F64))
    action = torch.tensor([[0.3, -0.6]], dtype=F64)
    each = [squashed(*case).log_prob(action[:, k : k + 1]) for k, case in enumerate(CASES[:2])]
    assert both.log_prob(action).item() == pytest.approx(sum(one.item() for one in each))


@pytest.mark.parametrize(("mean", "log_std"), CASES)
def test_probabilities_sum_to_one(mean: float, log_std: float):
    actions = grid()
    log_p = squashed(mean, log_std, len(actions)).log_prob(actions.unsqueeze(1))
    assert torch.trapezoid(log_p.exp(), actions).item() == pytest.approx(1.0, abs=1e-3)


def test_what_is_drawn_brings_its_own_log_probability():
    one = squashed(0.4, -1.0, 1000)
    actions, log_prob = one.rsample(torch.Generator().manual_seed(0))
    assert torch.allclose(log_prob, one.log_prob(actions), atol=1e-6)
    assert torch.equal(actions, one.sample(torch.Generator().manual_seed(0)))
    assert actions.mean().item() == pytest.approx(
        torch.trapezoid(grid() * density(grid(), 0.4, -1.0), grid()).item(), abs=0.03
    )


def test_drawing_carries_the_gradient_of_mean_and_deviation():
    mean = torch.tensor([[0.2]], dtype=F64, requires_grad=True)
    log_std = torch.tensor([[-0.5]], dtype=F64, requires_grad=True)

    def drawn(mean: torch.Tensor, log_std: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return SquashedGaussian(mean, log_std).rsample(torch.Generator().manual_seed(0))

    assert torch.autograd.gradcheck(drawn, (mean, log_std))


def test_gradients_of_a_sample_agree_with_autograd():
    mean, log_std, of_actions = torch.randn(3, 6, 2, dtype=F64, generator=torch.Generator().manual_seed(1))
    log_std[0, 0], of_log_prob = 2.5, torch.linspace(-1.0, 2.0, 6, dtype=F64)  # the first is held at its bound
    actions, log_prob, back = SquashedGaussian(mean, log_std).rsample_and_backward(torch.Generator().manual_seed(0))
    found = back(of_actions, of_log_prob)
    drawn, said = SquashedGaussian(mean.requires_grad_(), log_std.requires_grad_()).rsample(
        torch.Generator().manual_seed(0)
    )
    ((drawn * of_actions).sum() + (said * of_log_prob).sum()).backward()
    assert mean.grad is not None and log_std.grad is not None and float(log_std.grad[0, 0]) == 0.0
    assert torch.equal(actions, drawn.detach()) and torch.equal(log_prob, said.detach())
    assert torch.allclose(found, torch.cat([mean.grad, log_std.grad], -1))


def test_far_out_where_tanh_rounds_to_one_the_log_probability_stays_exact():
    # log(1 - tanh² u) → log 4 - 2u
    before = torch.tensor([[30.0]])
    found = gaussian.squashed_log_prob(torch.zeros(1, 1), torch.zeros(1, 1), before).item()
    assert found == pytest.approx(-0.5 * 900 - 0.5 * math.log(2 * math.pi) - math.log(4.0) + 60.0)
    assert torch.isfinite(SquashedGaussian(torch.zeros(1, 1), torch.zeros(1, 1)).log_prob(torch.ones(1, 1))).all()


def test_the_divergence_is_that_of_the_bounded_numbers():
    (mean_p, std_p), (mean_q, std_q), actions = CASES[1], CASES[2], grid()
    p, q = density(actions, mean_p, std_p), density(actions, mean_q, std_q)
    inside = (p > 1e-12) & (q > 1e-12)
    expected = torch.trapezoid(torch.where(inside, p * (p / q).log(), 0.0), actions).item()
    assert squashed(mean_p, std_p).kl(squashed(mean_q, std_q)).item() == pytest.approx(expected, rel=1e-3)


def test_the_entropy_is_that_of_the_normal_before():
    # Of one number: log σ + ½ log 2πe
    assert squashed(0.4, -1.0).entropy().item() == pytest.approx(-1.0 + 0.5 * math.log(2 * math.pi * math.e))


def test_deviations_stay_within_their_range():
    wild = SquashedGaussian(torch.zeros(1, 2), torch.tensor([[-50.0, 50.0]]))
    assert wild.log_std.tolist() == [list(LOG_STD_RANGE)]


def test_the_most_probable_action_lies_within_the_bounds():
    assert squashed(0.4, -1.0).mode().item() == pytest.approx(math.tanh(0.4))


def test_a_deterministic_distribution_samples_its_point_and_has_no_density():
    point = Deterministic(torch.tensor([[0.25, -0.5]]))
    assert point.sample(None).tolist() == point.mode().tolist() == [[0.25, -0.5]]
    for ask in (lambda: point.log_prob(point.mode()), point.entropy, lambda: point.kl(point)):
        with pytest.raises(TypeError, match=r"a deterministic policy has no|two deterministic policies"):
            ask()


PARTS = {
    "equal branches": lambda parameters: Categoricals.from_logits(parameters, (3, 3)),
    "unequal branches": lambda parameters: Categoricals.from_logits(parameters, (4, 2)),
    "numbers": lambda parameters: Gaussians(*parameters.chunk(2, -1)),
}


@pytest.mark.parametrize("part", list(PARTS))
def test_the_written_slopes_are_those_that_torch_records(part: str):
    generator = torch.Generator().manual_seed(0)
    parameters, other = torch.randn(2, 9, 6, generator=generator, dtype=torch.float64)
    parameters.requires_grad_()
    new, old = PARTS[part](parameters), PARTS[part](other)
    actions = PARTS[part](torch.zeros_like(other)).sample(generator)
    weights = torch.randn(9, generator=generator, dtype=torch.float64)
    for name, given in (("log_prob", (actions,)), ("entropy", ()), ("kl", (old,))):
        number = (getattr(new, name)(*given) * weights).sum()
        (expected,) = torch.autograd.grad(number, parameters, retain_graph=True)
        found = weights.unsqueeze(-1) * getattr(new, f"{name}_grad")(*given)
        assert torch.allclose(found, expected, atol=1e-12) and expected.any()


def test_a_traced_distribution_passes_on_the_gradients_of_all_its_outputs():
    parameters = torch.tensor([[0.5, -0.2, 0.1], [1.0, 0.0, -1.0]], requires_grad=True)
    old, actions = Categoricals.from_logits(torch.zeros(2, 3), (3,)), torch.tensor([[0], [2]])

    def loss(new: Any) -> torch.Tensor:
        return new.log_prob(actions).exp().sum() + new.kl(old).square().sum() - new.entropy().mean()

    (expected,) = torch.autograd.grad(loss(Categoricals.from_logits(parameters, (3,))), parameters)
    traced = TapedDistribution(Categoricals.from_logits(parameters.detach(), (3,)))
    loss(traced).backward()
    assert torch.allclose(traced.parameter_grad(), expected, atol=1e-7)
