"""Tests of the tables of limits, pairs and conditions, on results whose statistics are known."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from tests.bench.report.small_results import flights
from thalweg.bench.report.comparison_tables import condition_table, limit_table, pairwise_table, return_change
from thalweg.bench.report.policies import limit_met
from thalweg.bench.report.table import Table
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import TrainingLog


def rows_of(table: Table) -> list[dict[str, str]]:
    """The rows of a table as people read it, by column."""
    return [dict(zip(table.text.columns, row, strict=True)) for row in table.text.itertuples(index=False)]


def test_the_limit_table_has_the_cost_of_evaluation_and_of_training(results: Results):
    by = {row["policy"]: row for row in rows_of(limit_table(results))}
    assert list(by) == ["PPO", "FOCOPS", "P3O"]
    assert by["PPO"]["cost"] == "0.50 [0.00, 1.00]" and by["PPO"]["limit met"] == "unsure"
    assert by["FOCOPS"]["cost"] == "0.00 [0.00, 0.39]" and by["FOCOPS"]["limit met"] == "unsure"
    assert by["PPO"]["violations"].startswith("50% [")
    assert (by["PPO"]["regret in training"], by["FOCOPS"]["regret in training"]) == ("0.40", "unknown")
    assert (by["PPO"]["minutes"], by["PPO"]["steps a second"]) == ("3.00", "8.00")
    assert by["P3O"]["cost"] == "failed"


def test_a_run_without_a_finished_episode_counts_for_no_regret(results: Results):
    empty = [TrainingLog(name, 1, *[np.zeros(0)] * 4, 1000) for name in ("PPO", "FOCOPS")]  # pyright: ignore
    rows = rows_of(limit_table(replace(results, training=[*results.training, *empty])))
    assert [row["regret in training"] for row in rows[:2]] == ["0.40", "unknown"]


def test_sixty_episodes_without_a_cost_meet_the_limit(results: Results):
    free = [replace(row, episode=20 * row.episode + more) for row in flights("PPO", 3, 4.0, 0.0) for more in range(10)]
    assert rows_of(limit_table(replace(results, episodes=free)))[0]["limit met"] == "yes"


def test_a_limit_is_surely_met_only_by_the_whole_interval():
    assert [limit_met(Estimate(0.05, *ends)) for ends in ((0.0, 0.1), (0.0, 0.11))] == ["yes", "unsure"]
    assert [limit_met(Estimate(0.2, *ends)) for ends in ((0.1, 0.3), (0.11, 0.3))] == ["unsure", "no"]
    assert [limit_met(Estimate(value)) for value in (0.1, 0.2)] == ["below, unsure", "above, unsure"]


def test_policies_are_compared_from_the_same_starts(results: Results):
    """FOCOPS, 1.5 ahead in the mean, is below PPO in one of the nine pairs of seeds."""
    text = pairwise_table(results).text
    rows = text.to_numpy().tolist()
    assert list(text.columns[:3]) == ["policy", "against", "seeds"]
    assert [row[:3] for row in rows] == [["PPO", "FOCOPS", "3 and 3"]]
    assert rows[0][3].startswith("11% [") and rows[0][4].startswith("-1.50 [-3.77, 0.77]")
    # Costs of 0 and 1 thrice each, 0.5 ± 2.571 √(0.3 / 6), against six of 0, Wilson's 0 to 0.39.
    assert rows[0][5] == "0.50 [-0.19, 1.00]"
    other = replace(results, episodes=[row for row in results.episodes if (row.algorithm, row.episode) != ("PPO", 1)])
    assert pairwise_table(other).text.to_numpy().tolist() == [["PPO", "FOCOPS", *["not the same starts"] * 4]]


def test_costs_of_a_task_with_a_price_have_no_greatest_value(results: Results):
    """Each seed costs the same from both starts, 0.2, 0.9 and 0.95: 0.6833 ± 4.303 · 0.2421."""
    dear = [replace(row, cost=(0.2, 0.9, 0.95)[row.seed]) for row in flights("PPO", 3, 4.0, 0.0)]
    priced = replace(results, suite=results.suite | {"task": "Swimmers"}, condition_episodes={"mode": dear})
    assert rows_of(condition_table(priced))[0]["cost"] == "0.68 [0.00, 1.72]"
    free = [replace(row, algorithm="FOCOPS", cost=0.0) for row in dear]
    both = replace(priced, episodes=[*dear, *free])
    assert rows_of(pairwise_table(both))[0]["cost, difference"] == "0.68 [-0.36, 1.72]"
    paper = replace(results, condition_episodes={"mode": dear}, episodes=[*dear, *free])
    assert rows_of(condition_table(paper))[0]["cost"] == "0.68 [0.00, 1.00]"
    assert rows_of(pairwise_table(paper))[0]["cost, difference"] == "0.68 [-0.36, 1.00]"


def test_conditions_show_the_change_of_return_from_the_same_starts(results: Results):
    text = condition_table(results).text
    assert text.iloc[:, :4].to_numpy().tolist() == [["PPO", "mode", "Medium", "3"], ["FOCOPS", "real", "Cam", "3"]]
    mode, real = rows_of(condition_table(results))
    assert (mode["return, change"], real["return, change"]) == ("0.50 [-1.60, 2.60]", "other starts")
    assert mode["return"] == "6.50 [4.02, 8.98]"  # t of 2 degrees of freedom: 4.303 / √3
    assert mode["success"].startswith("100% [")


def test_a_policy_with_episodes_under_a_condition_only_has_a_row(results: Results):
    stray = replace(results, condition_episodes={"mode": flights("Stray", 1, 4.5, 0.0)})
    assert stray.policies[-1] == "Stray"
    assert condition_table(stray).text.iloc[:, :4].to_numpy().tolist() == [["Stray", "mode", "Medium", "1"]]


def test_a_change_is_over_the_seeds_that_flew_under_both_conditions(results: Results):
    before = [row for row in results.episodes if row.algorithm == "PPO"]
    after = [replace(row, return_=row.return_ + 0.5 + (row.seed == 2)) for row in before]
    for seeds, change in (({0, 1, 2}, 2.5 / 3), ({0, 1}, 0.5), ({2}, 1.5)):
        for flown in ((after, [row for row in before if row.seed in seeds]), (
            [row for row in after if row.seed in seeds], before
        )):  # fmt: skip
            found = return_change(*flown)
            assert isinstance(found, Estimate) and found.value == pytest.approx(change)
            assert np.isnan(found.low) == (len(seeds) < 3)
    assert return_change([replace(row, seed=7) for row in after], before) == "other seeds"
    assert return_change(after, []) == return_change([], []) == "other starts"


def test_missing_seeds_are_shown(results: Results):
    free = [row for row in results.episodes if (row.algorithm, row.seed) != ("PPO", 2)]
    by_condition = {"mode": [row for row in results.condition_episodes["mode"] if row.seed != 1]}
    fewer = replace(results, episodes=free, condition_episodes=by_condition)
    assert limit_table(fewer).text.iloc[0, :2].tolist() == ["PPO", "2 of 3"]
    assert rows_of(pairwise_table(fewer))[0]["seeds"] == "2 of 3 and 3"
    assert rows_of(condition_table(fewer))[0]["seeds"] == "2 of 3"


def test_an_estimate_has_three_columns_in_the_csv(results: Results):
    header, first, second, third = csv.reader(limit_table(results).csv.splitlines())
    assert header == [
        "policy", "seeds", "cost", "cost, low", "cost, high", "limit met", "violations", "violations, low",
        "violations, high", "regret in training", "minutes", "steps a second",
    ]  # fmt: skip
    assert first[:6] == ["PPO", "3", "0.5", "0.0", "1.0", "unsure"] and float(first[-1]) == 8.0
    assert second[2:4] == ["0.0", "0.0"] and 0.39 < float(second[4]) < 0.4 and second[5] == "unsure"
    assert third[2:6] == ["failed", "", "", "failed"]
