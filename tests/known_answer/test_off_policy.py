"""Do off-policy algorithms reach the optimum that a linear programme knows, each in its native space with one seed?

A file for each kind of algorithm, for two files are run at a time. Every space, every problem and five seeds:
`benchmarks/known_answer.py`.
"""

from pathlib import Path

import pytest

from tests.known_answer.cases import OFF_POLICY_ONES, check_reached, ci_cells
from tests.known_answer.harness import Cell


@pytest.mark.slow
@pytest.mark.parametrize("cell", ci_cells(OFF_POLICY_ONES))
def test_the_optimum_is_reached_within_the_limit(cell: Cell, tmp_path: Path):
    check_reached(cell, tmp_path)
