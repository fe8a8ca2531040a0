"""Soft actor-critic (Haarnoja et al. 2018) with a Lagrange multiplier for each cost: a policy that stays as random as
its reward allows.

Choices are learnt by exact sums over all joint actions (Christodoulou 2019), numbers by a draw that carries a gradient.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import joint_actions, losses
from thalweg.algos.maths.multiplier import combined
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.offpolicy.replay import Batch
from thalweg.algos.policy.actions import Actions, actions_of
from thalweg.algos.policy.distributions import Categoricals, SquashedGaussian


@dataclass(frozen=True)
class SACLagConfig(OffPolicyConfig):
    """Settings of SACLag."""

    multiplier_settles: bool = False
    """Off by default: a stochastic policy can stay at its limit and need not end on the safe side of an oscillation."""
    alpha: float = 0.1
    """α: weight of the policy's entropy in nats; with `auto_alpha` its initial value."""
    auto_alpha: bool = True
    """Whether α is adapted to keep the policy's entropy at a target."""
    alpha_learning_rate: float = 1e-3
    """Learning rate of Adam for log α."""
    entropy_share: float = 0.1
    """Target entropy of a discrete policy, as a share of the maximum, log(number of joint actions)."""
    entropy_per_number: float = -1.0
    """Target entropy of a continuous policy in -1..1, in nats per dimension of the action."""
    cost_target: Literal["policy", "mode"] = "policy"
    """Action of a cost's target: sampled from the policy, as for the reward ("policy"), or the policy's most probable
    action (for continuous actions the mean), as in OmniSafe, which estimates the cost of another policy ("mode")."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "alpha": (self.alpha > 0 or (self.alpha == 0 and not self.auto_alpha), "must be positive"),
            "alpha_learning_rate": (self.alpha_learning_rate >= 0, "must not be negative"),
            "entropy_per_number": (self.entropy_per_number < math.log(2.0), "must be less than log 2, that of -1..1"),
            "entropy_share": (0 <= self.entropy_share <= 1, "must be in 0..1"),
        }


def policy_loss(values: Tensor, entropy: Tensor, alpha: Tensor, multipliers: tuple[float, ...]) -> Tensor:
    """L = -E_s[(V_r(s) + α H(s) - Σ_i λ_i V_ci(s)) / (1 + Σ_i λ_i)]: what the policy minimises.

    Args:
        values: V [1 + M, B] = E_a[min Q_r], E_a[Q_ci], the reward's and then each cost's.
        entropy: H [B], of the policy, or its estimate -log π(a|s).
        alpha: α, a scalar without gradient.
        multipliers: λ [M].
    """
    return -combined(values[0] + alpha * entropy, values[1:], multipliers, normalised=True).mean()


class Exact:
    """Choices: critics say one number for each of the J joint actions, and expectations are sums."""

    def __init__(self, actions: Actions, config: SACLagConfig, device: torch.device) -> None:
        """Raises `AlgorithmError` for more joint actions than can be summed over."""
        self.actions, self.config = actions, config
        count = actions.joint_count("SACLag")
        self.coded_width, self.critic_outputs = 1, count
        self.aim = config.entropy_share * math.log(count)
        self._selected = joint_actions.selection(actions.sizes).to(device)

    def coded(self, raw: Tensor) -> Tensor:
        """[B, 1] the number of each joint action [B, A]."""
        return joint_actions.numbers(raw, self.actions.sizes).unsqueeze(1).float()

    def said(self, agent: Agent, batch: Batch) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Q(s, a) of every joint action [K, B, J], and what passes their gradient on to the critics."""
        return agent.critics.stack.forward_and_backward(batch.obs)

    def chosen(self, batch: Batch) -> Tensor:
        """Which joint action each state of the batch saw, [B]."""
        return batch.actions[:, 0].long()

    @torch.no_grad()
    def next_values(self, agent: Agent, batch: Batch, alpha: Tensor) -> Tensor:
        """V(s') [1 + M, B]: Σ_a π(a|s') (min Q'_r - α log π), and Σ_a π(a|s') Q'_ci."""
        log_p, values = self._log_p(agent.policy.actor(batch.next_obs)), agent.slow_critics(batch.next_obs)
        values = agent.critics.cautious(values)
        expected = torch.stack([joint_actions.expectation(log_p, each) for each in values])
        expected[0] -= alpha * joint_actions.expectation(log_p, log_p)
        if self.config.cost_target == "mode":
            expected[1:] = values[1:, torch.arange(len(log_p), device=log_p.device), log_p.argmax(-1)]
        return expected

    def objective(self, agent: Agent, batch: Batch, said: Tensor) -> tuple[Tensor, Tensor, Callable[[], None]]:
        """V(s) [1 + M, B] and H(s) [B], and what passes their gradient on to the policy, once it is there.

        The critics are not asked again: the policy learns from what they said before their own gradient step.
        """
        outputs, back = agent.policy.actor.forward_and_backward(batch.obs)
        log_p = self._log_p(outputs.requires_grad_())
        values = agent.critics.cautious(said.detach())
        expected = torch.stack([joint_actions.expectation(log_p, each) for each in values])
        return expected, -joint_actions.expectation(log_p, log_p), lambda: back(_slope(outputs))

    def _log_p(self, outputs: Tensor) -> Tensor:
        """log π(a|s) [B, J]."""
        policy = Categoricals.from_logits(outputs, self.actions.sizes)
        return joint_actions.log_prob(policy.log_p, self._selected)


class Sampled:
    """Numbers: critics see the action, and an expectation is one draw."""

    def __init__(self, actions: Actions, config: SACLagConfig, device: torch.device) -> None:
        self.actions, self.config = actions, config
        self.coded_width, self.critic_outputs = actions.count, 0
        self.aim = config.entropy_per_number * actions.count

    def coded(self, raw: Tensor) -> Tensor:
        """[B, A] what was executed."""
        return self.actions.quantised(raw)

    def said(self, agent: Agent, batch: Batch) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Q(s, a) [K, B, 1] of the batch's actions, and what passes their gradient on to the critics."""
        return agent.critics.stack.forward_and_backward(batch.pairs)

    def chosen(self, batch: Batch) -> None:
        """There is but one number."""

    @torch.no_grad()
    def next_values(self, agent: Agent, batch: Batch, alpha: Tensor) -> Tensor:
        """V(s') [1 + M, B]: min Q'_r(s', a') - α log π(a'|s'), and Q'_ci(s', a'), a' drawn from the policy."""
        policy = _squashed(agent.policy.actor(batch.next_obs))
        drawn, log_prob = policy.rsample(agent.generator)
        pairs = torch.cat([batch.next_obs, self.coded(drawn)], 1)
        if self.config.cost_target == "mode":
            pairs = agent.critics.each(pairs, torch.cat([batch.next_obs, self.coded(policy.mode())], 1))
        values = agent.critics.cautious(agent.slow_critics(pairs).squeeze(-1))
        values[0] -= alpha * log_prob
        return values

    def objective(self, agent: Agent, batch: Batch, said: Tensor) -> tuple[Tensor, Tensor, Callable[[], None]]:
        """V(s) [1 + M, B] and H(s) [B], both of one draw, and what passes their gradient on to the policy, once it is
        there."""
        with torch.no_grad():
            outputs, through_policy = agent.policy.actor.forward_and_backward(batch.obs)
            drawn, log_prob, through_draw = _squashed(outputs).rsample_and_backward(agent.generator)
            values, through_critics = agent.critics.stack.forward_and_input_backward(torch.cat([batch.obs, drawn], 1))
        for leaf in (values, log_prob):
            leaf.requires_grad_()

        @torch.no_grad()
        def back() -> None:
            of_drawn = through_critics(_slope(values))[:, batch.obs.shape[1] :]
            through_policy(through_draw(of_drawn, _slope(log_prob)))

        return agent.critics.cautious(values.squeeze(-1)), -log_prob, back


def _slope(leaf: Tensor) -> Tensor:
    """The gradient that has been left in it."""
    assert leaf.grad is not None
    return leaf.grad


def _squashed(outputs: Tensor) -> SquashedGaussian:
    return SquashedGaussian(*outputs.chunk(2, dim=-1))


class SACLag:
    """SACLag at work."""

    resets = False

    def __init__(self, config: SACLagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        actions = actions_of(task.action_space, config.adapter, "squashed")
        self.form = (Exact if actions.kind == "categorical" else Sampled)(actions, config, task.device)
        self.agent = Agent(
            "SACLag",
            config,
            task,
            actions,
            coded=self.form.coded_width,
            reward_critics=2,
            outputs=self.form.critic_outputs,
            tallied=("entropy", "alpha"),
        )
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        self.log_alpha = torch.tensor(config.alpha, device=task.device).log().requires_grad_(config.auto_alpha)
        self.alpha_optimiser = Adam([self.log_alpha], config.alpha_learning_rate)

    @torch.inference_mode()
    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Raw actions [N, A] drawn from the policy, at first uniform ones."""
        if self.agent.begins:
            return self.policy.actions.uniform(len(obs), self.agent.generator)
        return self.policy.actions.distribution(self.agent.parameters(obs)).sample(self.agent.generator)

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Remember the rollout and take the gradient steps that are due; returns the metrics, if they are due."""
        self.agent.remember(rollout, self.form.coded)
        self.agent.learn(feedback, self._step)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """One gradient step of the critics and, if it is its turn, of the policy and α."""
        agent, form, alpha = self.agent, self.form, self.log_alpha.detach().exp()
        said, to_critics = form.said(agent, batch)
        next_values = form.next_values(agent, batch, alpha)
        agent.learn_values(said, to_critics, batch, next_values, form.chosen(batch))
        if agent.policy_turn:
            values, entropy, to_policy = form.objective(agent, batch, said)
            loss = policy_loss(values, entropy, alpha, agent.multipliers.values)
            self.alpha_optimiser.zero_grad()
            if self.config.auto_alpha:
                loss = loss + losses.temperature(self.log_alpha, entropy, form.aim)
            loss.backward()
            to_policy()
            agent.improve(loss, entropy.mean(), alpha)
            self.alpha_optimiser.step()  # without a gradient it stays

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What keeps the cost limits or their multipliers from doing their work."""
        return self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        alpha = {"log_alpha": array_of(self.log_alpha), "alpha_optimiser": self.alpha_optimiser.state()}
        return self.agent.state() | alpha

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
        with torch.no_grad():
            self.log_alpha.copy_(tensor_of(state["log_alpha"], CPU))
        self.alpha_optimiser.load_state(state["alpha_optimiser"])
