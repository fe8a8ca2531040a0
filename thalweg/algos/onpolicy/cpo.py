"""Constrained policy optimisation (Achiam et al. 2017): the best natural step that keeps the cost limit to first order,
in closed form. It is not one of the study's ten algorithms, but a common reference in the field."""

from typing import Any, Self

from pydantic import model_validator
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import cost_metrics, limit_warnings
from thalweg.algos.interface import Feedback, Rollout, Task
from thalweg.algos.maths import losses
from thalweg.algos.maths.advantages import centred, standardised
from thalweg.algos.maths.trust_region import cpo_step
from thalweg.algos.onpolicy.agent import Agent, cost_signals, metrics_of, reward_signal
from thalweg.algos.onpolicy.config import ConstrainedConfig, NaturalConfig
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.natural_step import NaturalStep, most_violated
from thalweg.core.config import frozen_config

FAR_BELOW = -1e6
"""Violation that is assumed before any episode has finished."""


@frozen_config(AlgorithmError)
class CPOConfig(ConstrainedConfig, NaturalConfig):
    """Settings of CPO."""

    standardise_cost: bool = False
    """Must be off: CPO always divides the cost advantages and the violation by the same standard deviation."""

    @model_validator(mode="after")
    def _cost_is_not_standardised(self) -> Self:
        if self.standardise_cost:
            raise ValueError("standardise_cost must be off for CPO, which itself scales advantages and violation alike")
        return self


class CPO:
    """The CPO algorithm; see `Learner` for its methods.

    With several limits, each step considers only the one with the largest violation or, if none is violated, the
    smallest margin.
    """

    def __init__(self, config: CPOConfig, task: Task) -> None:
        self.config, self.separate_costs, self.resets = config, config.separate_costs, config.reset_each_update
        self.agent = Agent("CPO", 1 + len(config.limits), config, task)
        self.policy, self.rollout_steps = self.agent.policy, self.agent.rollout_steps

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] sampled from the policy."""
        return self.agent.act(obs, fresh)

    def warm_up_critics(self) -> None:
        """Let only the critics learn during the next `critic_warmup_steps`."""
        self.agent.warm_up_critics()

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Take one constrained natural-gradient step of the policy, train the critics, and return the metrics."""
        config, agent = self.config, self.agent
        samples = agent.samples(rollout, [reward_signal(config, rollout), *cost_signals(config, rollout)])
        limits, means = config.current_limits(feedback), config.cost_means(feedback)
        worst, violation = most_violated(means, limits)
        # An episode's cost is a sum over its steps, and the surrogate is a mean over steps. Before any episode has
        # ended there is no length, but then nothing is known to be violated either.
        per_step = violation / feedback.mean_length if feedback.episodes else FAR_BELOW
        rewards, costs = standardised(samples.advantages[0]), centred(samples.advantages[1 + worst])
        deviation = float(costs.std(correction=0)) + 1e-8  # so that the programme does not depend on a cost's unit
        costs, per_step = costs / deviation, per_step / deviation
        monitor = KLMonitor(agent, samples)
        with agent.critics_learning(samples, config.passes):
            found = self._step(
                rewards, costs, per_step, monitor, NaturalStep(agent, samples, monitor, config, feedback.progress)
            )
        monitor.measure()
        policy_loss = -losses.surrogate(monitor.log_prob, monitor.old_log_prob, rewards)
        return metrics_of(agent, samples, [policy_loss], monitor) | found | cost_metrics(feedback, limits, means)

    def _step(
        self, rewards: Tensor, costs: Tensor, violation: float, monitor: KLMonitor, natural: NaturalStep
    ) -> dict[str, float]:
        """Take the longest accepted step along the solution of the constrained problem, and return its metrics.

        A step is accepted if the reward's surrogate, less the KL from the policy that the run begins with, does not
        fall, unless the limit is violated, and the cost's surrogate rises by at most the margin below the limit.
        """
        g, b = natural.gradient(rewards) - natural.imitation_gradient(), natural.gradient(costs)
        along_g, along_b = natural.solve(g), natural.solve(b)
        q, r, s = (float(x) for x in (g.dot(along_g), g.dot(along_b), b.dot(along_b)))
        direction = cpo_step(q, r, s, violation, natural.radius)
        step = direction.along_reward * along_g + direction.along_cost * along_b

        def accepts(log_prob: Tensor, imitation: float) -> bool:
            gain = float(losses.surrogate(log_prob, monitor.old_log_prob, rewards) - rewards.mean())
            gain -= imitation - natural.imitation
            rise = float(losses.surrogate(log_prob, monitor.old_log_prob, costs) - costs.mean())
            return (gain >= 0 or violation > 0) and rise <= max(-violation, 0.0)

        refused = natural.search(step, accepts)
        return {
            "feasible": float(direction.feasible),
            "binding": float(direction.along_cost < 0),
            "steps_refused": refused,
        }

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about cost limits that no episode has exceeded, and a policy that never learns."""
        return limit_warnings(self.config, feedback) | self.agent.warnings(feedback)

    def state(self) -> dict[str, Any]:
        return self.agent.state()

    def load_state(self, state: dict[str, Any]) -> None:
        self.agent.load_state(state)
