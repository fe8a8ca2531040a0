"""Tests of what targets of planners are made of: their bounds, and alpha times the entropy."""

from typing import Any

import pytest
import torch

from tests.algos.planning.test_learners import FEEDBACK, PLANNERS, SMALL, learner_for, rollout_of, updated


def test_alpha_decays_by_its_factor_at_each_gradient_step():
    learner = learner_for("SafeLOOP", auto_alpha=False, alpha=0.2, alpha_decay=0.9)
    learner.update(rollout_of(learner), FEEDBACK)
    assert float(learner.log_alpha.exp()) == pytest.approx(0.2 * 0.9 ** SMALL["critic_steps"])


@pytest.mark.parametrize(("soft_values", "weight"), [(True, 0.3), (False, 0.0)])
def test_targets_contain_alpha_times_the_entropy_only_if_told(
    soft_values: bool, weight: float, monkeypatch: pytest.MonkeyPatch
):
    learner = learner_for("SafeLOOP", auto_alpha=False, alpha=0.3, entropy_in_targets=soft_values)
    asked: list[float] = []

    def next_values(critics: Any, obs: torch.Tensor, alpha: torch.Tensor, generator: Any) -> torch.Tensor:
        asked.append(float(alpha))
        return torch.zeros(len(obs))

    monkeypatch.setattr(learner.soft, "next_values", next_values)
    learner.update(rollout_of(learner), FEEDBACK)
    assert asked == pytest.approx([weight] * SMALL["critic_steps"])


@pytest.mark.parametrize("name", PLANNERS)
def test_the_targets_of_critics_are_held_within_the_bounds(name: str):
    """Critics begin near 0: targets within the bounds are at least 50, others near 0."""
    found = {}
    for bounded in (True, False):
        learner = learner_for(name, return_bounds=(50.0, 60.0), bound_targets=bounded, critic_learning_rate=0.0)
        found[bounded] = updated(learner, 2)[-1]["value_loss"]
    assert found[True] > 500.0 > 50.0 > found[False]


def test_learnt_bounds_are_discounted_by_the_step_and_critics_by_the_decision():
    learner = learner_for("CCEPETS", action_repeat=5, discount=0.9)
    assert learner.agent.returns.discounts == pytest.approx((0.9 ** (1 / 5),))
