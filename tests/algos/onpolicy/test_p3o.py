"""Tests of what P3O alone does: its clipped surrogate."""

import pytest
import torch

from thalweg.algos.onpolicy.p3o import P3OConfig, policy_loss


@pytest.mark.parametrize(("clip_cost", "penalty"), [(True, 0.15), (False, 0.0)])
def test_p3o_clips_the_surrogate_of_the_cost_only_if_told(clip_cost: bool, penalty: float):
    # As in test_constrained_losses: 1.5 - 1.2 + 0.8 - 0.5 of four where it is clipped, else 1.5 - 1.5 + 0.5 - 0.5
    ratio = torch.tensor([1.5, 1.5, 0.5, 0.5], dtype=torch.float64)
    costs, none = torch.tensor([[1.0], [-1.0], [1.0], [-1.0]], dtype=torch.float64), torch.zeros_like(ratio)
    config = P3OConfig(clip_cost=clip_cost)
    _, found = policy_loss(config, ratio.log(), none, none, costs, torch.zeros(1), 1.0, none)
    assert found.tolist() == pytest.approx([penalty])
