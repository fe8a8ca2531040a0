"""Does learning reach the optimum that a linear programme knows? Each algorithm in its native space, with one seed.

Every space, every problem and five seeds: `benchmarks/known_answer.py`.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.known_answer.harness import Cell, ci_cells, trained

SEED = 0


def named(cell: Cell) -> str:
    return f"{cell.algorithm}-{cell.place}-{cell.problem}"


@pytest.mark.slow
@pytest.mark.parametrize("cell", ci_cells(), ids=named)
def test_the_optimum_is_reached_within_the_limit(cell: Cell, tmp_path: Path):
    result = trained(cell, SEED, tmp_path)
    assert result.reached, f"{result.share:.1%} of the optimum, cost {result.score.cost:.3f} of {cell.limit}"
    if cell.row.against == "free":  # it knows no limit, and breaks the one that the others keep
        assert result.score.cost > 1.5 * sum(np.atleast_1d(np.asarray(cell.limit)))
