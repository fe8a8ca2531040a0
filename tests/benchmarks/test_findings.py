"""Tests of the tables of `docs/findings.md`, on logs and episodes whose statistics are known."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.bench.report.small_results import flights
from tests.bench.versioned import record_current_versions
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.builtin import SUITES
from thalweg.bench.suite.config import Suite


def log(costs: list[float], steps: list[int], last_step: int = 400) -> TrainingLog:
    tight = np.array(costs)
    return TrainingLog("PPO", 0, np.array(steps), np.zeros(len(costs)), tight, np.zeros(len(costs)), last_step)


def cells(text: str) -> list[list[str]]:
    header, _, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in text.splitlines())
    return [header, *rows]


def test_the_last_step_of_a_quarter_belongs_to_it(findings: ModuleType):
    found = findings.cost_by_quarter(log([1.0, 0.5, 0.0, 1.0, 0.2], [50, 100, 101, 300, 400]))
    assert found == [0.75, 0.0, 1.0, 0.2]
    assert np.isnan(findings.cost_by_quarter(log([1.0], [400]))[0])


def test_early_regret_is_the_share_of_the_first_quarter(findings: ModuleType):
    """Blocks of 50 episodes: 50 at a cost of 1 are 45 beyond the limit of 0.1, 50 at 0.4 are 15, 50 at 0 none."""
    costs = [1.0] * 50 + [0.4] * 50 + [0.0] * 50
    steps = [*range(1, 51), *range(101, 151), *range(201, 251)]
    both = log(costs, steps)
    assert findings.early_regret(both) == pytest.approx(45 / 60)
    assert findings.early_regret(replace(both, total=both.cost)) == pytest.approx(45 / 60)  # as logs have it today
    assert np.isnan(findings.early_regret(log([0.0], [10])))


def blocks(rows: list[tuple[int, float, int]], last_step: int = 400) -> TrainingLog:
    """A log of blocks: the step of the last episode, the mean cost, the number of episodes."""
    step, cost, episodes = (np.array(each) for each in zip(*rows, strict=True))
    none = np.zeros(len(rows))
    violations = np.stack([episodes] * 3, axis=1)
    return TrainingLog("PPO", 0, step, none, none, cost, last_step, cost, episodes, violations)


def test_a_block_of_a_curve_counts_as_often_as_it_has_episodes(findings: ModuleType):
    """Second quarter: 50 episodes at 0.8 and 10 at 0.2 are (40 + 2) / 60 = 0.7; blocks as episodes would give 0.5."""
    log = blocks([(90, 1.0, 50), (150, 0.8, 50), (200, 0.2, 10), (380, 0.1, 25)])
    found = findings.cost_by_quarter(log)
    assert found[:2] == [1.0, pytest.approx(0.7)] and np.isnan(found[2]) and found[3] == pytest.approx(0.1)


def test_early_regret_weighs_blocks_of_a_curve_by_their_episodes(findings: ModuleType):
    """50 episodes at 0.3 are 10 beyond the limit of 0.1, 10 at 1.1 are 10: one half, and a third on the other side."""
    assert findings.early_regret(blocks([(100, 0.3, 50), (101, 1.1, 10)])) == pytest.approx(0.5)
    assert findings.early_regret(blocks([(100, 1.1, 10), (300, 0.5, 50)])) == pytest.approx(10 / 30)
    assert findings.early_regret(blocks([(101, 1.0, 50)])) == 0.0
    assert np.isnan(findings.early_regret(blocks([(50, 0.1, 50)])))


def test_the_share_of_updates_with_the_multiplier_at_its_bound(findings: ModuleType, tmp_path: Path):
    (tmp_path / "metrics.csv").write_text("steps,multiplier\n1,2.0\n2,1.5\n3,2.0\n4,2.0\n")
    (tmp_path / "config.yaml").write_text("run:\n  config: {multiplier_max: 2.0}\n")
    assert findings.share_at_bound(tmp_path) == 0.75
    (tmp_path / "config.yaml").write_text("run:\n  config: {}\n")
    assert np.isnan(findings.share_at_bound(tmp_path))


def test_open_choices_have_a_row_for_each_evaluated_variant(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(findings, "OPEN", tiny_results)
    header, row = cells(findings.open_choices())
    assert header[:3] == ["policy", "seeds", "return"] and row[:2] == ["PPO", "1 of 2"]


def test_the_page_says_what_its_results_were_made_with(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("STUDY", "OPEN"):
        monkeypatch.setattr(findings, name, tiny_results)
    monkeypatch.setattr(findings, "WHAT", {tiny_results.name: "two algorithms"})
    told = " ".join(findings.results_of_the_page().split())
    assert "(../benchmarks/results): two algorithms, trained for 400 steps on Medium. Each policy is flown" in told
    assert "`results` is of today's versions. `encoders` is of **earlier versions**: world 1 (today" in told
    assert told.endswith("In training, critics saw the privileged state and progress too.")
    path = tiny_results / "versions.json"
    made = json.loads(path.read_text())
    older = {run: of | {"world": 1} for run, of in made.items()} | {"packaged-0": {"packaged": 1}}
    older = {run: {name: each for name, each in of.items() if name != "privileged"} for run, of in older.items()}
    path.write_text(json.dumps(older))
    findings.results_of.cache_clear()
    told = " ".join(findings.results_of_the_page().split())
    assert "`results` is of **earlier versions**: world 1 (today" in told
    assert "`packaged` is version 1 of [the policy that comes with Thalweg](packaged-policy.md), and today's is" in told
    assert told.endswith("In training, critics saw what the policy sees.")


def test_pairs_with_the_policy_without_a_limit_stand_on_either_side_and_name_what_critics_saw(
    findings: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    rows = [row for name in ("PPO", "PPO-symmetric", "FOCOPS") for row in flights(name, 3, 3.0, 0.4)]
    arms = (Arm("PPO"), SUITES["paper"].arm("PPO-symmetric"), Arm("FOCOPS"))
    made = Results(Path(), Suite("made", arms, test_levels=("Medium",)).as_data(), [], rows, [], [])
    monkeypatch.setattr(findings, "results_of", lambda _: made)
    header, *found = cells(findings.pairs_without_limit())
    assert header[-1] == "critics see"
    assert [row[:2] for row in found] == [["PPO", "PPO-symmetric"], ["PPO-symmetric", "FOCOPS"]]
    assert [row[-1] for row in found] == [
        "the privileged state and progress too / what the policy sees",
        "what the policy sees",
    ]


def test_each_variant_is_compared_with_the_default_of_its_algorithm(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    suite = json.loads((tiny_results / "suite.json").read_text())
    common = {"seeds": [0], "steps": 400}
    names = {"PPO": "PPO", "PPO-other": "PPO", "FOCOPS": "FOCOPS"}
    suite["arms"] = [{"name": name, "algorithm": algorithm, **common} for name, algorithm in names.items()]
    (tiny_results / "suite.json").write_text(json.dumps(suite))
    record_current_versions(tiny_results, {"PPO-other": "PPO"})
    flights = (tiny_results / "evaluation" / "PPO-0-Medium.csv").read_text()
    runs = (tiny_results / "runs.csv").read_text().splitlines()[:3]
    for name in ("PPO-other", "FOCOPS"):
        flown = flights.replace("PPO,", f"{name},").replace(",1.0,1.0,1.0,", ",4.0,0.0,0.0,")
        (tiny_results / "evaluation" / f"{name}-0-Medium.csv").write_text(flown)
        runs.append(runs[2].replace("PPO", name))
        shutil.copytree(tiny_results / "runs" / "PPO-0", tiny_results / "runs" / f"{name}-0")
    (tiny_results / "runs.csv").write_text("\n".join(runs) + "\n")
    monkeypatch.setattr(findings, "OPEN", tiny_results)
    _, *rows = cells(findings.pairs_of_open_choices())
    assert [row[:2] for row in rows] == [["PPO", "PPO-other"]]
    assert rows[0][2:] == [
        "1 and 1",
        "25%",
        "-1.50",
        "0.50",
    ]  # returns 1 and 2 against 4 and 2, costs 1 and 0.2 against 0 and 0.2


def test_a_condition_without_episodes_is_named(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(findings, "STUDY", tiny_results)
    header, *rows = cells(findings.conditions())
    assert header[1:] == ["seeds", "sampled", "deterministic", "unseen rivers", "every look"]
    assert [row[1::2] for row in rows if row[0] == "PPO"] == [["1 of 2", "not flown yet", "not flown yet"]]


def test_training_costs_of_two_seeds_without_a_multiplier_have_neither_interval_nor_bound(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(findings, "STUDY", tiny_results)
    for run in sorted((tiny_results / "runs").iterdir()):
        (run / "config.yaml").write_text("run:\n  config: {}\n")
    header, row = cells(findings.training_costs())
    assert header[:2] == ["policy", "seeds"] and row[:2] == ["PPO", "2"]
    assert header[-1] == "multiplier at its bound" and row[-1] == "none"
    assert "[" not in row[2]


def test_a_seed_without_episodes_in_a_quarter_is_left_out_of_the_mean(findings: ModuleType):
    assert str(findings.seed_mean([0.5, np.nan, 0.7])) == "0.60"
    assert np.isnan(findings.seed_mean([np.nan] * 3).value)
    assert str(findings.seed_mean([0.9, 1.0, 0.8])) == "0.90 [0.65, 1.00]"  # 0.9 ± 4.303 * 0.1 / √3


def test_a_file_that_cannot_be_used_is_an_error(
    findings: ModuleType, tiny_results: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(findings, "OPEN", tiny_results)
    (tiny_results / "evaluation" / "PPO-0-Medium.csv").write_text("half a head")
    with pytest.raises(ResultsError, match=r"PPO-0-Medium\.csv"):
        findings.open_choices()
