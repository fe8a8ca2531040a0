"""Planner that makes decisions: candidates are sampled from a plan distribution, imagined and weighted, and the
distribution is updated, for several iterations and all environments at once.

Letters: N environments, S candidates, G proposals among them, H steps ahead, A numbers of a raw action, K frames of D
numbers, C costs.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from thalweg.algos.common.state import CPU
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.planning.imagined_rollouts import Futures, Value, evaluate_rollouts, imagine_rollouts, sample_noise
from thalweg.algos.planning.model.ensemble import FrozenEnsemble, action_features
from thalweg.algos.planning.plan_distribution import plan_distribution_of
from thalweg.algos.policy.actions import Actions


@dataclass(frozen=True)
class Budget:
    """What a decision may cost."""

    costs: Tensor
    """[C] within the horizon."""
    per_episode: float
    """How many horizons an episode has: what a sum over one must be multiplied by to be one over the other."""


class Method(Protocol):
    """What tells one planner from another."""

    modules: nn.ModuleDict
    """What it has learnt beside the model; part of the policy."""
    mean_momentum: float
    """Share of the mean of numbers that an iteration keeps."""

    def weights(self, futures: Futures, budget: Budget) -> Tensor:
        """Weights [N, S] of the candidates, of sum 1."""
        ...

    def value(self) -> Value | None:
        """What is still to come after the horizon; None if that counts for nothing."""
        ...

    def proposals(self, frozen: FrozenEnsemble, start: Tensor, generator: torch.Generator) -> Tensor | None:
        """Candidates [N, G, H, A] that are not drawn from the plan, for normalised observations [N, K * D]."""
        ...


@dataclass(frozen=True)
class Decision:
    """What was decided, and what is expected of it."""

    plan: Tensor
    """[N, H, A, W], as `PlanDistribution` writes it."""
    reward: Tensor
    """[N] expected within the horizon, the mean of the last candidates by their weights."""
    cost: Tensor
    """[N, C], alike."""
    feasible: Tensor
    """[N] share of the last candidates that keep within the budget."""


class Planner:
    """Makes decisions with a model; remembers nothing."""

    def __init__(self, config: PlanningConfig, actions: Actions, method: Method, device: torch.device = CPU) -> None:
        self.config, self.actions, self.method = config, actions, method
        self.distribution = plan_distribution_of(actions, config, method.mean_momentum, device)

    def decide(
        self, frozen: FrozenEnsemble, start: Tensor, guess: Tensor, budget: Budget, generator: torch.Generator
    ) -> Decision:
        """The plan that a first guess [N, H, A, W] becomes, for normalised observations [N, K * D]."""
        envs, costs = len(guess), len(budget.costs)
        found = Decision(guess.clone(), start.new_empty(envs), start.new_empty(envs, costs), start.new_empty(envs))
        searching = torch.arange(envs, device=start.device)
        proposals = self.method.proposals(frozen, start, generator)
        for _ in range(self.config.sizes.iterations):
            plan = found.plan[searching]
            samples = self.distribution.samples(plan, self.config.sizes.samples, generator)
            if proposals is not None:
                samples = torch.cat([samples, proposals[searching]], 1)
            futures = self._imagined(frozen, start[searching], samples, generator)
            weights = self.method.weights(futures, budget)
            plan = self.distribution.updated(plan, samples, weights)
            found.plan[searching] = plan
            found.reward[searching] = (weights * futures.rewards).sum(-1)
            found.cost[searching] = (weights.unsqueeze(-1) * futures.costs).sum(1)
            found.feasible[searching] = (futures.costs <= budget.costs).all(-1).float().mean(-1)
            if self.config.settled_variance:
                searching = searching[self.distribution.variance(plan) > self.config.settled_variance]
                if not len(searching):
                    break
        return found

    def _imagined(self, frozen: FrozenEnsemble, start: Tensor, samples: Tensor, generator: torch.Generator) -> Futures:
        """What candidates [N, S, H, A] lead to."""
        config, value = self.config, self.method.value()
        features = action_features(self.actions, samples).movedim(2, 0)
        noise = sample_noise(
            frozen,
            len(start),
            samples.shape[1],
            config.sizes.particles,
            config.sizes.horizon,
            config.shared_noise,
            generator,
        )
        steps = imagine_rollouts(frozen, start, features, noise, needs_last=value is not None)
        return evaluate_rollouts(
            steps,
            config.planning_discount,
            config.cost_over,
            ends=config.predict_end,
            value=value,
            last_actions=samples[:, :, -1],
        )
