"""Tests of the ranking against an order worked out by hand."""

from dataclasses import replace

import pytest

from tests.bench.report.small_results import SUITE, flights
from thalweg.bench.report import ranking as module
from thalweg.bench.report.comparison_tables import pairwise_table
from thalweg.bench.report.html.page import page
from thalweg.bench.report.ranking import OTHER, ranking
from thalweg.bench.results.inference import mean_estimate
from thalweg.bench.results.results import OutdatedPolicy, Results
from thalweg.bench.suite.arms import Arm


def test_policies_within_the_limit_come_first_and_then_the_greater_return(results: Results):
    """PPO returns 4 to 8 (mean 6) and costs 0.5 on average; FOCOPS returns 7.5 and costs nothing; P3O failed."""
    found = ranking(results)
    assert found.level == "Medium"
    assert [(row.place, row.policy, row.returns.value, row.cost.value) for row in found.trained] == [
        (1, "FOCOPS", 7.5, 0.0),
        (2, "PPO", 6.0, 0.5),
    ]
    better = replace(results, episodes=[*flights("PPO", 3, 7.0, 1.0), *flights("FOCOPS", 3, 0.0, 0.0)])
    assert [(row.policy, row.returns.value) for row in ranking(better).trained] == [("FOCOPS", 2.0), ("PPO", 9.0)]
    costly = replace(results, episodes=[*flights("PPO", 3, 7.0, 1.0), *flights("FOCOPS", 3, 0.0, 1.0)])
    assert [row.policy for row in ranking(costly).trained] == ["PPO", "FOCOPS"]


def test_what_was_not_trained_has_no_place_and_stands_below(results: Results):
    (hover,) = ranking(results).others
    assert (hover.policy, hover.place, hover.about, hover.limit) == ("hover", 0, "never moves", None)
    assert hover.cost.value == 0.2 and not hover.within
    named = replace(results, episodes=[*results.episodes, *flights("mine", 1, 9.0, 0.0)])
    assert [(row.policy, row.about) for row in ranking(named).others] == [("mine", OTHER), ("hover", "never moves")]


def test_policies_without_flights_on_the_level_are_named(results: Results):
    found = ranking(results)
    assert found.missing == ("P3O failed",)
    assert found.note.endswith(" Without flights on Medium: P3O failed.")
    assert "Without" not in ranking(replace(results, suite=replace(SUITE, arms=SUITE.arms[:2]).as_data(), runs=[])).note


def test_the_note_names_the_section_of_pairs_only_where_there_is_one(results: Results):
    old = OutdatedPolicy("PPO", "render 1")
    rows = [replace(row, algorithm=old.name) if row.algorithm == "PPO" else row for row in results.episodes]
    half = replace(results, episodes=rows, outdated={old.name: old})
    assert len(ranking(half).trained) == 2
    for each in (results, half):
        assert ("In pairs" in ranking(each).note) == (not pairwise_table(each).text.empty)


def test_the_limit_of_the_papers_task_is_a_tenth_and_the_interval_says_whether_it_is_met(results: Results):
    first, second = ranking(results).trained
    assert (first.limit, first.within, second.within) == (0.1, True, False)
    cost = mean_estimate([row for row in results.episodes if row.algorithm == "FOCOPS"], "cost")
    assert first.cost == cost and first.limit_met == ("yes" if cost.high <= 0.1 else "unsure")


def test_on_a_task_with_prices_each_policy_has_the_limit_of_its_training(results: Results):
    arms = (Arm("PPO"), Arm("FOCOPS", settings={"cost_limit": 2.0}), Arm("P3O", settings={"cost_limit": 0.3}))
    suite = replace(SUITE, arms=arms, task="Swimmers").as_data()
    rows = [*flights("PPO", 3, 7.0, 0.0), *flights("FOCOPS", 3, 3.0, 2.0), *flights("P3O", 3, 5.0, 1.0)]
    found = ranking(replace(results, suite=suite, episodes=rows))
    assert [(row.policy, row.limit, row.within, row.limit_met == "no limit") for row in found.trained] == [
        ("FOCOPS", 2.0, True, False),
        ("PPO", None, False, True),
        ("P3O", 0.3, False, False),
    ]
    assert found.limit is None and "are within" not in found.headline


def test_the_bar_ends_at_the_share_of_the_greatest_return_and_has_an_interval_of_three_seeds_only(results: Results):
    first, _ = ranking(results).trained
    assert first.bar["end"] == 75.0
    assert first.bar["low"] == round(10 * first.returns.low, 1) < 75.0 < first.bar["high"] <= 100.0
    alone = ranking(replace(results, episodes=flights("FOCOPS", 1, 3.0, 0.0))).trained[0]
    assert alone.bar == {"end": 40.0, "low": 40.0, "high": 40.0}


def test_the_headline_says_what_the_first_row_shows(results: Results):
    assert ranking(results).headline == (
        "FOCOPS ranks first of 2 trained policies on Medium: it returns 7.50 of 10 and costs 0.00 a flight on average"
        " (limit 0.1), and 100% of its flights complete the course. 1 of the 2 is within the limit."
    )
    alone = ranking(replace(results, episodes=flights("FOCOPS", 1, 3.0, 0.0)))
    assert alone.headline == (
        "FOCOPS on Medium returns 4.00 of 10 and costs 0.00 a flight on average (limit 0.1), and 100% of its flights"
        " complete the course."
    )
    assert ranking(replace(results, episodes=flights("hover", 1, 0.0, 0.0))).headline == ""


@pytest.mark.parametrize("name", ["PPO", "hover"])
def test_versions_that_are_not_current_stand_below_the_name(results: Results, name: str):
    old = f"{name} (render 1)"
    renamed = [replace(row, algorithm=old) if row.algorithm == name else row for row in results.episodes]
    found = ranking(replace(results, episodes=renamed, outdated={old: OutdatedPolicy(name, "render 1")}))
    (row,) = (row for row in (*found.trained, *found.others) if row.policy == old)
    assert (row.name, row.words) == (name, "render 1" if name == "PPO" else "never moves, render 1")
    assert (row.place > 0) == (name == "PPO")


@pytest.mark.parametrize(
    ("limit", "told"), [(0.1, "limit of 0.1 met"), (25.0, "limit of 25 met"), (0.0, "limit of 0 met")]
)
def test_the_page_names_the_limit_that_all_policies_have(
    limit: float, told: str, results: Results, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "COST_LIMIT", limit)
    assert f"<th scope='col' class='met'>{told}</th>" in page(results, [], {}, {}, [])
