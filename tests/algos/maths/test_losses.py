"""Tests of the losses of PPO and FOCOPS, by hand, and of the errors of critics."""

import math

import pytest
import torch

from thalweg.algos.maths import losses

F64 = torch.float64


def tensor(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=F64)


def test_ppo_clips_only_what_would_gain():
    # ρ = 1.5 and 0.5 with ε = 0.2: min(1.5, 1.2)·1, min(1.5·-1, 1.2·-1), min(0.5, 0.8)·1, min(0.5·-1, 0.8·-1)
    ratio, advantages = tensor(1.5, 1.5, 0.5, 0.5), tensor(1, -1, 1, -1)
    found = losses.ppo_clip(ratio.log(), torch.zeros_like(ratio), advantages, 0.2)
    assert found.item() == pytest.approx(-(1.2 - 1.5 + 0.5 - 0.8) / 4)


def test_focops_by_hand():
    # (0.01 - 2·3/1.5) for the first; the second is outside and counts nothing.
    found = losses.focops(
        tensor(2.0).log().repeat(2), tensor(0, 0), tensor(0.01, 0.5), tensor(3, 3), temperature=1.5, radius=0.02
    )
    assert found.item() == pytest.approx((0.01 - 4.0) / 2)


def moved_policy(shifts: tuple[float, ...]) -> tuple[torch.Tensor, torch.Tensor]:
    """Logits [B, 3], each state's moved by its shift from the old ones, and the old log-probabilities."""
    old = torch.zeros(len(shifts), 3, dtype=F64)
    new = old.clone()
    new[:, 0] += torch.tensor(shifts, dtype=F64)
    return new.requires_grad_(), old.log_softmax(-1)


@pytest.mark.parametrize("mask", ["state", "batch"])
def test_the_gradient_of_focops_outside_the_trust_region(mask):
    logits, old = moved_policy((0.05, 1.0, 0.1))
    new = logits.log_softmax(-1)
    kl = (new.exp() * (new - old)).sum(-1)
    assert (kl <= 0.02).tolist() == [True, False, True]
    losses.focops(new[:, 0], old[:, 0], kl, tensor(1, 1, 1), temperature=1.5, radius=0.02, mask=mask).backward()
    assert logits.grad is not None
    size = logits.grad.abs().sum(-1)
    assert size[0] > 0 and size[2] > 0
    if mask == "state":
        assert size[1] == 0.0
    else:
        assert size[1] > 0.0  # the defect that this variant is there to show


def test_the_batch_mask_is_the_mean_of_the_broadcast_matrix():
    log_prob, kl, advantages = tensor(0.1, -0.2, 0.3), tensor(0.01, 0.5, 0.02), tensor(1, -2, 3)
    inside = (kl <= 0.02).to(F64)
    matrix = (kl.unsqueeze(1) - log_prob.exp() * advantages / 1.5) * inside.unsqueeze(1)
    found = losses.focops(log_prob, tensor(0, 0, 0), kl, advantages, temperature=1.5, radius=0.02, mask="batch")
    assert found.item() == pytest.approx(matrix.mean().item())


def test_a_kl_with_an_axis_too_many_is_refused():
    with pytest.raises(ValueError, match="same shape"):
        losses.focops(torch.zeros(5), torch.zeros(5), torch.zeros(5, 1), torch.zeros(5), temperature=1.5, radius=0.02)


def test_losses_of_critics_are_reported_separately():
    found = losses.squared_error(torch.tensor([[1.0, 2.0], [0.0, 0.0]]), torch.tensor([[1.0, 4.0], [1.0, 1.0]]))
    assert found.tolist() == [1.0, 0.5]


def test_the_slope_of_critic_errors_is_that_which_torch_finds():
    predictions, targets = torch.randn(2, 3, 5, dtype=F64, generator=torch.Generator().manual_seed(0))
    predictions.requires_grad_()
    losses.squared_error(predictions, targets).sum().backward()
    assert predictions.grad is not None
    assert torch.allclose(losses.squared_error_grad(predictions.detach(), targets), predictions.grad)


def test_explained_variance():
    targets = tensor(1, 2, 3, 4)
    assert losses.explained_variance(targets, targets) == 1.0
    assert losses.explained_variance(torch.zeros_like(targets), targets) == 0.0
    assert math.isnan(losses.explained_variance(targets, torch.ones_like(targets)))
