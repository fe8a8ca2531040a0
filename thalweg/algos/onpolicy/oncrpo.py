"""Constraint-rectified policy optimisation (Xu, Liang, Lan 2021), on-policy: each natural step raises the
return while the cost is within its limit, and lowers the cost otherwise."""

from typing import Any

from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics, limit_warnings
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import standardised
from thalweg.algos.maths.trust_region import natural_step
from thalweg.algos.onpolicy.agent import (
    Agent,
    KLMonitor,
    cost_advantages,
    cost_signals,
    metrics_of,
    reward_signal,
)
from thalweg.algos.onpolicy.config import ConstrainedConfig, NaturalConfig
from thalweg.algos.onpolicy.natural_step import NaturalStep, most_violated
from thalweg.core.config import FiniteNonNegative, frozen_config


@frozen_config(AlgorithmError)
class OnCRPOConfig(ConstrainedConfig, NaturalConfig):
    """Settings of OnCRPO."""

    standardise_cost: bool = True
    """Whether cost advantages are divided by their standard deviation. The length of a step is that of the trust region
    in either case: it matters only beside `imitation_kl`."""
    tolerance: FiniteNonNegative = 0.0
    """How far above its limit a mean cost may be before the next step reduces it."""


class OnCRPO:
    """The OnCRPO algorithm; see `Learner` for its methods."""

    def __init__(self, config: OnCRPOConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("OnCRPO", 1 + len(config.limits), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Take one natural step for the reward or against a cost, train the critics, and return the metrics."""
        config, agent = self.config, self.agent
        samples = agent.samples(rollout, [reward_signal(config, rollout), *cost_signals(config, rollout)])
        limits, means = config.current_limits(feedback), config.cost_means(feedback)
        worst, violation = most_violated(means, limits)
        rectifies = violation > config.tolerance
        advantages = -cost_advantages(config, samples)[worst] if rectifies else standardised(samples.advantages[0])
        monitor = KLMonitor(agent, samples)
        with agent.critics_learning(samples, config.passes):
            refused = self._step(advantages, monitor, NaturalStep(agent, samples, monitor, config, feedback.progress))
        monitor.measure()
        policy_loss = -losses.surrogate(monitor.log_prob, monitor.old_log_prob, advantages)
        return (
            metrics_of(agent, samples, [policy_loss], monitor)
            | {"rectifies": float(rectifies), "steps_refused": refused}
            | cost_metrics(feedback, limits, means)
        )

    def _step(self, advantages: Tensor, monitor: KLMonitor, natural: NaturalStep) -> int:
        """Take the longest step along H⁻¹ g that improves the surrogate, less the KL from the policy that the run
        begins with, and return the number of rejected steps."""
        gradient = natural.gradient(advantages) - natural.imitation_gradient()
        along = natural.solve(gradient)
        step = natural_step(float(gradient.dot(along)), natural.radius) * along
        before = float(advantages.mean()) - natural.imitation

        def accepts(log_prob: Tensor, imitation: float) -> bool:
            return float(losses.surrogate(log_prob, monitor.old_log_prob, advantages)) - imitation > before

        return natural.search(step, accepts)

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about cost limits that no episode has exceeded, and a policy that never learns."""
        return limit_warnings(self.config, feedback) | self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
