"""Tests of tables and figures of tasks where a limit has a price, on results whose statistics are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.bench.report.small_results import flights
from thalweg.bench.fronts import fronts
from thalweg.bench.fronts.fronts import FrontPoint
from thalweg.bench.report import price_figures, price_tables
from thalweg.bench.report.comparison_tables import limit_table
from thalweg.bench.report.price_figures import front_figure, training_costs
from thalweg.bench.report.price_tables import area_table, limit_of, price_table
from thalweg.bench.report.table import Table
from thalweg.bench.results.results import OutdatedPolicy, Results, RunRow
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.core import versions

SAFE = FrontPoint("Nests", "Medium", "fixed", 10.0, 50, 6.0, 5.9, 6.1, 0.0, 0.0, 0.0, 1)
FREE = replace(SAFE, price=0.0, return_=10.0, return_low=9.9, return_high=10.0, cost=40.0)
SUITE = Suite(
    "it",
    (
        Arm("PPO"),
        Arm("FOCOPS", settings={"cost_limit": 5.0}, name="FOCOPS-5"),
        Arm("FOCOPS", settings={"cost_limit": 20.0}, name="FOCOPS-20"),
    ),
    test_levels=("Medium",),
    baselines=(),
    packaged=False,
    task="Nests",
)


@pytest.fixture
def priced(monkeypatch: pytest.MonkeyPatch) -> Results:
    """Policies of three seeds and two starts: PPO costs 0 and 30, FOCOPS 0 and 4, and 0 and 20."""
    for module in (price_tables, price_figures):
        monkeypatch.setattr(module, "oracle_points", lambda _: [SAFE, FREE])
    episodes = [
        *flights("PPO", 3, 6.0, 30.0),
        *flights("FOCOPS-5", 3, 4.0, 4.0),
        *flights("FOCOPS-20", 3, 5.0, 20.0),
    ]
    runs = [
        RunRow(f"{name}-{seed}", "train", name, seed, 1000, "finished")
        for name in ("PPO", "FOCOPS-5", "FOCOPS-20")
        for seed in range(3)
    ]
    zeros = np.zeros(3)
    logs = [TrainingLog("FOCOPS-5", 0, np.array([1, 2, 3]), zeros, zeros, zeros, 200_000, np.array([9.0, 6.0, 3.0]))]
    return Results(Path(), SUITE.as_data(), runs, episodes, logs, [])


def rows_of(table: Table) -> dict[str, dict[str, str]]:
    """The rows of a table as people read it, by the first cell."""
    rows = [dict(zip(table.text.columns, row, strict=True)) for row in table.text.itertuples(index=False)]
    return {row[table.text.columns[0]]: row for row in rows}


def test_the_limit_is_that_which_a_policy_was_trained_with(priced: Results):
    assert [limit_of(priced, name) for name in ("PPO", "FOCOPS-5", "FOCOPS-20")] == [None, 5.0, 20.0]


def test_each_policy_stands_beside_its_own_limit_and_the_oracle(priced: Results):
    rows = rows_of(price_table(priced))
    assert list(rows) == ["PPO", "FOCOPS-5", "FOCOPS-20"]
    # Returns 4 + seed + (0 or 2), so 6 in the mean, at a mean cost of 2, where 6.2 is attainable.
    tight = rows["FOCOPS-5"]
    assert tight["limit"] == "5.00" and tight["cost"].startswith("2.00 [") and tight["flights above"] == "0% [0, 39]"
    assert tight["worst tenth costs"].startswith("4.00") and tight["below the oracle"].startswith("0.20 [")
    assert tight["limit met"] == "yes"
    # Costs of 0 and 20, three times each: their mean is 10 ± 11.5 by Student's t, although seeds do not differ.
    assert rows["FOCOPS-20"]["flights above"] == "0% [0, 39]" and rows["FOCOPS-20"]["limit met"] == "unsure"
    assert rows["FOCOPS-20"]["cost"] == "10.00 [0.00, 21.50]"
    assert (rows["PPO"]["limit"], rows["PPO"]["limit met"]) == ("none", "no limit")


def test_shares_and_tails_have_intervals_that_are_possible(priced: Results):
    """Of two flights each, seeds 0 and 1 fly one above the limit of 5, at a cost of 8, and seed 2 none."""
    rows = flights("FOCOPS-5", 3, 4.0, 8.0)
    rows = [replace(row, cost=0.0) if row.seed == 2 else row for row in rows]
    row = rows_of(price_table(replace(priced, episodes=rows)))["FOCOPS-5"]
    # Shares 1/2, 1/2 and 0, and tails 8, 8 and 0: Student's t would go below 0, and above 1 and 8.
    assert row["flights above"] == "33% [0, 100]"
    assert row["worst tenth costs"] == "8.00 [0.00, 16.81]"


def test_a_cost_above_one_is_not_clipped(priced: Results):
    # Costs of 0 and 30, three times each: 15 ± 17.24.
    assert rows_of(price_table(priced))["PPO"]["cost"] == "15.00 [0.00, 32.24]"


def test_the_area_of_an_algorithm_is_that_below_its_policies_at_all_limits(priced: Results):
    # Seed 1 has (2, 6) and (10, 7): a trapezium of 8 and a rectangle to 40; the oracle covers 40 times 8.
    row = rows_of(area_table(priced))["FOCOPS"]
    wanted = (8 * 6.5 + 30 * 7) / 320
    assert (row["limits"], row["seeds"]) == ("2", "3") and row["share of the oracle's area"].startswith(
        f"{wanted:.2f} ["
    )


def test_arms_of_another_kind_are_no_limits_of_an_algorithm(priced: Results):
    begun = Arm("FOCOPS", settings={"cost_limit": 5.0, "policy": "cnn"}, observation="rgb", name="FOCOPS-cnn-5")
    alone = Arm("PPOLag", settings={"cost_limit": 5.0}, name="PPOLag-5")
    suite = replace(SUITE, arms=(*SUITE.arms, begun, alone))
    runs = [RunRow(f"{name}-0", "train", name, 0, 1000, "finished") for name in ("FOCOPS-cnn-5", "PPOLag-5")]
    others = [*flights("FOCOPS-cnn-5", 3, 9.0, 1.0), *flights("PPOLag-5", 3, 9.0, 1.0)]
    more = replace(priced, suite=suite.as_data(), runs=[*priced.runs, *runs], episodes=[*priced.episodes, *others])
    assert rows_of(area_table(more)) == rows_of(area_table(priced)) != {}


def test_the_limit_of_settings_that_no_longer_exist_is_the_recorded_one(priced: Results):
    record = SUITE.as_data()
    record["arms"][1]["settings"] |= {"once_known": 1}
    assert limit_of(replace(priced, suite=record), "FOCOPS-5") == 5.0


def test_only_a_front_of_the_same_task_is_compared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    today = replace(SAFE, tasks=versions.TASKS)
    monkeypatch.setattr(fronts, "read_fronts", lambda: [today, replace(FREE, tasks=versions.TASKS)])
    results = Results(tmp_path, SUITE.as_data(), [], [], [], [])
    assert len(price_tables.oracle_points(results)) == 2
    for other in ({"hard": True}, {"forces": {"current_m_per_s": [0.2, 0.8]}}):
        assert price_tables.oracle_points(replace(results, suite=SUITE.as_data() | other)) == []
    monkeypatch.setattr(fronts, "read_fronts", lambda: [today, replace(FREE, tasks=versions.TASKS - 1)])
    assert price_tables.oracle_points(results) == []


@pytest.mark.parametrize(
    ("task", "ahead", "low"),
    [("Portage", 0.5, "-0.48"), ("HighNests", 0.5, "-0.48"), ("Portage", None, "0.00"), ("Nests", 0.5, "0.00")],
)
def test_returns_have_no_least_value_of_0_where_they_may_be_negative(
    task: str, ahead: float | None, low: str, priced: Results
):
    """They may be in Portage on open courses, and in a plug-in's task; means by seed are 1, 2 and 3, so 2 - 2.48."""
    episodes = [replace(row, ahead=ahead) for row in flights("PPO", 3, 0.0, 30.0)]
    found = replace(priced, suite=priced.suite | {"task": task}, episodes=episodes)
    assert rows_of(price_table(found))["PPO"]["return"] == f"2.00 [{low}, 4.48]"


def test_the_figure_reaches_to_negative_returns(priced: Results):
    rows = [replace(row, return_=row.return_ - 9.0) for row in priced.episodes]
    figure = front_figure(replace(priced, suite=priced.suite | {"task": "Portage"}, episodes=rows))
    assert figure is not None
    drawn = min(np.min(line.get_ydata()) for line in figure.axes[0].lines if line.get_label() in ("PPO", "FOCOPS-5"))
    assert figure.axes[0].get_ylim()[0] < drawn < 0.0


@pytest.fixture
def half_outdated(priced: Results) -> Results:
    """The same, of which PPO was made with other tasks than today's."""
    old = OutdatedPolicy("PPO", "tasks 0")
    rows = [replace(row, algorithm=old.name) if row.algorithm == "PPO" else row for row in priced.episodes]
    return replace(priced, episodes=rows, outdated={old.name: old})


def test_outdated_runs_are_not_compared_with_the_front_of_today(half_outdated: Results):
    rows = rows_of(price_table(half_outdated))
    assert rows["PPO (tasks 0)"]["below the oracle"] == "unknown"
    assert rows["FOCOPS-5"]["below the oracle"].startswith("0.20 [")


def test_outdated_runs_are_not_drawn_below_the_front_of_today(half_outdated: Results):
    figure = front_figure(half_outdated)
    assert figure is not None
    labels = {line.get_label() for line in figure.axes[0].lines}
    assert labels & {"PPO (tasks 0)", "FOCOPS-5"} == {"FOCOPS-5"}


def test_where_all_runs_are_outdated_they_are_drawn_without_the_front(half_outdated: Results):
    rows = [row for row in half_outdated.episodes if row.algorithm in half_outdated.outdated]
    figure = front_figure(replace(half_outdated, episodes=rows))
    assert figure is not None
    labels = {line.get_label() for line in figure.axes[0].lines}
    assert labels & {"PPO (tasks 0)", "oracle, which knows the map"} == {"PPO (tasks 0)"}


def test_the_paper_has_no_table_of_prices_and_priced_tasks_none_of_its_limit(priced: Results, results: Results):
    assert price_table(results).text.empty and not limit_table(results).text.empty
    assert limit_table(priced).text.empty
    assert front_figure(results) is None and training_costs(results) is None


def test_the_figure_shows_each_policy_at_its_mean_cost_and_return(priced: Results):
    figure = front_figure(priced)
    assert figure is not None
    points = {line.get_label(): tuple(np.asarray(line.get_xydata())[0]) for line in figure.axes[0].lines}
    assert points["FOCOPS-20"] == pytest.approx((10.0, 7.0)) and points["PPO"] == pytest.approx((15.0, 8.0))
    assert "oracle, which knows the map" in points


def test_logs_of_arms_that_the_suite_no_longer_names_make_no_figure(priced: Results):
    (log,) = priced.training
    assert training_costs(replace(priced, training=[replace(log, algorithm="once")])) is None


def test_costs_of_training_are_those_of_all_kinds(priced: Results):
    figure = training_costs(priced)
    assert figure is not None and [axis.get_title() for axis in figure.axes] == ["FOCOPS"]
    curve, limit = figure.axes[0].lines
    assert np.asarray(curve.get_ydata())[-1] == pytest.approx(6.0) and np.asarray(limit.get_ydata())[0] == 5.0
