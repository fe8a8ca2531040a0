"""Tests of when the planner's search ends, for each environment."""

from typing import Any

import pytest
import torch

from tests.algos.planning.planning_fixtures import BOX, OPTIONS, ensemble_for, generator
from thalweg.algos.planning.imagined_rollouts import PlanOutcomes
from thalweg.algos.planning.model.ensemble import FrozenEnsemble
from thalweg.algos.planning.planner import Budget, Planner
from thalweg.algos.planning.safeloop import SafeLOOPConfig
from thalweg.algos.policy.actions import actions_of

ITERATIONS = 5


class FixedWeights:
    """Method that gives all weight to one candidate in the first `certain` environments and equal weights elsewhere."""

    modules, mean_momentum, proposal_share = torch.nn.ModuleDict(), 0.0, 0.0

    def __init__(self, certain: int) -> None:
        self.certain, self.batch_sizes = certain, []

    def weights(self, outcomes: PlanOutcomes, budget: Budget) -> torch.Tensor:
        certain = self.certain if not self.batch_sizes or len(outcomes.returns) == self.batch_sizes[0] else 0
        self.batch_sizes.append(len(outcomes.returns))
        weights = torch.full_like(outcomes.returns, 1 / outcomes.returns.shape[1])
        weights[:certain] = torch.nn.functional.one_hot(torch.tensor(0), outcomes.returns.shape[1]).float()
        return weights

    def value(self) -> None:
        return None

    def proposals(self, frozen: FrozenEnsemble, start: torch.Tensor, generator: torch.Generator) -> None:
        return None


def search(certain: int, settled_variance: float, space: Any = BOX) -> tuple[list[int], torch.Tensor]:
    """Number of environments in each iteration, and the plans of the two environments."""
    config = SafeLOOPConfig(
        samples=64, iterations=ITERATIONS, horizon=2, settled_variance=settled_variance, floor=0.0, momentum=0.1
    )
    actions = actions_of(space, "native", "squashed")
    method = FixedWeights(certain)
    planner = Planner(config, actions, method)
    frozen = FrozenEnsemble(ensemble_for(space), torch.float32)
    decision = planner.decide(
        frozen, torch.zeros(2, 3), planner.distribution.first(2), Budget(torch.ones(1), 1.0), generator()
    )
    assert decision.reward.isfinite().all() and decision.cost.isfinite().all()
    return method.batch_sizes, decision.plan


def test_search_runs_all_iterations_without_a_variance_threshold():
    assert search(2, 0.0)[0] == [2] * ITERATIONS


@pytest.mark.parametrize(
    ("settled", "iterations"), [(0.2, 1), (0.02, 2), (0.002, 3), (0.00002, 5)]
)  # all weight on one candidate reduces the variance from 0.25 to a tenth in each iteration
def test_search_of_continuous_actions_ends_when_no_variance_exceeds_the_threshold(settled: float, iterations: int):
    assert search(2, settled)[0] == [2] * iterations


def test_settled_environment_keeps_its_plan_while_the_search_continues_for_others():
    batch_sizes, plan = search(1, 0.01)
    assert batch_sizes == [2, 2, 1, 1, 1]
    assert float(plan[0, ..., 1].max()) == pytest.approx(0.0025)
    assert float(plan[1, ..., 1].min()) > 0.1


def test_search_of_discrete_actions_ends_when_each_is_nearly_certain():
    # After one iteration a tenth of the uniform start is left: p (1 - p) is 0.93 times 0.07 for three options.
    assert search(2, 0.0623, OPTIONS)[0] == [2]
    assert search(2, 0.0621, OPTIONS)[0][:2] == [2, 2]
