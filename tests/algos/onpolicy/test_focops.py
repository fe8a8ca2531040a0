"""The gradient of FOCOPS's loss inside and outside the trust region."""

from typing import Any

import pytest
import torch

from thalweg.algos.onpolicy.focops import FOCOPSConfig, policy_loss


def gradient(config: FOCOPSConfig) -> torch.Tensor:
    """Return the gradient [2, 3] of the loss in the logits: one state near the old policy, one far from it."""
    logits = torch.tensor([[0.05, 0.0, 0.0], [1.0, 0.0, 0.0]], dtype=torch.float64, requires_grad=True)
    old, new = torch.zeros(2, 3, dtype=torch.float64).log_softmax(-1), logits.log_softmax(-1)
    kl, entropy = (new.exp() * (new - old)).sum(-1), -(new.exp() * new).sum(-1)
    assert (kl <= config.trust_radius).tolist() == [True, False]
    policy_loss(config, new[:, 0], old[:, 0], kl, torch.ones(2, dtype=torch.float64), entropy).backward()
    assert logits.grad is not None
    return logits.grad


def test_outside_the_trust_region_only_the_entropy_has_a_gradient():
    without, little, more = (gradient(FOCOPSConfig(entropy=weight)) for weight in (0.0, 0.01, 0.02))
    assert without[0].abs().sum() > 0 and without[1].abs().sum() == 0
    # c H / 2 of the far state: dH/dlogit_k = -p_k (log p_k + H)
    p = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64).softmax(-1)
    entropy = -(p * p.log()).sum()
    assert little[1].numpy() == pytest.approx((0.01 / 2 * p * (p.log() + entropy)).numpy(), abs=1e-12)
    assert more[1].numpy() == pytest.approx(2 * little[1].numpy())


@pytest.mark.parametrize(("mask", "wanted"), [("state", (0.01 - 4.0) / 2), ("batch", 0.01 / 2 - 0.5 * (4.0 + 8.0) / 2)])
def test_the_mask_is_that_of_the_config(mask: Any, wanted: float):
    # ρ A / λ is 2·3/1.5 = 4 and 4·3/1.5 = 8; the second state is outside
    log_prob, none = torch.tensor([2.0, 4.0], dtype=torch.float64).log(), torch.zeros(2, dtype=torch.float64)
    kl, advantages = torch.tensor([0.01, 0.5], dtype=torch.float64), torch.tensor([3.0, 3.0], dtype=torch.float64)
    config = FOCOPSConfig(mask=mask, temperature=1.5, trust_radius=0.02, entropy=0.0)
    assert policy_loss(config, log_prob, none, kl, advantages, none).item() == pytest.approx(wanted)
