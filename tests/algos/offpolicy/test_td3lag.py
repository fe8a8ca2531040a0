"""Tests of TD3Lag: its loss computed by hand, its targets by loops."""

from typing import Any

import pytest
import torch

from tests.algos.offpolicy.learners import SPACES, C, batch_of, layer_by_layer, learner_for, perturb
from thalweg.algos.offpolicy.deterministic import policy_loss
from thalweg.algos.offpolicy.td3lag import TD3LagConfig

F64 = torch.float64


def test_the_policy_loss_equals_a_hand_computation():
    values = torch.tensor([[4.0, 2.0], [1.0, 0.0]], dtype=F64)
    outputs = torch.tensor([[2.0], [0.0]], dtype=F64)
    # λ = 3: (4 - 3) / 4 and 2 / 4; E[z²] = 2
    assert float(policy_loss(TD3LagConfig(output_decay=0.5), values, outputs, (3.0,))) == pytest.approx(-0.375 + 1.0)


def greedy(learner, outputs: torch.Tensor) -> torch.Tensor:
    if not learner.policy.actions.sizes:
        return outputs.tanh()
    return torch.nn.functional.one_hot(outputs.view(len(outputs), 2, 3).argmax(-1), 3).flatten(1).double()


@pytest.mark.parametrize("critic_size", [0, C])
@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
def test_targets_take_the_smaller_reward_and_the_larger_cost_of_two_critics(space, critic_size):
    still: dict[str, Any] = {"target_noise": 0.0, "target_temperature": 0.0}
    learner = learner_for("TD3Lag", SPACES[space], critic_size, cost_critics=2, **still)
    perturb(learner)
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator))
    action = greedy(learner, layer_by_layer(learner.agent.target_actor, batch.next_obs)[0])
    q = layer_by_layer(learner.agent.target_critics, torch.cat([batch.next_seen, action], 1))[..., 0]
    expected = torch.stack([torch.minimum(q[0], q[1]), torch.maximum(q[2], q[3])])
    assert torch.allclose(learner._next_values(batch).double(), expected, atol=1e-4)


@pytest.mark.parametrize("critic_size", [0, C])
@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
def test_omnisafes_cost_target_uses_the_policys_own_action_without_noise(space, critic_size):
    found = {}
    for cost_target in ("smoothed", "online"):
        learner = learner_for(
            "TD3Lag", SPACES[space], critic_size, cost_target=cost_target, target_noise=0.4, target_temperature=0.4
        )
        perturb(learner)
        batch = batch_of(learner, learner.policy.actions.uniform(9, torch.Generator().manual_seed(1)))
        learner.agent.generator.manual_seed(5)
        found[cost_target] = learner._next_values(batch).double()
    online = greedy(learner, layer_by_layer(learner.policy.actor.stack, batch.next_obs)[0])  # pyright: ignore
    q = layer_by_layer(learner.agent.target_critics, torch.cat([batch.next_seen, online], 1))[..., 0]  # pyright: ignore
    assert torch.equal(found["smoothed"][0], found["online"][0])
    assert torch.allclose(found["online"][1], q[2], atol=1e-4)
    assert not torch.allclose(found["smoothed"][1], q[2], atol=1e-2)


@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
def test_targets_are_random_around_the_target_policy(space):
    learner = learner_for("TD3Lag", SPACES[space], target_noise=0.4, target_temperature=0.4)
    perturb(learner)
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator))
    draws = torch.stack([learner._next_values(batch) for _ in range(20)])
    assert (draws.std(0) > 1e-4).any() and draws.std(0).isfinite().all()


@pytest.mark.parametrize("critic_size", [0, C])
def test_the_policys_gradient_uses_one_reward_critic_not_the_smaller_of_two(critic_size: int):
    still: dict[str, Any] = {"learning_rate": 0.0, "critic_learning_rate": 0.0}
    learner = learner_for("TD3Lag", SPACES["Box"], critic_size, policy_delay=1, **still)
    perturb(learner)
    learner.agent.multipliers.each[0].value = 1.5
    batch = batch_of(learner, learner.policy.actions.uniform(9, learner.agent.generator))
    learner._step(batch)
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    found, actor.flat.grad = actor.flat.grad, None
    outputs = actor.reference(batch.obs)[0]
    q = critics.reference(torch.cat([batch.seen, outputs.tanh()], 1))[..., 0]
    (-((q[1] - 1.5 * q[2]) / 2.5).mean() + learner.config.output_decay * outputs.square().mean()).backward()
    assert found is not None and actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=1e-5) and found.abs().max() > 1e-3
