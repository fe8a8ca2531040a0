"""First-order constrained optimisation in policy space (Zhang, Vuong, Ross 2020): the best policy within a trust
region and a cost limit, in closed form, then projected back onto what the network can express, state by state."""

from typing import Any, Literal

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
from thalweg.core.config import FiniteNonNegative, FinitePositive, frozen_config


@frozen_config(AlgorithmError)
class FOCOPSConfig(LagrangianConfig):
    """Settings of FOCOPS; its multiplier is called ν in its paper."""

    temperature: FinitePositive = 0.5
    """Temperature λ: a larger one makes the policy follow the advantages less."""
    trust_radius: FinitePositive = 0.02
    """Trust region η of each state, a KL in nats, summed over action branches. Beyond it, only the entropy term of the
    loss has a gradient in that state."""
    mask: Literal["state", "batch"] = "state"
    """Kind of trust region: "state" is that of the paper, "batch" the weaker one that OmniSafe 0.5 computes by a
    broadcast."""
    normalise_by_multiplier: bool = False
    """Whether A_r - Σ ν A_c is divided by 1 + Σ ν, as in OmniSafe; the paper does not divide it."""
    entropy: FiniteNonNegative = 0.01
    """Coefficient of the policy's entropy (nats, summed over action branches) in the loss; the paper has none."""


def policy_loss(
    config: FOCOPSConfig, log_prob: Tensor, old_log_prob: Tensor, kl: Tensor, advantages: Tensor, entropy: Tensor
) -> Tensor:
    """Return L = E_s[1{KL_s ≤ η} (KL_s - ρ (A_r - ν A_c) / λ)] - c E_s[H_s] from arguments of shape [B].

    The entropy counts in every state, also where KL_s exceeds η.
    """
    projection = losses.focops(
        log_prob,
        old_log_prob,
        kl,
        advantages,
        temperature=config.temperature,
        radius=config.trust_radius,
        mask=config.mask,
    )
    return projection - config.entropy * entropy.mean()


class FOCOPS:
    """The FOCOPS algorithm; see `Learner` for its methods."""

    def __init__(self, config: FOCOPSConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("FOCOPS", 1 + len(config.limits), config, task)
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
            normalised=config.normalise_by_multiplier,
        )
        rate, monitor = agent.decay(feedback.progress), KLMonitor(agent, samples, new_first=True)
        data = (samples.actions, monitor.old_parameters, monitor.old_log_prob, advantages, samples.imitated)
        log: list[Tensor] = []
        while monitor.may_continue:
            with agent.critics_learning(samples):
                for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                    log.append(self._step(inputs, *rows))
            monitor.measure()
        inside = float((monitor.kl_per_state <= config.trust_radius).float().mean())
        remaining = agent.updates_left(feedback)
        return (
            metrics_of(agent, samples, log, monitor)
            | {"learning_rate": rate, "inside_fraction": inside}
            | self.multipliers.metrics(feedback, remaining)
            | cost_metrics(feedback, limits, config.cost_means(feedback))
        )

    def _step(
        self,
        inputs: Tensor | Sequences,
        actions: Tensor,
        old_parameters: Tensor,
        old_log_prob: Tensor,
        advantages: Tensor,
        imitated: Tensor,
    ) -> Tensor:
        """Take one gradient step of the policy, and return its loss."""
        old = self.policy.actions.distribution(old_parameters)
        return self.agent.step(
            inputs,
            lambda new: policy_loss(
                self.config, new.log_prob(actions), old_log_prob, new.kl(old), advantages, new.entropy()
            ),
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
