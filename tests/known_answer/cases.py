"""Cases of the known-answer tests in CI: each algorithm in its native space, with one seed."""

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


def check_reached(case: Case, folder: Path, seed: int = 0) -> None:
    """Train a policy and assert that it reaches the required return within the limit."""
    result = trained(case, seed, folder)
    assert result.reached, f"{result.share:.1%} of the optimum, cost {result.score.cost:.3f} of {case.limit}"
    if case.requirement.against == "free":  # it knows no limit, and breaks the one that the others keep
        assert result.score.cost > 1.5 * sum(np.atleast_1d(np.asarray(case.limit)))
