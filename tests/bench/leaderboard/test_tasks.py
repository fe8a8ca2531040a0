"""The tables of tasks on the leaderboard: limits, ranks and the distance to the oracle, on results made by hand."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.versioned import record_current_versions
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import Episode, write_episodes
from thalweg.bench.fronts import fronts
from thalweg.bench.leaderboard import UNSEEN, leaderboard, task_entries
from thalweg.bench.leaderboard.entries import read_folder
from thalweg.bench.leaderboard.task_tables import task_table
from thalweg.bench.leaderboard.tasks import TaskEntry, fronts_of
from thalweg.bench.results.results import RunRow, evaluation_path, write_runs
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.core import versions
from thalweg.env.forces.options import ForceOptions

ARMS = (
    Arm("PPO", steps=1000),
    Arm("PPOLag", settings={"cost_limit": 6.0, "cost_limit_schedule": []}, steps=1000, name="PPOLag-6"),
    Arm("P3O", settings={"cost_limit": 6.0, "cost_limit_schedule": []}, steps=1000, name="P3O-6"),
    Arm("FOCOPS", settings={"cost_limit": 6.0, "cost_limit_schedule": []}, steps=1000, name="FOCOPS-6"),
    Arm("CPO", settings={"cost_limit": 2.0, "cost_limit_schedule": []}, steps=1000, name="CPO-2"),
)
SUITE = Suite(
    "nests",
    ARMS,
    test_levels=("Medium",),
    conditions=(UNSEEN,),
    baselines=(),
    packaged=False,
    observation="privileged",
    task="Nests",
)
FLOWN = {
    "PPO": (9.0, (20.0, 20.0, 20.0)),
    "PPOLag-6": (5.0, (5.0, 5.0, 5.0)),
    "P3O-6": (6.0, (4.0, 5.0, 8.0)),
    "FOCOPS-6": (7.0, (6.0, 7.0, 8.0)),
    "CPO-2": (3.0, (2.0, 2.0, 2.0)),
}
"""Return, and cost by seed."""
TRAINING = "step,episodes,return,cost,tight,loose,violations,tight_violations,loose_violations\n50,5,1,2,0,0,5,0,0\n"


@pytest.fixture(autouse=True)
def straight_front(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """An oracle that returns 4 at a cost of 1, and 10 at a cost of 13: half a point for each cost more."""
    ends = [(4.0, 1.0), (10.0, 13.0)]
    points = [
        fronts.FrontPoint(
            "Nests", "Medium", rivers, 1.0, 20, return_, return_, return_, cost, cost, cost, versions.TASKS
        )
        for rivers in (fronts.FIXED, fronts.UNSEEN)
        for return_, cost in ends
    ]
    monkeypatch.setattr("thalweg.bench.fronts.fronts.read_fronts", lambda: points)


def write(folder: Path, suite: Suite = SUITE) -> Path:
    """Write results of a suite whose policies return and cost what `FLOWN` says."""
    folder.mkdir()
    (folder / "suite.json").write_text(json.dumps(suite.as_data()))
    rows = []
    for run in suite.runs():
        rows.append(RunRow(run.name, run.kind, run.algorithm, run.seed, 1000, "finished"))
        (folder / "runs" / run.name).mkdir(parents=True)
        (folder / "runs" / run.name / "config.yaml").write_text("")
        (folder / "runs" / run.name / "curve.csv").write_text(TRAINING)
        return_, costs = FLOWN[run.algorithm]
        for trial in suite.trials(run):
            seed, path = 1 + trial.condition.unseen, evaluation_path(folder, run.name, trial)
            path.parent.mkdir(parents=True, exist_ok=True)
            at = (run.algorithm, run.seed, trial.level)
            cost = costs[run.seed % 3]
            end = (0.0, 0.0, 5.0, 0.0, return_, cost, 0.0, 0.0, 99, "Success", True, 0.5)
            write_episodes(path, [Episode(*at, seed, number, *end) for number in range(20)])
    write_runs(folder, rows)
    arms = {arm.label: arm.algorithm for arm in suite.arms}
    record_current_versions(folder, arms, observation="privileged", task=suite.task, forces=suite.forces.push)
    return folder


def entry(folder: Path, policy: str) -> TaskEntry:
    (found,) = [each for each in task_entries(read_folder(folder)) if each.policy == policy]
    return found


def rows_of(table: str) -> list[dict[str, str]]:
    header, _, *rows = ([cell.strip() for cell in line[1:-2].split("|")] for line in table.splitlines())
    return [dict(zip(header, row, strict=True)) for row in rows]


def test_a_policy_is_beside_its_own_limit_and_the_oracle_at_its_cost(tmp_path: Path):
    found = entry(write(tmp_path / "nests"), "PPOLag-6")
    assert (found.limit, found.limit_met, found.seeds, found.steps, found.missing) == (6.0, "yes", 3, 1000, ())
    assert str(found.costs[fronts.FIXED]) == "5.00 [5.00, 5.00]"
    assert found.regrets[fronts.FIXED].value == pytest.approx(1.0)  # the oracle returns 4 + (5 - 1) / 2 at a cost of 5
    assert entry(tmp_path / "nests", "PPO").limit_met == "no limit"


def test_ranks_are_within_a_limit_and_begin_with_those_that_surely_hold_it(tmp_path: Path):
    found = task_entries(read_folder(write(tmp_path / "nests")))
    rows = rows_of(task_table(found, fronts_of("Nests")))
    assert [(row[""], row["limit"], row["policy"], row["limit met"]) for row in rows] == [
        ("", "2", "oracle", ""),
        ("1", "2", "CPO-2", "yes"),
        ("", "6", "oracle", ""),
        ("1", "6", "PPOLag-6", "yes"),
        ("2", "6", "P3O-6", "unsure"),  # a mean of 5.67 is within the limit
        ("3", "6", "FOCOPS-6", "unsure"),  # one of 7 is not, though it returns more
        ("1", "none", "PPO", "no limit"),
    ]
    assert (rows[2]["return"], rows[3]["below the oracle"]) == ("6.50", "1.00 [1.00, 1.00]")
    assert "lacks" not in rows[0]


def test_a_row_that_lacks_something_has_no_rank_and_says_what(tmp_path: Path):
    folder = write(tmp_path / "nests")
    evaluation_path(folder, "PPOLag-6-1", Trial("Medium", UNSEEN)).unlink()
    (folder / "runs" / "P3O-6-2" / "curve.csv").unlink()
    assert entry(folder, "PPOLag-6").missing == ("flights on Medium (unseen)",)
    assert entry(folder, "P3O-6").missing == ("episodes.csv or curve.csv of seed 2",)
    rows = rows_of(task_table(task_entries(read_folder(folder)), fronts_of("Nests")))
    assert [(row[""], row["policy"]) for row in rows if row["limit"] == "6"] == [
        ("", "oracle"), ("1", "FOCOPS-6"), ("", "PPOLag-6"), ("", "P3O-6"),
    ]  # fmt: skip
    assert rows[-2]["lacks"] == "episodes.csv or curve.csv of seed 2"


@pytest.mark.parametrize(
    ("suite", "words"),
    [
        (replace(SUITE, forces=ForceOptions(current_m_per_s=(0.5, 0.5))), ("still air",)),
        (replace(SUITE, hard=True), ("episodes that go on after a cost",)),
        (replace(SUITE, arms=(replace(ARMS[0], seeds=(0, 1)),)), ("3 seeds",)),
    ],
)
def test_other_rules_and_too_few_seeds_are_lacking(tmp_path: Path, suite: Suite, words: tuple[str, ...]):
    assert entry(write(tmp_path / "nests", suite), "PPO").missing == words


def test_a_task_of_a_plug_in_has_no_rank(tmp_path: Path):
    folder = write(tmp_path / "nests")
    suite = json.loads((folder / "suite.json").read_text())
    (folder / "suite.json").write_text(json.dumps(suite | {"task": "HighNests"}))
    arms = {arm.label: arm.algorithm for arm in ARMS}
    record_current_versions(folder, arms, observation="privileged", task="HighNests")
    assert {each.missing for each in task_entries(read_folder(folder))} == {("a task of the package",)}


def test_a_limit_below_the_safest_point_is_unattainable(tmp_path: Path):
    arm = replace(ARMS[4], settings={"cost_limit": 0.5, "cost_limit_schedule": []})
    found = task_entries(read_folder(write(tmp_path / "nests", replace(SUITE, arms=(arm,)))))
    first, second = rows_of(task_table(found, fronts_of("Nests")))
    assert (first["return"], second["limit met"]) == ("unattainable", "no")


def test_a_front_of_other_tasks_is_not_compared_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(versions, "TASKS", versions.TASKS + 1)
    found = entry(write(tmp_path / "nests"), "PPO")
    assert (fronts_of("Nests"), found.regrets, found.missing) == ({}, {}, ())
    (row,) = rows_of(task_table([found], {}))
    # 60 flights return 9 of 10 each, of which Wilson's interval is 0.799 to 0.953.
    assert (row["return"], row["below the oracle"]) == ("9.00 [7.99, 9.53]", "unknown")


@pytest.mark.parametrize("rules", [{"hard": True}, {"forces": ForceOptions(current_m_per_s=(0.5, 0.5))}])
def test_rules_that_the_oracle_does_not_know_are_not_compared_with_its_front(tmp_path: Path, rules: dict):
    assert entry(write(tmp_path / "nests", replace(SUITE, **rules)), "PPO").regrets == {}


def test_the_page_has_tasks_beside_the_papers_task(tmp_path: Path):
    page = leaderboard([write(tmp_path / "nests")])
    assert (
        "### Nests, with the privileged observation" in page
        and "No policy that sees frames has a complete row yet." not in page
    )
    seeing = replace(SUITE, name="seen", observation="frames")
    folder = write(tmp_path / "seen", seeing)
    record_current_versions(folder, {arm.label: arm.algorithm for arm in seeing.arms}, task="Nests")
    both = leaderboard([tmp_path / "nests", folder])
    assert both.index("### Nests, through frames") < both.index("### Nests, with the privileged observation")
    assert "## Not ranked" not in both
