"""Cases of the known-answer tests in CI: each algorithm in its native space."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.known_answer.harness import REQUIREMENTS, Case, trained

OFF_POLICY, PLANNERS = ("DDPGLag", "TD3Lag", "SACLag"), ("SafeLOOP", "CCEPETS")
ON_POLICY = tuple(name for name in REQUIREMENTS if name not in (*OFF_POLICY, *PLANNERS))


def ci_cases(algorithms: Collection[str]) -> list[Any]:
    """Test parameters for the algorithms, each in its native space."""
    cases = [
        Case(name, REQUIREMENTS[name].action_setups[0], problem)
        for name in algorithms
        for problem in REQUIREMENTS[name].in_ci
    ]
    return [pytest.param(case, id=f"{case.algorithm}-{case.action_setup}-{case.problem}") for case in cases]


def check_reached(case: Case, folder: Path, seeds: int = 1) -> None:
    """Train with the first seeds until most of them have reached the required return within the limit, or cannot.

    Off-policy algorithms get several seeds: their cost oscillates about the limit, and on `dense` two of fifteen runs
    end above it (benchmarks/known_answer.md). Which ones depends on how a processor rounds.
    """
    most, reached, failures = seeds // 2 + 1, 0, []
    for seed in range(seeds):
        result = trained(case, seed, folder / str(seed))
        share, cost = result.share, result.score.cost
        if case.requirement.against == "free":  # it knows no limit, and breaks the one that the others keep
            assert cost > 1.5 * sum(np.atleast_1d(np.asarray(case.limit)))
        if result.reached:
            reached += 1
        else:
            failures.append(f"seed {seed}: {share:.1%} of the optimum, cost {cost:.3f} of {case.limit}")
        if most in (reached, len(failures)):
            break
    assert reached == most, "; ".join(failures)
