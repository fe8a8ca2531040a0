"""Planner: samples candidate plans, imagines their outcomes, weights them and updates the plan distribution.

All environments are planned for at once, in several iterations.

Dimensions: N environments, S candidates, G proposals among them, H steps ahead, A numbers of a raw action, K frames
of D numbers, C costs.
"""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from thalweg.algos.common.state import CPU
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.planning.imagined_rollouts import (
    PlanOutcomes,
    Value,
    evaluate_rollouts,
    imagine_rollouts,
    sample_noise,
)
from thalweg.algos.planning.model.ensemble import FrozenEnsemble, action_features
from thalweg.algos.planning.plan_distribution import plan_distribution_of
from thalweg.algos.policy.actions import Actions


@dataclass(frozen=True)
class Budget:
    """Cost that a plan may have."""

    costs: Tensor
    """[C], within the horizon."""
    per_episode: float
    """Horizons per episode: the factor from a sum over the horizon to a sum over the episode."""


class Method(Protocol):
    """The part that differs between planning algorithms."""

    modules: nn.ModuleDict
    """Networks beside the model; saved with the policy."""
    mean_momentum: float
    """Weight of the previous mean of continuous actions in each update."""
    proposal_share: float
    """Weight of the proposals in the initial plan of each decision, 0..1."""

    def weights(self, outcomes: PlanOutcomes, budget: Budget) -> Tensor:
        """Return the weights [N, S] of the candidates, which sum to 1 for each environment."""
        ...

    def value(self) -> Value | None:
        """Return the terminal value after the horizon; None counts it as 0."""
        ...

    def proposals(self, frozen: FrozenEnsemble, start: Tensor, generator: torch.Generator) -> Tensor | None:
        """Return candidates [N, G, H, A] besides the sampled ones, for normalised observations [N, K * D]."""
        ...


@dataclass(frozen=True)
class Decision:
    """Plan of each environment, with its expected reward and cost."""

    plan: Tensor
    """[N, H, A, W], parameters of the `PlanDistribution`."""
    reward: Tensor
    """[N], expected within the horizon: the weighted mean over the last candidates."""
    cost: Tensor
    """[N, C], computed like `reward`."""
    feasible: Tensor
    """[N], share of the last candidates that stay within the budget."""


class Planner:
    """Stateless planner on an ensemble of models."""

    def __init__(self, config: PlanningConfig, actions: Actions, method: Method, device: torch.device = CPU) -> None:
        self.config, self.actions, self.method = config, actions, method
        self.distribution = plan_distribution_of(actions, config, method.mean_momentum, device)

    def decide(
        self, frozen: FrozenEnsemble, start: Tensor, guess: Tensor, budget: Budget, generator: torch.Generator
    ) -> Decision:
        """Improve initial plans [N, H, A, W] for normalised observations [N, K * D]."""
        envs, costs = len(guess), len(budget.costs)
        proposals = self.method.proposals(frozen, start, generator)
        if proposals is not None and self.method.proposal_share:
            guess = self.distribution.drawn_to(guess, proposals, self.method.proposal_share)
        decision = Decision(guess.clone(), start.new_empty(envs), start.new_empty(envs, costs), start.new_empty(envs))
        active = torch.arange(envs, device=start.device)
        for _ in range(self.config.sizes.iterations):
            plan = decision.plan[active]
            samples = self.distribution.samples(plan, self.config.sizes.samples, generator)
            if proposals is not None:
                samples = torch.cat([samples, proposals[active]], 1)
            outcomes = self._imagine(frozen, start[active], samples, generator)
            weights = self.method.weights(outcomes, budget)
            plan = self.distribution.updated(plan, samples, weights)
            decision.plan[active] = plan
            decision.reward[active] = (weights * outcomes.rewards).sum(-1)
            decision.cost[active] = (weights.unsqueeze(-1) * outcomes.costs).sum(1)
            decision.feasible[active] = (outcomes.costs <= budget.costs).all(-1).float().mean(-1)
            if self.config.settled_variance:
                active = active[self.distribution.variance(plan) > self.config.settled_variance]
                if not len(active):
                    break
        return decision

    def _imagine(
        self, frozen: FrozenEnsemble, start: Tensor, samples: Tensor, generator: torch.Generator
    ) -> PlanOutcomes:
        """Return the outcomes of candidates [N, S, H, A]."""
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
