"""Tests of SACLag: losses by hand, sums over joint actions by loops, samples by a numeric change of variables."""

import itertools
import math
from typing import Any

import gymnasium as gym
import pytest
import torch

from tests.algos.offpolicy.learners import SPACES, C, batch_of, layer_by_layer, learner_for, perturb, rollout_of
from tests.algos.rollouts import feedback
from thalweg.algos import AlgorithmError
from thalweg.algos.maths import losses
from thalweg.algos.offpolicy.saclag import SACLagConfig, policy_loss

F64 = torch.float64
RIVER = gym.spaces.MultiDiscrete([3, 3, 3, 3])
ALPHA = torch.tensor(0.3)


def test_the_policy_loss_equals_a_hand_computation():
    values = torch.tensor([[4.0, 2.0], [1.0, 0.0], [0.0, 3.0]], dtype=F64)
    entropy = torch.tensor([1.0, 2.0], dtype=F64)
    # α = ½, λ = (2, 1): (4 + ½ - 2) / 4 = 0.625 and (2 + 1 - 3) / 4 = 0
    found = policy_loss(values, entropy, torch.tensor(0.5, dtype=F64), (2.0, 1.0))
    assert float(found) == pytest.approx(-0.3125)


@pytest.mark.parametrize(("entropy", "grows"), [(0.2, True), (0.8, False)])
def test_alpha_grows_while_the_entropy_is_below_its_target(entropy: float, grows: bool):
    log_alpha = torch.tensor(0.0, requires_grad=True)
    losses.temperature(log_alpha, torch.full((4,), entropy), 0.5).backward()
    assert log_alpha.grad is not None
    assert float(log_alpha.grad) == pytest.approx(entropy - 0.5) and (float(log_alpha.grad) < 0) == grows


def river(critic_size: int = 0, **settings: Any) -> tuple[Any, Any]:
    """A learner with two costs and two critics of each, and a batch of seven states."""
    learner = learner_for("SACLag", RIVER, critic_size, cost_limits=(0.1, 0.2), cost_critics=2, **settings)
    perturb(learner)
    return learner, batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))


def expectations_by_loops(
    learner: Any, obs: torch.Tensor, seen: torch.Tensor, stack: Any
) -> tuple[list[list[float]], list[float], list[list[float]]]:
    """Expectations of min Q_r, max Q_c1, max Q_c2, the entropy, and those at the most probable action, by 81 terms."""
    logits = layer_by_layer(learner.policy.actor.stack, obs)[0].view(-1, 4, 3)
    q = layer_by_layer(stack, seen)
    expected, entropies, modes = [], [], []
    for state in range(len(obs)):
        p = logits[state].softmax(-1)
        sums, entropy, best = [0.0, 0.0, 0.0], 0.0, (-1.0, [0.0])
        for number, action in enumerate(itertools.product(range(3), repeat=4)):
            probability = math.prod(float(p[branch, option]) for branch, option in enumerate(action))
            of = [float(q[k, state, number]) for k in range(6)]
            values = [min(of[0], of[1]), max(of[2], of[4]), max(of[3], of[5])]
            sums = [total + probability * value for total, value in zip(sums, values, strict=True)]
            entropy -= probability * math.log(probability)
            best = max(best, (probability, values))
        expected.append(sums)
        entropies.append(entropy)
        modes.append(best[1])
    return expected, entropies, modes


@pytest.mark.parametrize("critic_size", [0, C])
@pytest.mark.parametrize(("soft_values", "weight"), [(True, 0.3), (False, 0.0)])
def test_the_next_value_is_the_sum_over_all_81_joint_actions(soft_values: bool, weight: float, critic_size: int):
    learner, batch = river(critic_size, entropy_in_targets=soft_values)
    expected, entropies, _ = expectations_by_loops(
        learner, batch.next_obs, batch.next_seen, learner.agent.target_critics
    )
    found = learner.action_form.next_values(learner.agent, batch, ALPHA)
    for state in range(7):
        soft = [expected[state][0] + weight * entropies[state], *expected[state][1:]]
        assert found[:, state].tolist() == pytest.approx(soft, abs=1e-4)


def test_omnisafes_cost_target_uses_the_most_probable_action():
    learner, batch = river(cost_target="mode")
    expected, _, modes = expectations_by_loops(learner, batch.next_obs, batch.next_seen, learner.agent.target_critics)
    found = learner.action_form.next_values(learner.agent, batch, ALPHA)
    for state in range(7):
        soft = [expected[state][0], *modes[state][1:]]
        assert found[:, state].tolist() == pytest.approx(soft, abs=1e-4)
        assert abs(expected[state][1] - modes[state][1]) > 1e-3


def test_the_policys_objective_is_the_sum_over_all_81_joint_actions():
    learner, batch = river()
    expected, entropies, _ = expectations_by_loops(learner, batch.obs, batch.seen, learner.agent.critics.stack)
    q_values, _ = learner.action_form.q_values(learner.agent, batch)
    values, entropy, _ = learner.action_form.objective(learner.agent, batch, q_values)
    for state in range(7):
        assert values[:, state].tolist() == pytest.approx(expected[state], abs=1e-4)
    assert entropy.tolist() == pytest.approx(entropies, abs=1e-5)


@pytest.mark.parametrize("critic_size", [0, C])
def test_the_policys_gradient_equals_autograd_and_leaves_the_critics_without_one(critic_size: int):
    learner, batch = river(critic_size)
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    values, entropy, backward = learner.action_form.objective(
        learner.agent, batch, learner.action_form.q_values(learner.agent, batch)[0]
    )
    policy_loss(values, entropy, ALPHA, (2.0, 1.0)).backward()
    backward()
    found, actor.flat.grad = actor.flat.grad, None
    assert critics.flat.grad is None and found is not None
    branches = actor.reference(batch.obs)[0].view(-1, 4, 3).log_softmax(-1)
    q, total = critics.reference(batch.seen).detach(), torch.zeros(())
    for number, action in enumerate(itertools.product(range(3), repeat=4)):
        log_p = sum(branches[:, branch, option] for branch, option in enumerate(action))
        reward = torch.minimum(q[0, :, number], q[1, :, number])
        tight, loose = (torch.maximum(q[k, :, number], q[k + 2, :, number]) for k in (2, 3))
        total = total - (log_p.exp() * (reward - 0.3 * log_p - 2.0 * tight - loose)).mean() / 4.0  # pyright: ignore
    total.backward()
    assert actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=1e-5) and found.abs().max() > 1e-3


@pytest.mark.parametrize("space", ["MultiDiscrete", "Box"])
def test_bounds_leave_room_for_the_entropy_of_soft_values_alone(space: str):
    found = {}
    for soft_values in (True, False):
        settings: dict[str, Any] = {"entropy_in_targets": soft_values, "alpha": 0.3, "auto_alpha": False}
        learner = learner_for("SACLag", SPACES[space], discount=0.9, return_bounds=(0.0, 2.0), **settings)
        learner.update(rollout_of(learner), feedback(0.5))
        scale = learner.agent.scale
        wild = torch.tensor([[99.0, -99.0], [0.0, 0.0]])
        held = scale.bounded(wild, *learner._entropy_slack(torch.tensor(0.3)))[0]
        found[soft_values] = (held * scale.units[0]).tolist()
        unit = float(scale.units[0])
    most = math.log(9) if space == "MultiDiscrete" else 2 * math.log(2)
    assert found[False] == pytest.approx([2.0, 0.0])
    least = 0.0 if space == "MultiDiscrete" else -99.0 * unit  # pyright: ignore
    assert found[True] == pytest.approx([2.0 + 0.3 * most * 10 * unit, least], rel=1e-5)  # pyright: ignore


def test_only_the_outputs_of_the_batchs_actions_have_a_gradient():
    learner, batch = river(discount=0.0, cost_discount=0.0)
    q_values, _ = learner.action_form.q_values(learner.agent, batch)
    grads: list[torch.Tensor] = []
    learner.agent.update_critics(q_values, grads.append, batch, torch.zeros(3, 7), learner.action_form.chosen(batch))
    for state, number in enumerate(batch.actions[:, 0].int().tolist()):
        expected = torch.zeros(6, 81)
        expected[:, number] = (q_values[:, state, number] - batch.signals[[0, 0, 1, 2, 1, 2], state]) / 7
        assert torch.allclose(grads[0][:, state], expected, atol=1e-6)


def box(critic_size: int = 0, **settings: Any) -> tuple[Any, Any]:
    learner = learner_for("SACLag", SPACES["Box"], critic_size, **settings)
    perturb(learner)
    return learner, batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))


def sampled(learner: Any, obs: torch.Tensor, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Actions [B, 2] from the seed's noise, and their log-densities [B] by differences of the distribution function."""
    outputs = layer_by_layer(learner.policy.actor.stack, obs)[0]
    mean, std = outputs[:, :2], outputs[:, 2:].clamp(-20.0, 2.0).exp()
    noise = torch.randn(len(obs), 2, generator=torch.Generator().manual_seed(seed)).double()
    action, step = (mean + std * noise).tanh(), 1e-6
    normal = torch.distributions.Normal(mean, std)
    width = 2 * step * (1 - action.square())
    between = [(action + sign * width / 2).atanh() for sign in (1, -1)]
    return action, ((normal.cdf(between[0]) - normal.cdf(between[1])) / width).log().sum(-1)


@pytest.mark.parametrize("critic_size", [0, C])
@pytest.mark.parametrize(("soft_values", "weight"), [(True, 0.3), (False, 0.0)])
def test_a_sampled_next_value_equals_a_numeric_change_of_variables(soft_values: bool, weight: float, critic_size: int):
    learner, batch = box(critic_size, entropy_in_targets=soft_values)
    action, log_prob = sampled(learner, batch.next_obs, 5)
    learner.agent.generator.manual_seed(5)
    found = learner.action_form.next_values(learner.agent, batch, ALPHA)
    q = layer_by_layer(learner.agent.target_critics, torch.cat([batch.next_seen, action], 1))[..., 0]
    expected = torch.stack([torch.minimum(q[0], q[1]) - weight * log_prob, q[2]])
    near = (action.abs() < 0.999).all(-1)  # further out the distribution function has no digits left
    assert near.sum() >= 3 and torch.allclose(found.double()[:, near], expected[:, near], atol=1e-3)


@pytest.mark.parametrize("critic_size", [0, C])
def test_omnisafes_cost_target_uses_the_mean_of_continuous_actions(critic_size: int):
    learner, batch = box(critic_size, cost_target="mode")
    mean = layer_by_layer(learner.policy.actor.stack, batch.next_obs)[0][:, :2].tanh()
    q = layer_by_layer(learner.agent.target_critics, torch.cat([batch.next_seen, mean], 1))[..., 0]
    learner.agent.generator.manual_seed(5)
    found = learner.action_form.next_values(learner.agent, batch, ALPHA)
    usual, _ = box(critic_size)
    usual.agent.generator.manual_seed(5)
    other = usual.action_form.next_values(usual.agent, batch, ALPHA)
    assert torch.allclose(found[1].double(), q[2], atol=1e-4) and torch.equal(found[0], other[0])
    assert not torch.allclose(other[1].double(), q[2], atol=1e-2)


@pytest.mark.parametrize("critic_size", [0, C])
def test_a_sample_carries_the_gradient_of_the_policy(critic_size: int):
    learner, batch = box(critic_size)
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    learner.agent.generator.manual_seed(5)
    values, entropy, backward = learner.action_form.objective(learner.agent, batch, torch.zeros(3, 7))
    policy_loss(values, entropy, ALPHA, (2.0,)).backward()
    backward()
    found, actor.flat.grad = actor.flat.grad, None
    mean, log_std = actor.reference(batch.obs)[0].chunk(2, -1)
    noise = torch.randn(7, 2, generator=torch.Generator().manual_seed(5))
    before = mean + log_std.clamp(-20.0, 2.0).exp() * noise
    normal = torch.distributions.Normal(mean, log_std.clamp(-20.0, 2.0).exp())
    log_prob = (normal.log_prob(before) - (1 - before.tanh().square()).log()).sum(-1)
    q = critics.reference(torch.cat([batch.seen, before.tanh()], 1))[..., 0]
    critics.flat.grad = None
    (-(torch.minimum(q[0], q[1]) - 0.3 * log_prob - 2.0 * q[2]) / 3.0).mean().backward()
    assert found is not None and actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=2e-4) and found.abs().max() > 1e-3


def test_target_entropies():
    assert learner_for("SACLag", RIVER, entropy_share=0.3).action_form.target_entropy == pytest.approx(
        0.3 * math.log(81)
    )
    assert learner_for("SACLag", SPACES["Box"]).action_form.target_entropy == -2.0
    assert (
        learner_for("SACLag", RIVER, adapter="box_scaled", entropy_per_number=-0.5).action_form.target_entropy == -2.0
    )


@pytest.mark.parametrize("auto", [True, False])
def test_alpha_changes_with_auto_alpha_only(auto: bool):
    learner = learner_for("SACLag", auto_alpha=auto, alpha=0.2, entropy_share=0.0, policy_delay=1)
    batch = batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))
    for _ in range(3):
        learner._step(batch)
    alpha = float(learner.log_alpha.detach().exp())
    assert alpha < 0.1999 if auto else alpha == pytest.approx(0.2)


def test_an_alpha_of_zero_is_allowed_without_auto_alpha_only():
    assert SACLagConfig(alpha=0.0, auto_alpha=False).alpha == 0.0
    with pytest.raises(AlgorithmError, match="alpha must be above 0 with auto_alpha, got 0"):
        SACLagConfig(alpha=0.0)
