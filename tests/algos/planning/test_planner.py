"""The search for a decision: when it ends, and for which environments."""

from typing import Any

import pytest
import torch

from tests.algos.planning.made import BOX, OPTIONS, ensemble_for, generator
from thalweg.algos.planning.imagined_rollouts import Futures
from thalweg.algos.planning.model.ensemble import FrozenEnsemble
from thalweg.algos.planning.planner import Budget, Planner
from thalweg.algos.planning.safeloop import SafeLOOPConfig
from thalweg.algos.policy.actions import actions_of

ITERATIONS = 5


class Decided:
    """Gives all weight to one candidate in the first `certain` environments that are asked about, and the same weight
    to each elsewhere."""

    modules, mean_momentum = torch.nn.ModuleDict(), 0.0

    def __init__(self, certain: int) -> None:
        self.certain, self.asked = certain, []

    def weights(self, futures: Futures, budget: Budget) -> torch.Tensor:
        certain = self.certain if not self.asked or len(futures.returns) == self.asked[0] else 0
        self.asked.append(len(futures.returns))
        weights = torch.full_like(futures.returns, 1 / futures.returns.shape[1])
        weights[:certain] = torch.nn.functional.one_hot(torch.tensor(0), futures.returns.shape[1]).float()
        return weights

    def value(self) -> None:
        return None

    def proposals(self, frozen: FrozenEnsemble, start: torch.Tensor, generator: torch.Generator) -> None:
        return None


def decided(certain: int, settled_variance: float, space: Any = BOX) -> tuple[list[int], torch.Tensor]:
    """How many environments each iteration looked at, and the plans of the two."""
    config = SafeLOOPConfig(
        samples=64, iterations=ITERATIONS, horizon=2, settled_variance=settled_variance, floor=0.0, momentum=0.1
    )
    actions = actions_of(space, "native", "squashed")
    method = Decided(certain)
    planner = Planner(config, actions, method)
    frozen = FrozenEnsemble(ensemble_for(space), torch.float32)
    found = planner.decide(
        frozen, torch.zeros(2, 3), planner.distribution.first(2), Budget(torch.ones(1), 1.0), generator()
    )
    assert found.reward.isfinite().all() and found.cost.isfinite().all()
    return method.asked, found.plan


def test_a_search_takes_all_iterations_unless_told_when_it_is_settled():
    assert decided(2, 0.0)[0] == [2] * ITERATIONS


@pytest.mark.parametrize(
    ("settled", "iterations"), [(0.2, 1), (0.02, 2), (0.002, 3), (0.00002, 5)]
)  # 0.25 falls to a tenth with each iteration that knows what it wants
def test_a_search_of_numbers_ends_once_no_variance_is_above_the_threshold(settled: float, iterations: int):
    assert decided(2, settled)[0] == [2] * iterations


def test_an_environment_that_has_settled_keeps_its_plan_while_others_are_searched_for():
    asked, plan = decided(1, 0.01)
    assert asked == [2, 2, 1, 1, 1]
    assert float(plan[0, ..., 1].max()) == pytest.approx(0.0025)
    assert float(plan[1, ..., 1].min()) > 0.1


def test_options_settle_when_each_is_nearly_certain():
    # After one iteration a tenth of the uniform start is left: p (1 - p) is 0.93 times 0.07 for three options.
    assert decided(2, 0.0623, OPTIONS)[0] == [2]
    assert decided(2, 0.0621, OPTIONS)[0][:2] == [2, 2]
