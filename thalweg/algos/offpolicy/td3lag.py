"""Twin delayed deterministic policy gradient (Fujimoto, van Hoof, Meger 2018) with a Lagrange multiplier for each cost:
the smaller of two estimates, targets taken near the policy's action, and a policy that waits for its critics."""

from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.deterministic import DeterministicConfig, climb, deterministic
from thalweg.algos.offpolicy.replay import Batch


@dataclass(frozen=True)
class TD3LagConfig(DeterministicConfig):
    """Settings of TD3Lag."""

    policy_delay: int = 2
    """Gradient steps of the critics per gradient step of the policy."""
    target_noise: float = 0.2
    """σ̃: standard deviation of the noise added to a continuous action in -1..1 for targets."""
    target_noise_clip: float = 0.5
    """c: the noise of targets is clipped to ±c."""
    target_temperature: float = 0.05
    """Temperature of discrete actions for targets: they are sampled from the softmax of the policy's outputs divided by
    this; 0 for the most probable action. If it is much higher, targets belong to a policy that differs from the final
    one."""
    cost_target: Literal["smoothed", "online"] = "smoothed"
    """Action of a cost's target: the smoothed action of the target policy, as for the reward ("smoothed"), or the
    action of the policy itself, as in OmniSafe ("online")."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "target_noise": (self.target_noise >= 0, "must not be negative"),
            "target_temperature": (self.target_temperature >= 0, "must not be negative"),
            "target_noise_clip": (self.target_noise_clip >= 0, "must not be negative"),
        }


class TD3Lag:
    """TD3Lag at work."""

    resets = False

    def __init__(self, config: TD3LagConfig, task: Task) -> None:
        self.config, self.separate_costs = config, config.separate_costs
        self.form = deterministic(config, task)
        self.agent = Agent(
            "TD3Lag", config, task, self.form.actions, coded=self.form.width, reward_critics=2, greedy=True
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
        """V(s') [1 + M, B]: the smaller of two slow critics of the reward, and those of each cost (of two the larger),
        at an action near that of the slow policy."""
        config, agent = self.config, self.agent
        action = self.form.smoothed(
            agent.slow_actor(batch.next_obs)[0],
            agent.generator,
            noise=config.target_noise,
            clip=config.target_noise_clip,
            temperature=config.target_temperature,
        )
        pairs = torch.cat([batch.next_obs, action], 1)
        if config.cost_target == "online":
            online = self.form.chosen(self.policy.actor(batch.next_obs))
            pairs = agent.critics.each(pairs, torch.cat([batch.next_obs, online], 1))
        return agent.critics.cautious(agent.slow_critics(pairs).squeeze(-1))

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What keeps the cost limits or their multipliers from doing their work."""
        return self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
