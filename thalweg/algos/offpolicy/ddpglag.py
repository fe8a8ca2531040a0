"""DDPGLag: deep deterministic policy gradient (Lillicrap et al. 2016) with a Lagrange multiplier for each cost.

The policy ascends the gradient of its critics: the reward's less the weighted costs'.
"""

from typing import Any

import torch
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
from thalweg.core.config import frozen_config


@frozen_config(AlgorithmError)
class DDPGLagConfig(DeterministicConfig):
    """Settings of DDPGLag."""

    target_actor: bool = True
    """Whether targets use the action of the target policy, as in the paper; else that of the policy itself, as in
    OmniSafe."""


class DDPGLag:
    """Learner of DDPGLag."""

    resets = False

    def __init__(self, config: DDPGLagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.action_form = action_form_of(config, task)
        self.agent = Agent(deterministic_spec("DDPGLag", self.action_form, config, reward_critics=1), config, task)
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
        """Return V(s') [1 + M, B] = Q'(s', μ'(s')): target critics at the action of the target policy."""
        agent = self.agent
        actor = agent.target_actor if self.config.target_actor else self.policy.actor.stack
        action = self.action_form.greedy(actor(batch.next_obs)[0])
        seen_actions = torch.cat([batch.next_seen, action], 1)
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
