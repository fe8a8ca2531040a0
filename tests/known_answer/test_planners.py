"""Tests that planners reach the optimum of a linear programme, in their native space with one seed.

Each kind of algorithm has a file, so that the kinds can run in parallel. `benchmarks/known_answer.py` runs all spaces
and problems with five seeds.
"""

from pathlib import Path

import pytest

from tests.known_answer.cases import PLANNERS, check_reached, ci_cases
from tests.known_answer.harness import Case


@pytest.mark.slow
@pytest.mark.parametrize("case", ci_cases(PLANNERS))
def test_the_optimum_is_reached_within_the_limit(case: Case, tmp_path: Path):
    check_reached(case, tmp_path)
