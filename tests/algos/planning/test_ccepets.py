"""Tests of the critic's loss of CCEPETS against values computed by hand."""

import pytest
import torch

from thalweg.algos.planning.ccepets import value_loss


def test_value_loss_equals_hand_computed_value():
    values, next_values, rewards = (
        torch.tensor(x, dtype=torch.float64) for x in ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [0.5, 0.25, 1.0])
    )
    ended = torch.tensor([False, True, False])
    # errors: 1 - (0.5 + 0.9·4), 2 - 0.25, 3 - (1 + 0.9·6)
    expected = 0.5 * ((1 - 4.1) ** 2 + 1.75**2 + (3 - 6.4) ** 2) / 3
    assert float(value_loss(values, next_values, rewards, ended, 0.9)) == pytest.approx(expected)


def test_no_gradient_flows_through_the_target():
    values = torch.zeros(2, requires_grad=True)
    value_loss(values, torch.ones(2), torch.ones(2), torch.tensor([False, True]), 0.5).backward()
    assert values.grad is not None and values.grad.tolist() == pytest.approx([-0.75, -0.5])
