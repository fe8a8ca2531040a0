"""Tests of the files of the oracle's fronts, and of limits that follow from them."""

from dataclasses import replace
from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.fronts.fronts import (
    UNSEEN,
    FrontPoint,
    cost_limits,
    front_of,
    points_of,
    read_fronts,
    write_fronts,
)

DEAR = FrontPoint("Nests", "Medium", "fixed", float("inf"), 100, 6.0, 5.9, 6.1, 0.0, 0.0, 0.1, 1)
FREE = replace(DEAR, price=0.0, return_=10.0, cost=40.0, cost_low=38.0, cost_high=42.0)
MIDDLE = replace(DEAR, price=0.1, return_=8.0, cost=10.0)
OTHERS = replace(FREE, rivers=UNSEEN, cost=1.0), replace(FREE, level="Hard"), replace(FREE, task="Portage")


def test_points_read_back_to_the_same_bits(tmp_path: Path):
    points = [FREE, MIDDLE, DEAR, replace(FREE, price=1 / 3)]
    write_fronts(tmp_path / "fronts.csv", points)
    assert read_fronts(tmp_path / "fronts.csv") == points


def test_points_are_those_of_the_task_the_level_and_the_rivers_by_rising_cost():
    assert points_of([FREE, *OTHERS, MIDDLE, DEAR], "Nests", "Medium") == [DEAR, MIDDLE, FREE]


def test_limits_are_the_costs_at_which_shares_of_the_return_are_kept():
    # Returns of 6.4, 7 and 8 on the line from (0, 6) over (10, 8): costs of 2, 5 and 10.
    assert cost_limits(front_of([FREE, MIDDLE, DEAR])) == (2.0, 5.0, 10.0)


def test_limits_have_two_significant_digits():
    assert cost_limits(front_of([FREE, replace(MIDDLE, cost=11.37), DEAR])) == (2.3, 5.7, 11.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("10.0,5.9", "no,5.9"), "line 2: could not convert"),
        (("10.0,5.9", "inf,5.9"), "line 2: return and cost must be"),
    ],
)
def test_numbers_that_cannot_be_are_named_with_their_line(tmp_path: Path, change: tuple[str, str], message: str):
    write_fronts(tmp_path / "fronts.csv", [FREE])
    text = (tmp_path / "fronts.csv").read_text()
    assert change[0] in text
    (tmp_path / "fronts.csv").write_text(text.replace(*change))
    with pytest.raises(ResultsError, match=message):
        read_fronts(tmp_path / "fronts.csv")


def test_a_file_of_another_kind_is_refused(tmp_path: Path):
    (tmp_path / "fronts.csv").write_text("task,level\nNests,Medium\n")
    with pytest.raises(ResultsError, match="lacks the columns rivers"):
        read_fronts(tmp_path / "fronts.csv")
