"""Penalised proximal policy optimisation (Zhang L. et al. 2022): the clipped surrogate of the reward with an
exact penalty, which is active only while the surrogate of the cost predicts that the limit is exceeded."""

from typing import Any, Literal, Self

import torch
from pydantic import PositiveFloat, model_validator
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics, limit_warnings
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
from thalweg.algos.onpolicy.config import ConstrainedConfig, FirstOrderConfig
from thalweg.algos.policy.distributions import Distribution, TapedDistribution
from thalweg.algos.policy.memory import Sequences
from thalweg.core.config import FiniteNonNegative, frozen_config


@frozen_config(AlgorithmError)
class P3OConfig(ConstrainedConfig, FirstOrderConfig):
    """Settings of P3O."""

    penalty: FiniteNonNegative = 2.0
    """Weight κ of the penalty; the penalty is exact once κ exceeds the optimal multiplier."""
    entropy: FiniteNonNegative = 0.01
    """Coefficient of the policy's entropy (nats, summed over action branches) in the loss."""
    clip: PositiveFloat = 0.2
    """Clip range ε: the probability ratio is clipped to 1 ± ε."""
    clip_cost: bool = True
    """Whether the cost's surrogate is clipped too, as in the paper; OmniSafe 0.5 does not clip it."""
    limit_scale: Literal["length", "discount", "none"] = "length"
    """How the violation of an episode is scaled to a mean over steps: "length" divides it by the mean episode length,
    which suits undiscounted costs; "discount" multiplies it by 1-γ, as in the paper, whose costs are discounted; "none"
    leaves it, as in OmniSafe 0.5, where its sign alone decides."""
    centre_minibatches: bool = True
    """Whether the cost's advantages are centred over each minibatch too, so that noise alone does not switch the
    penalty on; OmniSafe centres them over the rollout only."""
    standardise_cost: bool = True
    """Whether a cost's advantages, and the violation with them, are divided by their deviation, so that κ has no
    unit; otherwise the advantages are only centred."""

    @model_validator(mode="after")
    def _discounted_violation_is_not_nothing(self) -> Self:
        if self.limit_scale == "discount" and self.cost_discount == 1:
            raise ValueError("cost_discount must be below 1 with limit_scale=discount, got 1.0")
        return self


def policy_loss(
    config: P3OConfig,
    log_prob: Tensor,
    old_log_prob: Tensor,
    advantages: Tensor,
    cost_advantages: Tensor,
    violations: Tensor,
    scale: float,
    entropy: Tensor,
) -> tuple[Tensor, Tensor]:
    """Return L = L_clip + κ Σ_i max(0, E[max(ρ A_ci, clip(ρ) A_ci)] + k (J_ci - d_i)) - c H, and its penalties [M].

    Args:
        config: The settings.
        log_prob: [B], log π_θ(a|s).
        old_log_prob: [B], log π_k(a|s).
        advantages: [B], A_r.
        cost_advantages: [B, M], A_c.
        violations: [M], J_c - d, in the unit of A_c.
        scale: k, as `limit_scale` says.
        entropy: [B].
    """
    penalties = torch.stack(
        [
            losses.p3o_penalty(
                log_prob,
                old_log_prob,
                cost,
                float(violation),
                clip=config.clip,
                scale=scale,
                clipped=config.clip_cost,
            )
            for cost, violation in zip(cost_advantages.unbind(1), violations, strict=True)
        ]
    )
    reward = losses.ppo_clip(log_prob, old_log_prob, advantages, config.clip)
    return reward + config.penalty * penalties.sum() - config.entropy * entropy.mean(), penalties


class P3O:
    """The P3O algorithm; see `Learner` for its methods."""

    def __init__(self, config: P3OConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("P3O", 1 + len(config.limits), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Train until the KL exceeds `target_kl` or all passes are done, and return the metrics."""
        config, agent = self.config, self.agent
        samples = agent.samples(rollout, [reward_signal(config, rollout), *cost_signals(config, rollout)])
        costs = cost_advantages(config, samples)
        limits, means = config.current_limits(feedback), config.cost_means(feedback)
        above = torch.tensor(means, dtype=torch.float32) - torch.tensor(limits, dtype=torch.float32)
        violations = torch.nan_to_num(above, nan=-float("inf"))
        if config.standardise_cost:
            violations = violations / (samples.advantages[1:].std(1, correction=0).cpu() + 1e-8)
        length = feedback.mean_length if feedback.episodes else 1.0  # before any there is no violation either
        scale = {"length": 1.0 / length, "discount": 1.0 - config.cost_discount, "none": 1.0}
        rate, monitor = agent.decay(feedback.progress), KLMonitor(agent, samples)
        rewards = standardised(samples.advantages[0])
        data = (samples.actions, monitor.old_log_prob, rewards, costs.T, samples.imitated)
        log: list[Tensor] = []
        penalties: list[Tensor] = []
        while monitor.may_continue:
            with agent.critics_learning(samples):
                for inputs, rows in samples.minibatches(data, config.minibatch, agent.generator):
                    found, penalty = self._step(violations, scale[config.limit_scale], inputs, *rows)
                    log.append(found)
                    penalties.append(penalty)
            monitor.measure()
        weighed = torch.stack(penalties)
        return (
            metrics_of(agent, samples, log, monitor)
            | {"learning_rate": rate, "clip_fraction": monitor.clip_fraction(config.clip)}
            | {
                "penalty": config.penalty * float(weighed.sum(1).mean()),
                "gate": float((weighed > 0).any(1).float().mean()),
            }
            | cost_metrics(feedback, limits, means)
        )

    def _step(
        self,
        violations: Tensor,
        scale: float,
        inputs: Tensor | Sequences,
        actions: Tensor,
        old_log_prob: Tensor,
        advantages: Tensor,
        costs: Tensor,
        imitated: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Take one gradient step of the policy, and return its loss and the penalties [M]."""
        if self.config.centre_minibatches:
            costs = costs - costs.mean(0)
        penalties = costs.new_zeros(len(violations))

        def loss_of(new: Distribution | TapedDistribution) -> Tensor:
            nonlocal penalties
            loss, penalties = policy_loss(
                self.config, new.log_prob(actions), old_log_prob, advantages, costs, violations, scale, new.entropy()
            )
            return loss

        return self.agent.step(inputs, loss_of, imitated), penalties.detach()

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about cost limits that no episode has exceeded, and a policy that never learns."""
        return limit_warnings(self.config, feedback) | self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
