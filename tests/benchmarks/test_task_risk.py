"""Areas and worst tenths on the page of findings on tasks, worked by hand."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from tests.bench.report.small_results import flights
from tests.benchmarks.made_up_tasks import FRONT, SUITE, rows, study
from thalweg.bench.fronts import fronts

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in ("task_risk", "task_outcomes"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setattr(fronts, "read_fronts", lambda: FRONT)
    return importlib.import_module("task_risk")


def test_the_area_is_that_below_the_policies_of_all_limits_in_shares_of_the_oracles(script: ModuleType):
    nests = study([*flights("FOCOPS-8.2", 2, 4.0, 16.0), *flights("FOCOPS-23", 3, 7.0, 56.0),
                   *flights("P3O-23", 3, 4.0, 80.0)])  # fmt: skip
    # Seed 0 returns 5 at a cost of 8 and 8 at 28: 20 * 6.5 + 12 * 8 = 226; a point more over 32 with seed 1: 258.
    # P3O has one limit, of which nothing can be said.
    share = f"{(226 + 258) / 2 / 320:.2f}"
    assert rows(script.area_section({"Nests": nests})) == {"FOCOPS": [f"{share} (2 of 3 limits)"]}
    whole = study([*flights("FOCOPS-8.2", 3, 4.0, 16.0), *flights("FOCOPS-23", 3, 7.0, 56.0),
                   *flights("FOCOPS-49", 3, 7.0, 60.0)])  # fmt: skip
    # The last policy costs more and returns no more. Seeds differ by 32 / 320 = 0.1; Student's t for three is 4.30,
    # and 4.30 * 0.1 / sqrt(3) = 0.25.
    assert rows(script.area_section({"Nests": whole})) == {"FOCOPS": ["0.81 ± 0.25"]}


def test_gaps_of_areas_say_why(script: ModuleType):
    nests = study([*flights("FOCOPS-8.2", 1, 4.0, 16.0), *flights("FOCOPS-23", 1, 7.0, 56.0)])
    empty = replace(nests, results=None)
    single = replace(empty, arms={("FOCOPS", 23.0): "FOCOPS-23"}, limits=(23.0,))
    other = replace(empty, arms={("P3O", 23.0): "P3O-23"})
    every = {"Nests": nests, "empty": empty, "single": single, "other": other}
    assert rows(script.area_section(every))["FOCOPS"][1:] == ["missing", "one limit", "not planned"]


def test_the_worst_tenth_is_told_beside_the_middle_limit(script: ModuleType):
    rising = (replace(row, cost=row.cost * (1 + row.seed)) for row in flights("FOCOPS-23", 3, 4.0, 30.0))
    nests = study([*flights("PPO", 3, 5.0, 80.0), *flights("FOCOPS-8.2", 3, 4.0, 90.0), *rising])
    # Of six flights of FOCOPS the worst 0.6 cost 90; the worst ones of the seeds cost 30, 60 and 90, whose interval is
    # 60 ± 4.30 * 30 / sqrt(3) = 60 ± 74.5; no cost is below 0.
    table = script.tail_section({"Nests": nests})
    assert "Nests, limit 23" in table.splitlines()[0]
    assert rows(table) == {
        "PPO, without a limit": ["80.0 [80.0, 80.0]"], "FOCOPS": ["90.0 [0.00, 135]"],
    }  # fmt: skip


def test_what_is_missing_and_what_is_not_planned_is_told_apart(script: ModuleType):
    nests = study(flights("P3O-cnn-23", 1, 4.0, 30.0))
    arms = {key: name for key, name in nests.arms.items() if key[0] != "P3O-cnn"}
    others = {"empty": replace(nests, results=None, outcomes={}), "other": replace(nests, arms=arms, outcomes={})}
    assert rows(script.tail_section({"Nests": nests, **others})) == {"P3O-cnn": ["30.0", "missing", "not planned"]}


def test_the_fact_on_the_worst_tenth_counts_those_that_hold_the_middle_limit(script: ModuleType):
    nests = study([*flights("PPO", 3, 5.0, 4.0), *flights("FOCOPS-23", 3, 4.0, 46.0), *flights("P3O-23", 3, 4.0, 23.0)])
    assert script.tail_fact({"Nests": nests}) == (
        "**The worst tenth.** Where the middle limit is held in the mean (2 times), the worst tenth of flights costs"
        " 1.0 (P3O, Nests) to 2.0 times the limit (FOCOPS, Nests), with a median of 1.5."
    )
    above = study(flights("FOCOPS-23", 3, 4.0, 48.0))
    assert script.tail_fact({"Nests": above}) == "**The worst tenth.** Nobody holds a middle limit."


def test_without_runs_the_tables_say_so(script: ModuleType):
    nothing = {"Nests": sys.modules["task_outcomes"].study_of(SUITE, None)}
    assert [write(nothing) for write in (script.area_section, script.tail_section)] == [
        "Nothing has been run yet.\n"
    ] * 2
    assert script.tail_fact(nothing) == "**The worst tenth.** Nobody holds a middle limit."
