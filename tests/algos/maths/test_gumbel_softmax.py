"""Straight-through choices: what goes forward is a choice, what comes back is a softmax."""

import pytest
import torch

from thalweg.algos.maths.gumbel_softmax import gumbel, one_hot, straight_through, straight_through_grad

F64 = torch.float64


def drawn(seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    """log π and noise [5, 4, 3]."""
    generator = torch.Generator().manual_seed(seed)
    log_p = torch.randn(5, 4, 3, dtype=F64, generator=generator).log_softmax(-1)
    return log_p, gumbel(torch.rand(5, 4, 3, dtype=F64, generator=generator))


def test_forward_is_the_option_that_the_noise_chooses():
    log_p, noise = drawn()
    found, _ = straight_through(log_p, noise, 0.7)
    assert torch.equal(found.sum(-1), torch.ones(5, 4, dtype=F64)) and set(found.unique().tolist()) == {0.0, 1.0}
    assert torch.equal(found.argmax(-1), (log_p + noise).argmax(-1))


@pytest.mark.parametrize("temperature", [0.3, 1.0, 2.5])
def test_backward_is_the_softmax_at_that_temperature(temperature: float):
    log_p, noise = drawn()
    weight = torch.randn(5, 4, 3, dtype=F64, generator=torch.Generator().manual_seed(3))
    _, soft = straight_through(log_p, noise, temperature)
    found = straight_through_grad(weight, soft, temperature)
    (((log_p.requires_grad_() + noise) / temperature).softmax(-1) * weight).sum().backward()
    assert log_p.grad is not None
    assert torch.allclose(found, log_p.grad, atol=1e-14) and found.abs().sum() > 0


def test_the_gradient_by_hand():
    # Two options at log ½ and no noise: y = (½, ½), dy₀/dl = (¼, -¼) / τ
    log_p = torch.tensor([[[0.5, 0.5]]], dtype=F64).log()
    hard, soft = straight_through(log_p, torch.zeros(1, 1, 2, dtype=F64), 0.5)
    assert hard.tolist() == [[[1.0, 0.0]]]
    of_first = torch.tensor([[[1.0, 0.0]]], dtype=F64)
    assert straight_through_grad(of_first, soft, 0.5).flatten().tolist() == pytest.approx([0.5, -0.5])


def test_noise_chooses_each_option_as_often_as_it_is_probable():
    p = torch.tensor([0.1, 0.2, 0.7], dtype=F64)
    noise = gumbel(torch.rand(40_000, 1, 3, dtype=F64, generator=torch.Generator().manual_seed(0)))
    found = straight_through(p.log().expand(40_000, 1, 3), noise, 1.0)[0].mean((0, 1))
    assert found.tolist() == pytest.approx(p.tolist(), abs=0.01)


def test_uniform_numbers_at_the_edges_give_finite_noise():
    assert torch.isfinite(gumbel(torch.tensor([0.0, 1.0 - 2**-24]))).all()


def test_without_noise_the_most_probable_option_is_chosen():
    log_p, noise = drawn()
    found, _ = straight_through(log_p, torch.zeros_like(noise), 1.0)
    assert torch.equal(found.argmax(-1), log_p.argmax(-1))


def test_one_hot_by_hand():
    assert one_hot(torch.tensor([[2, 0]]), 3).tolist() == [[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]]


def test_shapes_that_would_broadcast_are_refused():
    with pytest.raises(ValueError, match="same shape"):
        straight_through(torch.zeros(5, 4, 3), torch.zeros(5, 1, 3), 1.0)
