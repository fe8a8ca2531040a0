"""Cases of the known-answer tests in CI: each algorithm in its native space, with one seed."""

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.known_answer.harness import ROWS, Cell, trained

OFF_POLICY_ONES, PLANNERS = ("DDPGLag", "TD3Lag", "SACLag"), ("SafeLOOP", "CCEPETS")
ON_POLICY_ONES = tuple(name for name in ROWS if name not in (*OFF_POLICY_ONES, *PLANNERS))


def ci_cells(algorithms: Collection[str]) -> list[Any]:
    """Test parameters for the algorithms, each in its native space."""
    cells = [Cell(name, ROWS[name].places[0], problem) for name in algorithms for problem in ROWS[name].in_ci]
    return [pytest.param(cell, id=f"{cell.algorithm}-{cell.place}-{cell.problem}") for cell in cells]


def check_reached(cell: Cell, folder: Path, seed: int = 0) -> None:
    """Train a policy and assert that it reaches the required return within the limit."""
    result = trained(cell, seed, folder)
    assert result.reached, f"{result.share:.1%} of the optimum, cost {result.score.cost:.3f} of {cell.limit}"
    if cell.row.against == "free":  # it knows no limit, and breaks the one that the others keep
        assert result.score.cost > 1.5 * sum(np.atleast_1d(np.asarray(cell.limit)))
