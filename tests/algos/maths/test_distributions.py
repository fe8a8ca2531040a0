"""Choices against all joint actions one by one, Gaussians against torch, and how numbers become options."""

import itertools
import math

import pytest
import torch

from thalweg.algos.maths import categorical, gaussian
from thalweg.algos.policy.distributions import Categoricals, Gaussians

F64 = torch.float64


def logits(seed: int, sizes: tuple[int, ...]) -> torch.Tensor:
    return torch.randn(5, sum(sizes), dtype=F64, generator=torch.Generator().manual_seed(seed))


def joint(distribution: Categoricals, sizes: tuple[int, ...]) -> torch.Tensor:
    """[5, number of joint actions] probabilities by enumeration."""
    p = distribution.log_p.exp()
    return torch.stack(
        [
            torch.stack([p[:, branch, option] for branch, option in enumerate(action)]).prod(0)
            for action in itertools.product(*map(range, sizes))
        ],
        dim=1,
    )


@pytest.mark.parametrize("sizes", [(3, 3, 3, 3), (2, 5, 3), (4,)])
class TestCategorical:
    def test_probabilities_sum_to_one_over_all_joint_actions(self, sizes: tuple[int, ...]):
        assert torch.allclose(
            joint(Categoricals.from_logits(logits(0, sizes), sizes), sizes).sum(1), torch.ones(5, dtype=F64)
        )

    def test_log_prob_is_that_of_the_enumeration(self, sizes: tuple[int, ...]):
        distribution = Categoricals.from_logits(logits(0, sizes), sizes)
        for number, action in enumerate(itertools.product(*map(range, sizes))):
            found = distribution.log_prob(torch.tensor([action] * 5))
            assert torch.allclose(found, joint(distribution, sizes)[:, number].log())

    def test_entropy_and_kl_equal_enumeration(self, sizes: tuple[int, ...]):
        p, q = (Categoricals.from_logits(logits(seed, sizes), sizes) for seed in (1, 2))
        all_p, all_q = joint(p, sizes), joint(q, sizes)
        assert torch.allclose(p.entropy(), -(all_p * all_p.log()).sum(1))
        assert torch.allclose(p.kl(q), (all_p * (all_p / all_q).log()).sum(1))
        assert torch.allclose(p.kl(p), torch.zeros(5, dtype=F64))

    def test_drawn_frequencies_are_the_probabilities(self, sizes: tuple[int, ...]):
        one = Categoricals(Categoricals.from_logits(logits(3, sizes), sizes).log_p[:1].expand(40_000, -1, -1))
        drawn = one.sample(torch.Generator().manual_seed(0))
        for branch, size in enumerate(sizes):
            found = torch.bincount(drawn[:, branch], minlength=size).double() / len(drawn)
            assert torch.allclose(found, one.log_p[0, branch, :size].exp(), atol=0.015)


def test_an_absent_option_is_never_drawn_and_has_no_gradient():
    given = torch.zeros(1000, 5, requires_grad=True)
    distribution = Categoricals.from_logits(given, (2, 3))
    assert distribution.sample(torch.Generator().manual_seed(0))[:, 0].max() == 1
    distribution.entropy().sum().backward()
    assert given.grad is not None and torch.isfinite(given.grad).all()
    assert distribution.entropy()[0].item() == pytest.approx(math.log(2) + math.log(3))


def test_the_edges_of_the_uniform_draw():
    log_p = torch.tensor([[[0.25, 0.25, 0.5]]]).log()
    for uniform, option in ((0.0, 0), (0.2499, 0), (0.25, 1), (0.5, 2), (1 - 2**-24, 2)):
        assert categorical.sample(log_p, torch.tensor([[uniform]])).item() == option


def test_gaussian_by_hand():
    mean, log_std = torch.tensor([[1.0, 0.0]], dtype=F64), torch.tensor([[0.0, math.log(2.0)]], dtype=F64)
    # N(1, 1) at 2 and N(0, 2) at 2: -1/2 - log √2π, and -1/2 - log 2 - log √2π
    expected = -1.0 - math.log(2.0) - math.log(2 * math.pi)
    assert gaussian.log_prob(mean, log_std, torch.tensor([[2.0, 2.0]], dtype=F64)).item() == pytest.approx(expected)
    assert gaussian.entropy(log_std).item() == pytest.approx(math.log(2.0) + math.log(2 * math.pi * math.e))
    other = torch.zeros_like(mean)
    # KL(N(1,1) ‖ N(0,1)) = 1/2;  KL(N(0,2) ‖ N(0,1)) = (4 - 1)/2 - log 2
    assert gaussian.kl(mean, log_std, other, other).item() == pytest.approx(0.5 + 1.5 - math.log(2.0))


def test_gaussian_kl_agrees_with_torch():
    torch.manual_seed(0)
    a, b, c, d = (torch.randn(4, 3, dtype=F64) for _ in range(4))
    normal = torch.distributions.Normal
    expected = torch.distributions.kl_divergence(normal(a, b.exp()), normal(c, d.exp())).sum(-1)
    assert torch.allclose(Gaussians(a, b).kl(Gaussians(c, d)), expected)


@pytest.mark.parametrize(("scaled", "expected"), [(False, [0, 0, 0, 1, 2, 2]), (True, [0, 1, 1, 2, 2, 2])])
def test_a_discretised_sample_is_rounded_and_clamped(scaled: bool, expected: list[int]):
    samples = torch.tensor([[-1.6, -0.4, 0.4, 0.6, 1.6, 9.0]])
    assert gaussian.discretised(samples, torch.full((6,), 3), scaled=scaled).tolist() == [expected]


def test_ties_go_to_the_even_neighbour():
    samples, sizes = torch.tensor([[0.5, 1.5, 2.5]]), torch.full((3,), 4)
    assert gaussian.discretised(samples, sizes, scaled=False).tolist() == [[0, 2, 2]]


def test_shapes_that_would_broadcast_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        categorical.log_prob(torch.zeros(5, 4, 3), torch.zeros(5, 1, dtype=torch.int64))
    with pytest.raises(ValueError, match="same shape"):
        gaussian.log_prob(torch.zeros(5, 2), torch.zeros(2), torch.zeros(5, 2))
