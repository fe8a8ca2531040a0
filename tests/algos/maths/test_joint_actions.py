"""Joint actions: every sum over them is the loop over all branches."""

import itertools

import pytest
import torch

from thalweg.algos.maths import joint_actions
from thalweg.algos.policy.distributions import Categoricals

F64 = torch.float64
SIZES = [(3, 3, 3, 3), (2, 5, 3), (4,)]


def policy(sizes: tuple[int, ...]) -> Categoricals:
    logits = torch.randn(6, sum(sizes), dtype=F64, generator=torch.Generator().manual_seed(1))
    return Categoricals.from_logits(logits, sizes)


@pytest.mark.parametrize("sizes", SIZES)
def test_joint_actions_are_numbered_as_they_are_enumerated(sizes: tuple[int, ...]):
    expected = list(itertools.product(*map(range, sizes)))
    assert joint_actions.enumerated(sizes).tolist() == [list(action) for action in expected]
    assert joint_actions.numbers(joint_actions.enumerated(sizes), sizes).tolist() == list(range(len(expected)))


@pytest.mark.parametrize("sizes", SIZES)
def test_the_log_probability_of_each_is_the_sum_over_its_branches(sizes: tuple[int, ...]):
    log_p = policy(sizes).log_p
    found = joint_actions.log_prob(log_p, joint_actions.selection(sizes).to(F64))
    for number, action in enumerate(itertools.product(*map(range, sizes))):
        for state in range(6):
            one_by_one = sum(float(log_p[state, branch, option]) for branch, option in enumerate(action))
            assert float(found[state, number]) == pytest.approx(one_by_one, rel=1e-12)
    assert found.exp().sum(-1).tolist() == pytest.approx([1.0] * 6)


@pytest.mark.parametrize("sizes", SIZES)
def test_an_expectation_is_the_loop_over_all_joint_actions(sizes: tuple[int, ...]):
    log_p = policy(sizes).log_p
    actions = list(itertools.product(*map(range, sizes)))
    values = torch.randn(6, len(actions), dtype=F64, generator=torch.Generator().manual_seed(2))
    found = joint_actions.expectation(joint_actions.log_prob(log_p, joint_actions.selection(sizes).to(F64)), values)
    for state in range(6):
        total = 0.0
        for number, action in enumerate(actions):
            probability = 1.0
            for branch, option in enumerate(action):
                probability *= float(log_p[state, branch, option].exp())
            total += probability * float(values[state, number])
        assert float(found[state]) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("sizes", SIZES)
def test_the_entropy_of_the_joint_action_is_the_sum_over_branches(sizes: tuple[int, ...]):
    one = policy(sizes)
    log_p = joint_actions.log_prob(one.log_p, joint_actions.selection(sizes).to(F64))
    assert torch.allclose(-joint_actions.expectation(log_p, log_p), one.entropy())
