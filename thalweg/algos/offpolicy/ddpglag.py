"""Deep deterministic policy gradient (Lillicrap et al. 2016) with a Lagrange multiplier for each cost: the policy
climbs its critics' gradient, and pays for the cost that they expect."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.deterministic import DeterministicConfig, climb, deterministic
from thalweg.algos.offpolicy.replay import Batch


@dataclass(frozen=True)
class DDPGLagConfig(DeterministicConfig):
    """Settings of DDPGLag."""

    target_actor: bool = True
    """Whether targets use the action of the target policy, as in the paper; else that of the policy itself, as in
    OmniSafe."""


class DDPGLag:
    """DDPGLag at work."""

    resets = False

    def __init__(self, config: DDPGLagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.form = deterministic(config, task)
        self.agent = Agent(
            "DDPGLag", config, task, self.form.actions, coded=self.form.width, reward_critics=1, greedy=True
        )
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps

    @torch.inference_mode()
    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Raw actions [N, A]: the policy's with noise, at first uniform ones."""
        if self.agent.begins:
            return self.policy.actions.uniform(len(obs), self.agent.generator)
        strength = self.config.exploration_at(self.agent.progress)
        return self.form.explored(self.agent.parameters(obs), self.agent.generator, strength)

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Remember the rollout and take the gradient steps that are due; returns the metrics, if they are due."""
        self.agent.remember(rollout, self.form.coded)
        self.agent.learn(feedback, self._step)
        return self.agent.report(feedback)

    def _step(self, batch: Batch) -> None:
        """One gradient step of the critics and, if it is its turn, of the policy."""
        agent = self.agent
        next_values = self._next_values(batch)
        said, back = agent.critics.stack.forward_and_backward(batch.pairs)
        agent.learn_values(said, back, batch, next_values)
        if agent.policy_turn:
            climb(agent, self.form, self.config, batch)

    @torch.no_grad()
    def _next_values(self, batch: Batch) -> Tensor:
        """V(s') [1 + M, B] = Q'(s', μ'(s')): slow critics at the action of the slow policy."""
        agent = self.agent
        actor = agent.slow_actor if self.config.target_actor else self.policy.actor.stack
        action = self.form.chosen(actor(batch.next_obs)[0])
        pairs = torch.cat([batch.next_obs, action], 1)
        return agent.critics.cautious(agent.slow_critics(pairs).squeeze(-1))

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What keeps the cost limits or their multipliers from doing their work."""
        return self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
