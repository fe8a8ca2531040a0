"""Constrained update projection (Yang et al. 2022): a PPO step for the reward, then a projection that takes back what
costs too much; not among the study's ten."""

from typing import Annotated, Any

from pydantic import Field, PositiveFloat, PositiveInt
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics, limit_warnings
from thalweg.algos.constraint.multiplier import Multipliers
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import standardised
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
from thalweg.core.config import FiniteNonNegative, frozen_config


@frozen_config(AlgorithmError)
class CUPConfig(LagrangianConfig):
    """Settings of CUP; its multiplier is called ν in its paper."""

    clip: PositiveFloat = 0.2
    """Clip range ε of the first step: the probability ratio is clipped to 1 ± ε."""
    entropy: FiniteNonNegative = 0.01
    """Coefficient of the policy's entropy (nats, summed over action branches) in the loss."""
    multiplier_gain: FiniteNonNegative = 0.5
    """K_P: added to ν for each unit of the violation. Smaller than elsewhere: the projection weighs costs by
    (1-γλ)/(1-γ) ν, about six times ν."""
    projection_passes: PositiveInt = 10
    """Largest number of passes of the projection over the rollout."""
    cost_discount: Annotated[float, Field(ge=0, lt=1)] = 0.99
    """γ of the cost; the cost of the projection is divided by 1-γ."""


def improvement_loss(
    config: CUPConfig, log_prob: Tensor, old_log_prob: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """Return L = L_clip - c H of the reward alone, which the first step minimises, from arguments of shape [B]."""
    return losses.ppo_clip(log_prob, old_log_prob, advantages, config.clip) - config.entropy * entropy.mean()


def projection_loss(
    config: CUPConfig, log_prob: Tensor, old_log_prob: Tensor, kl: Tensor, cost_advantages: Tensor
) -> Tensor:
    """Return L = E[KL(π_θ ‖ π_{k+½})] + (1-γλ)/(1-γ) E[ρ Σ ν_i A_ci], which the second step minimises."""
    return losses.cup_projection(
        log_prob, old_log_prob, kl, cost_advantages, discount=config.cost_discount, trace=config.cost_trace
    )


class CUP:
    """The CUP algorithm; see `Learner` for its methods."""

    def __init__(self, config: CUPConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("CUP", 1 + len(config.limits), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps
        self.multipliers = Multipliers(config, config.limits)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Update the multipliers, improve the reward, project towards the limit, and return the metrics."""
        config, agent = self.config, self.agent
        limits = config.current_limits(feedback)
        samples = agent.samples(rollout, [reward_signal(config, rollout), *cost_signals(config, rollout)])
        if not agent.critics_warm_up:
            self.multipliers.update(feedback, limits)
        rate, monitor = agent.decay(feedback.progress), KLMonitor(agent, samples)
        rewards = standardised(samples.advantages[0])
        data = (samples.actions, monitor.old_log_prob, rewards, samples.imitated)
        log: list[Tensor] = []
        while monitor.may_continue:
            with agent.critics_learning(samples):
                for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                    log.append(self._improve(inputs, *rows))
            monitor.measure()
        clipped = monitor.clip_fraction(config.clip)

        advantages = cost_advantages(config, samples)
        costs = (advantages.new_tensor(self.multipliers.values).unsqueeze(-1) * advantages).sum(0)
        back = KLMonitor(agent, samples, new_first=True)
        data = (samples.actions, back.old_parameters, monitor.old_log_prob, costs, samples.imitated)
        while back.passes < config.projection_passes and back.kl <= config.target_kl and any(self.multipliers.values):
            for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                self._project(inputs, *rows)
            back.measure()
        if back.passes:
            monitor.imitation_kl = back.imitation_kl  # that of the policy which acts next
        return (
            metrics_of(agent, samples, log, monitor)
            | {"learning_rate": rate, "clip_fraction": clipped}
            | {"projection_kl": back.kl, "projection_passes": back.passes}
            | self.multipliers.metrics(feedback, agent.updates_left(feedback))
            | cost_metrics(feedback, limits, config.cost_means(feedback))
        )

    def _improve(
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
            lambda new: improvement_loss(self.config, new.log_prob(actions), old_log_prob, advantages, new.entropy()),
            imitated,
        )

    def _project(
        self,
        inputs: Tensor | Sequences,
        actions: Tensor,
        improved: Tensor,
        old_log_prob: Tensor,
        costs: Tensor,
        imitated: Tensor,
    ) -> None:
        """Take one gradient step of the policy towards the limit."""
        half = self.policy.actions.distribution(improved)
        self.agent.step(
            inputs,
            lambda new: projection_loss(self.config, new.log_prob(actions), old_log_prob, new.kl(half), costs),
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
