"""PPO with a Lagrange multiplier (Ray, Achiam, Amodei 2019): the clipped surrogate of reward less λ times cost."""

from typing import Any

from pydantic import PositiveFloat
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics, limit_warnings
from thalweg.algos.constraint.multiplier import Multipliers
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import standardised
from thalweg.algos.maths.multiplier import combined
from thalweg.algos.onpolicy.agent import (
    Agent,
    KLMonitor,
    cost_advantages,
    cost_signals,
    metrics_of,
    reward_signal,
)
from thalweg.algos.onpolicy.config import LagrangianConfig
from thalweg.algos.policy.memory import Sequences
from thalweg.core.config import frozen_config


@frozen_config(AlgorithmError)
class PPOLagConfig(LagrangianConfig):
    """Settings of PPOLag."""

    clip: PositiveFloat = 0.2
    """Clip range ε: the probability ratio is clipped to 1 ± ε."""


def policy_loss(
    config: PPOLagConfig, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """Return L = L_clip - c H with the advantage (A_r - Σ λ_i A_ci) / (1 + Σ λ_i), from arguments of shape [B]."""
    return losses.ppo_clip(log_prob, old_log_prob, advantages, config.clip) - config.entropy * entropy.mean()


class PPOLag:
    """The PPOLag algorithm; see `Learner` for its methods."""

    def __init__(self, config: PPOLagConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("PPOLag", 1 + len(config.limits), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        self.multipliers = Multipliers(config, config.limits)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Update the multipliers, then train until the KL exceeds `target_kl` or passes run out; return metrics."""
        config, agent = self.config, self.agent
        limits = config.current_limits(feedback)
        samples = agent.samples(rollout, [reward_signal(config, rollout), *cost_signals(config, rollout)])
        if not agent.critics_warm_up:
            self.multipliers.update(feedback, limits)
        advantages = combined(
            standardised(samples.advantages[0]),
            cost_advantages(config, samples),
            self.multipliers.values,
            normalised=True,
        )
        rate, monitor = agent.decay(feedback.progress), KLMonitor(agent, samples)
        data = (samples.actions, monitor.old_log_prob, advantages, samples.imitated)
        log: list[Tensor] = []
        while monitor.may_continue:
            with agent.critics_learning(samples):
                for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                    log.append(self._step(inputs, *rows))
            monitor.measure()
        return (
            metrics_of(agent, samples, log, monitor)
            | {"learning_rate": rate, "clip_fraction": monitor.clip_fraction(config.clip)}
            | self.multipliers.metrics(feedback, agent.updates_left(feedback))
            | cost_metrics(feedback, limits, config.cost_means(feedback))
        )

    def _step(
        self,
        inputs: Tensor | Sequences,
        actions: Tensor,
        old_log_prob: Tensor,
        advantages: Tensor,
        imitated: Tensor,
    ) -> Tensor:
        """Take one gradient step of the policy, and return its loss."""
        return self.agent.step(
            inputs,
            lambda new: policy_loss(self.config, new.log_prob(actions), old_log_prob, advantages, new.entropy()),
            imitated,
        )

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about limits and multipliers without effect in this run, and a policy that never learns."""
        too_slow = self.multipliers.warnings(feedback, self.agent.updates_left(feedback))
        return limit_warnings(self.config, feedback) | too_slow | self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state() | {"multipliers": self.multipliers.state()}

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
        self.multipliers.load_state(state["multipliers"])
