"""The comparison of heads: a distribution over whole moves, the student that has it, and the table."""

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
from thalweg.env.spaces import action_space
from thalweg.train.imitation.teachers import OPTIONS

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
MARKS = "before\n<!-- heads -->\nold\n<!-- /heads -->\nafter\n"


@pytest.fixture
def heads(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in ("any_river", "ladder_arms", "river_flights", "heads"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("heads")


def test_a_joint_distribution_is_that_of_moves_and_not_of_options(heads: ModuleType):
    moves = torch.tensor([[0, 0], [2, 2], [1, 0]])
    found = heads.JointMoves(torch.tensor([[0.5, 0.25, 0.25], [0.1, 0.2, 0.7]]).log(), moves)
    other = heads.JointMoves(torch.full((2, 3), 1 / 3).log(), moves)
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


def test_the_joint_student_has_a_logit_for_each_move_and_acts_by_the_greatest(heads: ModuleType, tmp_path: Path):
    imitation = heads.JointImitation(tmp_path / "run", 1000)
    config = ImitationConfig(filters=(4, 4), features=8, memory_size=4, hidden=(8,))
    student = imitation.new_student(config, actions_of(action_space("multidiscrete")), heads.CONTEXT)
    assert student.policy.actor.stack.sizes[-1] == len(OPTIONS) == 54
    logits = torch.zeros(1, 54)
    logits[0, 17] = 3.0
    assert student.log_probs(logits).exp().sum().item() == pytest.approx(1.0)
    assert student.policy.actions.distribution(logits).mode().tolist() == [OPTIONS[17].tolist()]
    player = student.policy.player(2)
    actions = player(np.zeros((2, 128, 128, 4), np.uint8), np.array([True, True]))
    assert all(row in OPTIONS.tolist() for row in actions.tolist())


def test_heads_are_trained_alike_and_a_row_names_its_versions(heads: ModuleType):
    joint, branches = (heads.Trial(head, 1, 2048, 10) for head in (heads.JOINT, heads.BRANCHES))
    assert joint.key[1:] == branches.key[1:] and joint.folder != branches.folder
    assert dict(zip(heads.KEY, joint.key, strict=True))["imitation"] == str(heads.versions.IMITATION)


def test_the_page_has_a_line_for_each_head(heads: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    rows = []
    for seed, cost in enumerate((0.2, 0.3, 0.4)):
        values = {"return_Medium": "9.000", "states": "16384", "regret": f"{cost:.4f}"}
        trial = heads.Trial(heads.JOINT, seed, heads.STEPS, heads.EPISODES)
        filled = dict.fromkeys((*heads.RETURNS, *heads.COMMON), "0.5000") | values
        rows.append(dict(zip(heads.KEY, trial.key, strict=True)) | filled)
    page, table = tmp_path / "page.md", tmp_path / "heads.csv"
    page.write_text(MARKS)
    for row in rows:
        heads.append(table, heads.COLUMNS, row)
    monkeypatch.setattr(heads, "PAGE", page)
    heads.main(["--write", "--out", str(table)])
    written = " ".join(page.read_text().split())
    # The half width of three seeds 0.1 apart is 4.3027 x 0.1 / sqrt(3).
    assert "| over joint moves | 3 | 9.00 [9.00, 9.00] |" in written and "| 0.3000 [0.0516, 0.5484] |" in written
    assert "| return, Medium |" in written and "| cross-entropy |" in written
    assert "one for each branch" not in written and written.startswith("before") and written.endswith("after")
    outdated = [row | {"imitation": "0"} for row in rows]
    table.unlink()
    for row in outdated:
        heads.append(table, heads.COLUMNS, row)
    heads.main(["--write", "--out", str(table)])
    assert "Nothing was measured with today's versions." in page.read_text()
