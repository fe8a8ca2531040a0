"""SACLag: soft actor-critic (Haarnoja et al. 2018) with a Lagrange multiplier for each cost.

Discrete actions use exact sums over all joint actions (Christodoulou 2019), continuous ones a reparameterised sample.
"""

import math
from collections.abc import Callable
from typing import Any, Literal, Self

import torch
from pydantic import model_validator
from torch import Tensor

from thalweg.algos.common.adam import Adam
from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.setting_types import EntropyPerNumber
from thalweg.algos.common.state import CPU, array_of, tensor_of
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import joint_actions, losses
from thalweg.algos.maths.multiplier import combined
from thalweg.algos.offpolicy.agent import Agent, AgentSpec
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.offpolicy.replay_buffer import Batch
from thalweg.algos.policy.actions import Actions, actions_of
from thalweg.algos.policy.distributions import Categoricals, SquashedGaussian
from thalweg.core.config import FiniteNonNegative, Fraction, frozen_config


@frozen_config(AlgorithmError)
class SACLagConfig(OffPolicyConfig):
    """Settings of SACLag."""

    multiplier_settles: bool = False
    """Off by default: a stochastic policy can stay at its limit and need not end on the safe side of an oscillation."""
    alpha: FiniteNonNegative = 0.1
    """α: weight of the policy's entropy in nats; with `auto_alpha` its initial value."""
    auto_alpha: bool = True
    """Whether α is adapted to keep the policy's entropy at a target."""
    alpha_learning_rate: FiniteNonNegative = 1e-3
    """Learning rate of Adam for log α."""
    entropy_share: Fraction = 0.1
    """Target entropy of a discrete policy, as a share of the maximum, log(number of joint actions)."""
    entropy_per_number: EntropyPerNumber = -1.0
    """Target entropy of a continuous policy in -1..1, in nats per dimension of the action."""
    entropy_in_targets: bool = False
    """Whether targets of the reward contain α times the entropy of later steps, as in the paper, so that the value is
    the soft one; else the entropy counts in the policy's loss alone."""
    cost_target: Literal["policy", "mode"] = "policy"
    """Action of a cost's target: sampled from the policy, as for the reward ("policy"), or the policy's most probable
    action (for continuous actions the mean), as in OmniSafe, which estimates the cost of another policy ("mode")."""

    @model_validator(mode="after")
    def _learnt_alpha_is_positive(self) -> Self:
        if self.auto_alpha and self.alpha == 0:
            raise ValueError("alpha must be above 0 with auto_alpha, got 0.0")
        return self


def policy_loss(values: Tensor, entropy: Tensor, alpha: Tensor, multipliers: tuple[float, ...]) -> Tensor:
    """Return L = -E_s[(V_r(s) + α H(s) - Σ_i λ_i V_ci(s)) / (1 + Σ_i λ_i)], the loss of the policy.

    Args:
        values: V [1 + M, B] = E_a[min Q_r], E_a[Q_ci], the reward's and then each cost's.
        entropy: H [B], of the policy, or its estimate -log π(a|s).
        alpha: α, a scalar without gradient.
        multipliers: λ [M].
    """
    return -combined(values[0] + alpha * entropy, values[1:], multipliers, normalised=True).mean()


class DiscreteActions:
    """SAC for choices: critics have one output for each of the J joint actions, and expectations are sums."""

    def __init__(self, actions: Actions, config: SACLagConfig, device: torch.device) -> None:
        """Raises `AlgorithmError` for more joint actions than can be summed over."""
        self.actions, self.config = actions, config
        count = actions.joint_count("SACLag")
        self.width, self.critic_outputs = 1, count
        self.target_entropy = config.entropy_share * math.log(count)
        self.entropy_range = (0.0, math.log(count))
        self._selection = joint_actions.selection(actions.sizes).to(device)

    def encode(self, raw: Tensor) -> Tensor:
        """Return the number [B, 1] of each joint action [B, A]."""
        return joint_actions.numbers(raw, self.actions.sizes).unsqueeze(1).float()

    def q_values(self, agent: Agent, batch: Batch) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Return Q(s, a) of every joint action [K, B, J], and the critics' backward function."""
        return agent.critics.stack.forward_and_backward(batch.seen)

    def chosen(self, batch: Batch) -> Tensor:
        """Return the number [B] of the joint action in each step of the batch."""
        return batch.actions[:, 0].long()

    @torch.no_grad()
    def next_values(self, agent: Agent, batch: Batch, alpha: Tensor) -> Tensor:
        """Return V(s') [1 + M, B]: Σ_a π(a|s') (min Q'_r - α log π), and Σ_a π(a|s') Q'_ci."""
        log_p, values = self._log_p(agent.policy.actor(batch.next_obs)), agent.target_critics(batch.next_seen)
        values = agent.critics.pessimistic(values)
        expected = torch.stack([joint_actions.expectation(log_p, each) for each in values])
        if self.config.entropy_in_targets:
            expected[0] -= alpha * joint_actions.expectation(log_p, log_p)
        if self.config.cost_target == "mode":
            expected[1:] = values[1:, torch.arange(len(log_p), device=log_p.device), log_p.argmax(-1)]
        return expected

    def objective(self, agent: Agent, batch: Batch, q_values: Tensor) -> tuple[Tensor, Tensor, Callable[[], None]]:
        """Return V(s) [1 + M, B] and H(s) [B], and the policy's backward function, to be called after theirs.

        The critics are not evaluated again: the policy uses their outputs from before their own gradient step.
        """
        outputs, actor_backward = agent.policy.actor.forward_and_backward(batch.obs)
        log_p = self._log_p(outputs.requires_grad_())
        values = agent.critics.pessimistic(q_values.detach())
        expected = torch.stack([joint_actions.expectation(log_p, each) for each in values])
        return expected, -joint_actions.expectation(log_p, log_p), lambda: actor_backward(_grad(outputs))

    def _log_p(self, outputs: Tensor) -> Tensor:
        """Return log π(a|s) [B, J]."""
        policy = Categoricals.from_logits(outputs, self.actions.sizes)
        return joint_actions.log_prob(policy.log_p, self._selection)


class ContinuousActions:
    """SAC for actions in -1..1: critics see the action, and an expectation is one sample."""

    def __init__(self, actions: Actions, config: SACLagConfig, device: torch.device) -> None:
        self.actions, self.config = actions, config
        self.width, self.critic_outputs = actions.count, 0
        self.target_entropy = config.entropy_per_number * actions.count
        self.entropy_range = (-math.inf, actions.count * math.log(2.0))  # at most that of uniform actions in -1..1

    def encode(self, raw: Tensor) -> Tensor:
        """Return the executed actions [B, A]."""
        return self.actions.quantised(raw)

    def q_values(self, agent: Agent, batch: Batch) -> tuple[Tensor, Callable[[Tensor], None]]:
        """Return Q(s, a) [K, B, 1] of the batch's actions, and the critics' backward function."""
        return agent.critics.stack.forward_and_backward(batch.seen_actions)

    def chosen(self, batch: Batch) -> None:
        """Return None: each critic has a single output."""

    @torch.no_grad()
    def next_values(self, agent: Agent, batch: Batch, alpha: Tensor) -> Tensor:
        """Return V(s') [1 + M, B]: min Q'_r(s', a') - α log π(a'|s'), and Q'_ci(s', a'), for a sampled action a'."""
        policy = _squashed(agent.policy.actor(batch.next_obs))
        sample, log_prob = policy.rsample(agent.generator)
        seen_actions = torch.cat([batch.next_seen, self.encode(sample)], 1)
        if self.config.cost_target == "mode":
            mode = torch.cat([batch.next_seen, self.encode(policy.mode())], 1)
            seen_actions = agent.critics.inputs_by_signal(seen_actions, mode)
        values = agent.critics.pessimistic(agent.target_critics(seen_actions).squeeze(-1))
        if self.config.entropy_in_targets:
            values[0] -= alpha * log_prob
        return values

    def objective(self, agent: Agent, batch: Batch, q_values: Tensor) -> tuple[Tensor, Tensor, Callable[[], None]]:
        """Return V(s) [1 + M, B] and H(s) [B], both of one sample, and the policy's backward function.

        The backward function is to be called after those of V and H.
        """
        with torch.no_grad():
            outputs, actor_backward = agent.policy.actor.forward_and_backward(batch.obs)
            sample, log_prob, sample_backward = _squashed(outputs).rsample_and_backward(agent.generator)
            seen_sample = torch.cat([batch.seen, sample], 1)
            values, critics_backward = agent.critics.stack.forward_and_input_backward(seen_sample)
        for leaf in (values, log_prob):
            leaf.requires_grad_()

        @torch.no_grad()
        def backward() -> None:
            # The critics' inputs are what they see and actions; only the actions' gradient concerns the policy.
            sample_grads = critics_backward(_grad(values))[:, batch.seen.shape[1] :]
            actor_backward(sample_backward(sample_grads, _grad(log_prob)))

        return agent.critics.pessimistic(values.squeeze(-1)), -log_prob, backward


def _grad(leaf: Tensor) -> Tensor:
    assert leaf.grad is not None
    return leaf.grad


def _squashed(outputs: Tensor) -> SquashedGaussian:
    return SquashedGaussian(*outputs.chunk(2, dim=-1))


class SACLag:
    """Learner of SACLag."""

    resets = False

    def __init__(self, config: SACLagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        actions = actions_of(task.action_space, config.adapter, "squashed")
        form = DiscreteActions if actions.kind == "categorical" else ContinuousActions
        self.action_form = form(actions, config, task.device)
        spec = AgentSpec(
            "SACLag",
            actions,
            self.action_form.width,
            reward_critics=2,
            critic_outputs=self.action_form.critic_outputs,
            policy_metrics=("entropy", "alpha"),
        )
        self.agent = Agent(spec, config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        self.log_alpha = (
            torch.tensor(config.alpha, dtype=torch.float32, device=task.device).log().requires_grad_(config.auto_alpha)
        )
        self.alpha_optimiser = Adam([self.log_alpha], config.alpha_learning_rate)

    @torch.inference_mode()
    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A]: uniformly random at first, then sampled from the policy."""
        if self.agent.acts_randomly:
            return self.policy.actions.uniform(len(obs), self.agent.generator)
        return self.policy.actions.distribution(self.agent.action_parameters(obs)).sample(self.agent.generator)

    def warm_up_critics(self) -> None:
        """Let the policy act from the first step and only the critics learn at first, see `Agent.warm_up_critics`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Store the rollout and take the gradient steps that are due; returns the metrics, if a report is due."""
        self.agent.store(rollout, self.action_form.encode)
        self.agent.learn(feedback, self._step)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """Take one gradient step of the critics and, if it is due, of the policy and α."""
        agent, form, alpha = self.agent, self.action_form, self.log_alpha.detach().exp()
        q_values, critics_backward = form.q_values(agent, batch)
        next_values = form.next_values(agent, batch, alpha)
        chosen, slack = form.chosen(batch), self._entropy_slack(alpha)
        agent.update_critics(q_values, critics_backward, batch, next_values, chosen, slack=slack)
        if agent.updates_policy:
            values, entropy, policy_backward = form.objective(agent, batch, q_values)
            loss = policy_loss(values, entropy, alpha, agent.multipliers.values)
            self.alpha_optimiser.zero_grad()
            if self.config.auto_alpha:
                loss = loss + losses.temperature(self.log_alpha, entropy, form.target_entropy)
            loss.backward()
            policy_backward()
            agent.update_policy(loss, entropy.mean(), alpha)
            self.alpha_optimiser.step()  # changes nothing without a gradient

    def _entropy_slack(self, alpha: Tensor) -> tuple[float | Tensor, float | Tensor]:
        """Return how far soft values may lie below and above what an episode pays: α Σ_t γ^t H_t at its extremes."""
        if not self.config.entropy_in_targets:
            return 0.0, 0.0
        least, most = self.action_form.entropy_range
        steps = 1.0 / max(1.0 - self.config.discount, 1e-3)
        return (0.0 if least == 0.0 else math.inf), alpha * (most * steps)

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings, by a short code, about cost limits or multipliers without effect and impossible values."""
        return self.agent.warnings(feedback, float(self._entropy_slack(self.log_alpha.detach().exp())[1]))

    def state(self) -> dict[str, Any]:
        """Return everything that resuming needs."""
        alpha = {"log_alpha": array_of(self.log_alpha), "alpha_optimiser": self.alpha_optimiser.state()}
        return self.agent.state() | alpha

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.agent.load_state(state)
        with torch.no_grad():
            self.log_alpha.copy_(tensor_of(state["log_alpha"], CPU))
        self.alpha_optimiser.load_state(state["alpha_optimiser"])
