"""SACLag: its losses by hand, its sums over joint actions by loops, its draws by a change of variables."""

import itertools
import math
from typing import Any

import gymnasium as gym
import pytest
import torch

from tests.algos.offpolicy.learners import SPACES, batch_of, learner_for, one_by_one, shake
from thalweg.algos import AlgorithmError
from thalweg.algos.maths import losses
from thalweg.algos.offpolicy.saclag import SACLagConfig, policy_loss

F64 = torch.float64
RIVER = gym.spaces.MultiDiscrete([3, 3, 3, 3])
ALPHA = torch.tensor(0.3)


def test_the_policys_loss_by_hand():
    values = torch.tensor([[4.0, 2.0], [1.0, 0.0], [0.0, 3.0]], dtype=F64)
    entropy = torch.tensor([1.0, 2.0], dtype=F64)
    # α = ½, λ = (2, 1): (4 + ½ - 2) / 4 = 0.625 and (2 + 1 - 3) / 4 = 0
    found = policy_loss(values, entropy, torch.tensor(0.5, dtype=F64), (2.0, 1.0))
    assert float(found) == pytest.approx(-0.3125)


@pytest.mark.parametrize(("entropy", "grows"), [(0.2, True), (0.8, False)])
def test_alpha_grows_while_the_entropy_is_below_its_aim(entropy: float, grows: bool):
    log_alpha = torch.tensor(0.0, requires_grad=True)
    losses.temperature(log_alpha, torch.full((4,), entropy), 0.5).backward()
    assert log_alpha.grad is not None
    assert float(log_alpha.grad) == pytest.approx(entropy - 0.5) and (float(log_alpha.grad) < 0) == grows


def river(**settings: Any) -> tuple[Any, Any]:
    """A learner with two costs and two critics of each, and a batch of seven states."""
    learner = learner_for("SACLag", RIVER, cost_limits=(0.1, 0.2), cost_critics=2, **settings)
    shake(learner)
    return learner, batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))


def by_loops(learner: Any, obs: torch.Tensor, stack: Any) -> tuple[list[list[float]], list[float], list[list[float]]]:
    """Expectations of min Q_r, max Q_c1, max Q_c2, the entropy, and those at the most probable action, by 81 terms."""
    logits = one_by_one(learner.policy.actor.stack, obs)[0].view(-1, 4, 3)
    q = one_by_one(stack, obs)
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


def test_the_value_of_the_next_state_is_the_sum_over_all_81_joint_actions():
    learner, batch = river()
    expected, entropies, _ = by_loops(learner, batch.next_obs, learner.agent.slow_critics)
    found = learner.form.next_values(learner.agent, batch, ALPHA)
    for state in range(7):
        soft = [expected[state][0] + 0.3 * entropies[state], *expected[state][1:]]
        assert found[:, state].tolist() == pytest.approx(soft, abs=1e-4)


def test_omnisafes_target_of_the_cost_is_that_of_the_most_probable_action():
    learner, batch = river(cost_target="mode")
    expected, entropies, modes = by_loops(learner, batch.next_obs, learner.agent.slow_critics)
    found = learner.form.next_values(learner.agent, batch, ALPHA)
    for state in range(7):
        soft = [expected[state][0] + 0.3 * entropies[state], *modes[state][1:]]
        assert found[:, state].tolist() == pytest.approx(soft, abs=1e-4)
        assert abs(expected[state][1] - modes[state][1]) > 1e-3


def test_what_the_policy_maximises_is_the_sum_over_all_81_joint_actions():
    learner, batch = river()
    expected, entropies, _ = by_loops(learner, batch.obs, learner.agent.critics.stack)
    said, _ = learner.form.said(learner.agent, batch)
    values, entropy, _ = learner.form.objective(learner.agent, batch, said)
    for state in range(7):
        assert values[:, state].tolist() == pytest.approx(expected[state], abs=1e-4)
    assert entropy.tolist() == pytest.approx(entropies, abs=1e-5)


def test_the_policys_gradient_is_that_of_the_sum_and_no_critics():
    learner, batch = river()
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    values, entropy, back = learner.form.objective(learner.agent, batch, learner.form.said(learner.agent, batch)[0])
    policy_loss(values, entropy, ALPHA, (2.0, 1.0)).backward()
    back()
    found, actor.flat.grad = actor.flat.grad, None
    assert critics.flat.grad is None and found is not None
    branches = actor.reference(batch.obs)[0].view(-1, 4, 3).log_softmax(-1)
    q, total = critics.reference(batch.obs).detach(), torch.zeros(())
    for number, action in enumerate(itertools.product(range(3), repeat=4)):
        log_p = sum(branches[:, branch, option] for branch, option in enumerate(action))
        reward = torch.minimum(q[0, :, number], q[1, :, number])
        tight, loose = (torch.maximum(q[k, :, number], q[k + 2, :, number]) for k in (2, 3))
        total = total - (log_p.exp() * (reward - 0.3 * log_p - 2.0 * tight - loose)).mean() / 4.0  # pyright: ignore
    total.backward()
    assert actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=1e-5) and found.abs().max() > 1e-3


def test_critics_learn_at_the_numbers_of_the_batchs_actions_and_nowhere_else():
    learner, batch = river(discount=0.0, cost_discount=0.0)
    said, _ = learner.form.said(learner.agent, batch)
    slopes: list[torch.Tensor] = []
    learner.agent.learn_values(said, slopes.append, batch, torch.zeros(3, 7), learner.form.chosen(batch))
    for state, number in enumerate(batch.actions[:, 0].int().tolist()):
        expected = torch.zeros(6, 81)
        expected[:, number] = (said[:, state, number] - batch.paid[[0, 0, 1, 2, 1, 2], state]) / 7
        assert torch.allclose(slopes[0][:, state], expected, atol=1e-6)


def box(**settings: Any) -> tuple[Any, Any]:
    learner = learner_for("SACLag", SPACES["Box"], **settings)
    shake(learner)
    return learner, batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))


def drawn(learner: Any, obs: torch.Tensor, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Actions [B, 2] of the seed's noise, and their log-densities [B] by differences of the distribution function."""
    outputs = one_by_one(learner.policy.actor.stack, obs)[0]
    mean, std = outputs[:, :2], outputs[:, 2:].clamp(-20.0, 2.0).exp()
    noise = torch.randn(len(obs), 2, generator=torch.Generator().manual_seed(seed)).double()
    action, step = (mean + std * noise).tanh(), 1e-6
    normal = torch.distributions.Normal(mean, std)
    width = 2 * step * (1 - action.square())
    between = [(action + sign * width / 2).atanh() for sign in (1, -1)]
    return action, ((normal.cdf(between[0]) - normal.cdf(between[1])) / width).log().sum(-1)


def test_a_drawn_value_of_the_next_state_agrees_with_a_numeric_change_of_variables():
    learner, batch = box()
    action, log_prob = drawn(learner, batch.next_obs, 5)
    learner.agent.generator.manual_seed(5)
    found = learner.form.next_values(learner.agent, batch, ALPHA)
    q = one_by_one(learner.agent.slow_critics, torch.cat([batch.next_obs, action], 1))[..., 0]
    expected = torch.stack([torch.minimum(q[0], q[1]) - 0.3 * log_prob, q[2]])
    near = (action.abs() < 0.999).all(-1)  # further out the distribution function has no digits left
    assert near.sum() >= 3 and torch.allclose(found.double()[:, near], expected[:, near], atol=1e-3)


def test_omnisafes_target_of_the_cost_is_that_of_the_mean():
    learner, batch = box(cost_target="mode")
    mean = one_by_one(learner.policy.actor.stack, batch.next_obs)[0][:, :2].tanh()
    q = one_by_one(learner.agent.slow_critics, torch.cat([batch.next_obs, mean], 1))[..., 0]
    learner.agent.generator.manual_seed(5)
    found = learner.form.next_values(learner.agent, batch, ALPHA)
    usual, _ = box()
    usual.agent.generator.manual_seed(5)
    other = usual.form.next_values(usual.agent, batch, ALPHA)
    assert torch.allclose(found[1].double(), q[2], atol=1e-4) and torch.equal(found[0], other[0])
    assert not torch.allclose(other[1].double(), q[2], atol=1e-2)


def test_a_draw_carries_the_gradient_of_the_policy():
    learner, batch = box()
    actor, critics = learner.policy.actor.stack, learner.agent.critics.stack
    learner.agent.generator.manual_seed(5)
    values, entropy, back = learner.form.objective(learner.agent, batch, torch.zeros(3, 7))
    policy_loss(values, entropy, ALPHA, (2.0,)).backward()
    back()
    found, actor.flat.grad = actor.flat.grad, None
    mean, log_std = actor.reference(batch.obs)[0].chunk(2, -1)
    noise = torch.randn(7, 2, generator=torch.Generator().manual_seed(5))
    before = mean + log_std.clamp(-20.0, 2.0).exp() * noise
    normal = torch.distributions.Normal(mean, log_std.clamp(-20.0, 2.0).exp())
    log_prob = (normal.log_prob(before) - (1 - before.tanh().square()).log()).sum(-1)
    q = critics.reference(torch.cat([batch.obs, before.tanh()], 1))[..., 0]
    critics.flat.grad = None
    (-(torch.minimum(q[0], q[1]) - 0.3 * log_prob - 2.0 * q[2]) / 3.0).mean().backward()
    assert found is not None and actor.flat.grad is not None
    assert torch.allclose(found, actor.flat.grad, atol=2e-4) and found.abs().max() > 1e-3


def test_entropies_aimed_at():
    assert learner_for("SACLag", RIVER, entropy_share=0.3).form.aim == pytest.approx(0.3 * math.log(81))
    assert learner_for("SACLag", SPACES["Box"]).form.aim == -2.0
    assert learner_for("SACLag", RIVER, adapter="box_scaled", entropy_per_number=-0.5).form.aim == -2.0


@pytest.mark.parametrize("auto", [True, False])
def test_alpha_moves_or_stays(auto: bool):
    learner = learner_for("SACLag", auto_alpha=auto, alpha=0.2, entropy_share=0.0, policy_delay=1)
    batch = batch_of(learner, learner.policy.actions.uniform(7, learner.agent.generator))
    for _ in range(3):
        learner._step(batch)
    alpha = float(learner.log_alpha.detach().exp())
    assert alpha < 0.1999 if auto else alpha == pytest.approx(0.2)


def test_an_alpha_of_nothing_is_for_a_fixed_one_only():
    assert SACLagConfig(alpha=0.0, auto_alpha=False).alpha == 0.0
    with pytest.raises(AlgorithmError, match="alpha must be positive"):
        SACLagConfig(alpha=0.0)
