"""Tests of what the page says before its sections."""

from dataclasses import replace

import pytest

from tests.bench.report.small_results import SUITE
from thalweg.bench.report.html.page import page
from thalweg.bench.results.results import Results
from thalweg.bench.suite.arms import Arm

SMOKE = "This is far fewer than the paper's 200,000 steps: it shows that everything runs, not which policy is better."
BESIDE = "The paper's runs have 200,000 steps."


@pytest.mark.parametrize(("steps", "told"), [(19_999, [SMOKE]), (20_000, [BESIDE]), (100_000, [BESIDE]), (200_000, [])])
def test_only_runs_of_less_than_a_tenth_of_the_papers_steps_are_said_to_show_that_everything_runs(
    steps: int, told: list[str], results: Results
):
    suite = replace(SUITE, arms=(Arm("PPO", steps=steps),)).as_data()
    found = page(replace(results, suite=suite), [], {}, {}, []).replace("&#39;", "'")
    assert [sentence for sentence in (SMOKE, BESIDE) if sentence in found] == told
