"""Tests of DDPGLag: its loss computed by hand, its targets by loops."""

from typing import Any

import pytest
import torch

from tests.algos.offpolicy.learners import SPACES, C, batch_of, layer_by_layer, learner_for, perturb
from thalweg.algos.offpolicy.ddpglag import DDPGLagConfig
from thalweg.algos.offpolicy.deterministic import policy_loss

F64 = torch.float64


def test_the_policy_loss_equals_a_hand_computation():
    values = torch.tensor([[4.0, 2.0], [1.0, 0.0], [0.0, 3.0]], dtype=F64)
    outputs = torch.tensor([[1.0, -1.0], [3.0, 1.0]], dtype=F64)
    # λ = (2, 1): (4 - 2) / 4 = 0.5 and (2 - 3) / 4 = -0.25; E[z²] = 3
    found = policy_loss(DDPGLagConfig(output_decay=0.1), values, outputs, (2.0, 1.0))
    assert float(found) == pytest.approx(-(0.5 - 0.25) / 2 + 0.1 * 3.0)


def test_the_loss_is_that_of_ddpg_without_multipliers():
    values = torch.tensor([[4.0, 2.0], [1.0, 9.0]], dtype=F64)
    found = policy_loss(DDPGLagConfig(output_decay=0.0), values, torch.zeros(2, 1, dtype=F64), (0.0,))
    assert float(found) == pytest.approx(-3.0)


@pytest.mark.parametrize("critic_size", [0, C])
@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
@pytest.mark.parametrize("target_actor", [True, False])
def test_targets_use_the_action_of_the_target_policy_or_as_in_omnisafe_of_the_policy(space, target_actor, critic_size):
    settings: dict[str, Any] = {"target_actor": target_actor, "cost_limits": (0.1, 0.2), "cost_critics": 2}
    learner = learner_for("DDPGLag", SPACES[space], critic_size, **settings)
    perturb(learner)
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator))
    actors = {True: learner.agent.target_actor, False: learner.policy.actor.stack}
    found = learner._next_values(batch)
    for used, actor in actors.items():
        outputs = layer_by_layer(actor, batch.next_obs)[0]
        if space == "Box":
            action = outputs.tanh()
        else:
            action = torch.nn.functional.one_hot(outputs.view(9, 2, 3).argmax(-1), 3).flatten(1).double()
        q = layer_by_layer(learner.agent.target_critics, torch.cat([batch.next_seen, action], 1))[..., 0]
        # one critic of the reward; the first of both costs, then the second of both
        expected = torch.stack([q[0], torch.maximum(q[1], q[3]), torch.maximum(q[2], q[4])])
        assert torch.allclose(found.double(), expected, atol=1e-4) == (used == target_actor)


@pytest.mark.parametrize("critic_size", [0, C])
def test_the_policys_gradient_equals_autograd_through_one_critic_per_signal(critic_size: int):
    """The gradient of the policy's step equals that of the loss by autograd."""
    still: dict[str, Any] = {"learning_rate": 0.0, "critic_learning_rate": 0.0}
    learner = learner_for("DDPGLag", SPACES["Box"], critic_size, cost_critics=2, **still)
    perturb(learner)
    learner.agent.multipliers.each[0].value = 1.5
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator))
    learner._step(batch)
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    found, actor.flat.grad = actor.flat.grad, None
    outputs = actor.reference(batch.obs)[0]
    q = critics.reference(torch.cat([batch.seen, outputs.tanh()], 1))[..., 0]
    loss = -((q[0] - 1.5 * q[1]) / 2.5).mean() + learner.config.output_decay * outputs.square().mean()
    loss.backward()
    assert found is not None and actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=1e-5) and found.abs().max() > 1e-3


@pytest.mark.parametrize("critic_size", [0, C])
def test_the_critics_gradient_equals_that_of_the_squared_error(critic_size: int):
    """The gradient of the critics' step is that of ½ E[(Q - y)²], with y computed by hand."""
    settings: dict[str, Any] = {"learning_rate": 0.0, "critic_learning_rate": 0.0, "discount": 0.9}
    learner = learner_for("DDPGLag", critic_size=critic_size, cost_discount=0.8, **settings)
    perturb(learner)
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator), ends=2)
    next_values = learner._next_values(batch)
    learner._step(batch)
    critics = learner.agent.critics.stack
    found, critics.flat.grad = critics.flat.grad, None
    targets = torch.empty(2, 9)
    for state in range(9):
        for signal, discount in enumerate((0.9, 0.8)):
            value = max(float(next_values[signal, state]), 0.0) if signal else float(next_values[signal, state])
            rest = 0.0 if state < 2 else discount * value
            targets[signal, state] = float(batch.signals[signal, state]) + rest
    (0.5 * (critics.reference(batch.seen_actions)[..., 0] - targets).square().mean(1)).sum().backward()
    assert found is not None and critics.flat.grad is not None
    assert torch.allclose(found, critics.flat.grad, atol=1e-5) and found.abs().max() > 1e-3
