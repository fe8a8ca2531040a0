"""TD3Lag: twin delayed deterministic policy gradient (Fujimoto, van Hoof, Meger 2018) with a Lagrange multiplier for
each cost: the smaller of two reward estimates, smoothed target actions, and a policy that is updated less often."""

from typing import Any, Literal

import torch
from pydantic import NonNegativeFloat, PositiveInt
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.deterministic import (
    DeterministicConfig,
    action_form_of,
    deterministic_spec,
    policy_gradient_step,
)
from thalweg.algos.offpolicy.replay_buffer import Batch
from thalweg.core.config import FiniteNonNegative, frozen_config


@frozen_config(AlgorithmError)
class TD3LagConfig(DeterministicConfig):
    """Settings of TD3Lag."""

    policy_delay: PositiveInt = 2
    """Gradient steps of the critics per gradient step of the policy."""
    target_noise: FiniteNonNegative = 0.2
    """σ̃: standard deviation of the noise added to a continuous action in -1..1 for targets."""
    target_noise_clip: NonNegativeFloat = 0.5
    """c: the noise of targets is clipped to ±c."""
    target_temperature: FiniteNonNegative = 0.05
    """Temperature of discrete actions for targets: they are sampled from the softmax of the policy's outputs divided by
    this; 0 for the most probable action. If it is much higher, targets belong to a policy that differs from the final
    one."""
    cost_target: Literal["smoothed", "online"] = "smoothed"
    """Action of a cost's target: the smoothed action of the target policy, as for the reward ("smoothed"), or the
    action of the policy itself, as in OmniSafe ("online")."""


class TD3Lag:
    """Learner of TD3Lag."""

    resets = False

    def __init__(self, config: TD3LagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.action_form = action_form_of(config, task)
        self.agent = Agent(deterministic_spec("TD3Lag", self.action_form, config, reward_critics=2), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps

    @torch.inference_mode()
    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A]: uniformly random at first, then the policy's with exploration noise."""
        if self.agent.acts_randomly:
            return self.policy.actions.uniform(len(obs), self.agent.generator)
        strength = self.config.exploration_at(self.agent.progress)
        return self.action_form.explore(self.agent.action_parameters(obs), self.agent.generator, strength)

    def warm_up_critics(self) -> None:
        """Let the policy act from the first step and only the critics learn at first, see `Agent.warm_up_critics`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Store the rollout and take the gradient steps that are due; returns the metrics, if a report is due."""
        self.agent.store(rollout, self.action_form.encode)
        self.agent.learn(feedback, self._step)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """Take one gradient step of the critics and, if it is due, of the policy."""
        agent = self.agent
        next_values = self._next_values(batch)
        q_values, backward = agent.critics.stack.forward_and_backward(batch.seen_actions)
        agent.update_critics(q_values, backward, batch, next_values)
        if agent.updates_policy:
            policy_gradient_step(agent, self.action_form, self.config, batch)

    @torch.no_grad()
    def _next_values(self, batch: Batch) -> Tensor:
        """Return V(s') [1 + M, B]: target critics at a smoothed action of the target policy.

        These are the smaller of the reward's two, and each cost's critic (the larger of two).
        """
        config, agent = self.config, self.agent
        action = self.action_form.smoothed(
            agent.target_actor(batch.next_obs)[0],
            agent.generator,
            noise=config.target_noise,
            clip=config.target_noise_clip,
            temperature=config.target_temperature,
        )
        seen_actions = torch.cat([batch.next_seen, action], 1)
        if config.cost_target == "online":
            online = self.action_form.greedy(self.policy.actor(batch.next_obs))
            seen_actions = agent.critics.inputs_by_signal(seen_actions, torch.cat([batch.next_seen, online], 1))
        return agent.critics.pessimistic(agent.target_critics(seen_actions).squeeze(-1))

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings, by a short code, about cost limits or multipliers without effect and impossible values."""
        return self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        """Return everything that resuming needs."""
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.agent.load_state(state)
