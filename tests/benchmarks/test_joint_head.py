"""The joint head of students: a distribution over whole moves, and the student that has it."""

import importlib
import math
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

from thalweg.algos.imitation.config import ImitationConfig
from thalweg.algos.imitation.targets import cross_entropy, move_log_probs
from thalweg.algos.policy.actions import actions_of
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.spaces import action_space

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def joint_head(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.delitem(sys.modules, "joint_head", raising=False)
    return importlib.import_module("joint_head")


def test_a_joint_distribution_is_that_of_moves_and_not_of_options(joint_head: ModuleType):
    moves = torch.tensor([[0, 0], [2, 2], [1, 0]])
    found = joint_head.JointMoves(torch.tensor([[0.5, 0.25, 0.25], [0.1, 0.2, 0.7]]).log(), moves)
    other = joint_head.JointMoves(torch.full((2, 3), 1 / 3).log(), moves)
    assert found.mode().tolist() == [[0, 0], [1, 0]]
    assert found.log_prob(torch.tensor([[2, 2], [2, 0]])).tolist() == [pytest.approx(math.log(0.25)), -math.inf]
    entropy = 0.5 * math.log(2) + 0.5 * math.log(4)
    assert found.entropy()[0].item() == pytest.approx(entropy)
    assert found.kl(other)[0].item() == pytest.approx(math.log(3) - entropy)
    drawn = found.sample(torch.Generator().manual_seed(0))
    assert all(row in moves.tolist() for row in drawn.tolist())


def test_a_joint_head_can_have_two_opposite_moves_and_branches_cannot():
    """Left and up, or right and down, as good as each other: independent branches also take left and down."""
    moves = torch.tensor([[0, 0], [0, 1], [1, 0], [1, 1]])
    targets = torch.tensor([[0.5, 0.0, 0.0, 0.5]])
    branches = move_log_probs([torch.tensor([[0.5, 0.5]]).log()] * 2, moves)
    joint = torch.tensor([[0.5, 1e-9, 1e-9, 0.5]]).log()
    assert cross_entropy(targets, branches).item() == pytest.approx(math.log(4))
    assert cross_entropy(targets, joint).item() == pytest.approx(math.log(2))


def test_the_joint_student_has_a_logit_for_each_move_and_acts_by_the_greatest(joint_head: ModuleType, tmp_path: Path):
    imitation = joint_head.JointImitation(tmp_path / "run", 1000)
    config = ImitationConfig(filters=(4, 4), features=8, memory_size=4, hidden=(8,))
    student = imitation.new_student(
        config, actions_of(action_space("multidiscrete")), {"observation": config.observation}
    )
    assert student.policy.actor.stack.sizes[-1] == len(MOVE_OPTIONS) == 54
    logits = torch.zeros(1, 54)
    logits[0, 17] = 3.0
    assert student.log_probs(logits).exp().sum().item() == pytest.approx(1.0)
    assert student.policy.actions.distribution(logits).mode().tolist() == [MOVE_OPTIONS[17].tolist()]
    player = student.policy.player(2)
    actions = player(np.zeros((2, 128, 128, 4), np.uint8), np.array([True, True]))
    assert all(row in MOVE_OPTIONS.tolist() for row in actions.tolist())
