"""Targets of an imitation against numbers worked by hand."""

import math

import pytest
import torch

from thalweg.algos.imitation.targets import (
    cross_entropy,
    expected_regret,
    move_log_probs,
    regrets,
    soft_targets,
)

WORTHS = torch.tensor([[3.0, 2.5, -1000.0]])


def test_regrets_are_bounded():
    assert regrets(WORTHS, worst=20.0).tolist() == [[0.0, 0.5, 20.0]]


def test_soft_targets_are_a_softmax_of_worths_and_never_fatal():
    found = soft_targets(regrets(WORTHS, 20.0), 0.5)[0]
    best = 1.0 / (1.0 + math.exp(-1.0) + math.exp(-40.0))
    assert found.tolist() == pytest.approx([best, best * math.exp(-1.0), 0.0], abs=1e-6)
    sharp = soft_targets(regrets(WORTHS, 20.0), 0.01)[0]
    assert sharp[0] == pytest.approx(1.0)


def test_moves_of_independent_branches():
    branches = [torch.tensor([[0.7, 0.3]]).log(), torch.tensor([[0.2, 0.5, 0.3]]).log()]
    options = torch.tensor([[0, 0], [1, 2], [0, 1]])
    assert move_log_probs(branches, options).exp()[0].tolist() == pytest.approx([0.14, 0.09, 0.35])


def test_losses_by_hand():
    log_probs = torch.tensor([[0.5, 0.25, 0.25]]).log()
    regret = torch.tensor([[0.0, 0.5, 20.0]])
    assert expected_regret(regret, log_probs, worst=20.0).item() == pytest.approx(0.125 + 5.0)
    assert cross_entropy(torch.tensor([[1.0, 0.0, 0.0]]), log_probs).item() == pytest.approx(math.log(2.0))


def test_options_of_no_move_are_as_bad_as_can_be():
    log_probs = torch.tensor([[0.5, 0.25]]).log()
    assert expected_regret(torch.tensor([[0.0, 0.5]]), log_probs, worst=20.0).item() == pytest.approx(0.125 + 5.0)
