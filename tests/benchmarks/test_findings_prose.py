"""Tests that the committed results support what `docs/findings.md` calls certain.

Where new results make one of these fail, the prose of the page needs revision.
"""

import importlib
from itertools import combinations, product
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.stats import ttest_ind

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.comparison_tables import return_change
from thalweg.bench.report.policies import limit_met, trained_policies
from thalweg.bench.results.comparison import matched_scores, mean_difference, probability_of_improvement
from thalweg.bench.results.inference import Estimate, mean_estimate, score_matrix
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import training_in_words
from thalweg.core import versions
from thalweg.train.observations import SEEN_BY_CRITICS

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
FLYING = ("PPO", "PPOLag", "FOCOPS", "P3O")
"""With every seed."""


@pytest.fixture(scope="module")
def study() -> Results:
    return read_results(BENCHMARKS / "paper", as_recorded=True)


@pytest.fixture(scope="module")
def ways() -> Results:
    return read_results(BENCHMARKS / "open", as_recorded=True)


def flown(results: Results, policy: str, condition: str = "", level: str = "Medium") -> list[Episode]:
    episodes = results.condition_episodes[condition] if condition else results.episodes
    return group_episodes(episodes)[policy, level]


def difference(results: Results, ours: str, theirs: str, field: str, level: str = "Medium") -> Estimate:
    one, other = (flown(results, name, level=level) for name in (ours, theirs))
    return mean_difference(*matched_scores(one, other, field), field)


def is_certain(found: Estimate) -> bool:
    return not np.isnan(found.low) and found.low * found.high > 0


def test_the_page_speaks_of_results_of_earlier_versions(study: Results, ways: Results):
    """The paragraph on settings that have changed since then, and what docs/bench.md says of these folders."""
    easy = read_results(BENCHMARKS / "easy", as_recorded=True)
    for results in (study, ways, easy):
        made = {name for of in results.versions.values() for name in ALGORITHMS if name in of}
        newest = max(of[name] or 0 for of in results.versions.values() for name in made & of.keys())
        assert newest == (0 if results is easy else 1)
        assert all(versions.ALGORITHMS[name] > 1 for name in made)
    assert not any((BENCHMARKS / name).exists() for name in ("geometry", "protocols"))


def test_critics_of_all_policies_that_are_compared_saw_the_same(study: Results, ways: Results):
    """Where PPO's critics saw more, the page must compare with PPO-symmetric in its place."""
    for results in (study, ways):
        assert {results.critics_see(name) for name in trained_policies(results)} == {SEEN_BY_CRITICS[False]}


def test_the_open_choices_were_trained_for_50_000_steps_and_the_study_for_four_times_as_many(
    study: Results, ways: Results
):
    assert training_in_words(ways.suite) == "50,000 steps on Medium"
    assert training_in_words(study.suite) == "200,000 steps on Medium"


def test_which_policies_meet_the_limit(study: Results):
    found = {name: limit_met(mean_estimate(flown(study, name), "cost")) for name in (*FLYING, "OnCRPO", "SACLag")}
    assert found == {
        "PPO": "unsure", "PPOLag": "no", "FOCOPS": "unsure", "P3O": "unsure", "OnCRPO": "no", "SACLag": "unsure",
    }  # fmt: skip


def test_which_policies_differ_significantly_from_ppo(study: Results):
    others = ("PPOLag", "FOCOPS", "P3O", "OnCRPO", "SACLag")
    assert not [name for name in others if is_certain(difference(study, "PPO", name, "cost"))]
    assert [name for name in others if is_certain(difference(study, "PPO", name, "return_"))] == ["OnCRPO"]
    assert not [
        pair for pair in combinations(("PPO", "FOCOPS", "P3O"), 2) if is_certain(difference(study, *pair, "return_"))
    ]
    assert probability_of_improvement(*matched_scores(flown(study, "PPO"), flown(study, "PPOLag"), "return_")).low > 0.5
    for name in ("FOCOPS", "P3O"):
        assert (
            difference(study, name, "PPOLag", "return_").low > 0 and difference(study, name, "PPOLag", "cost").high < 0
        )
    for field in ("return_", "cost"):
        assert difference(study, "PPO", "OnCRPO", field, "Hard").low > 0
    for level in ("Easy", "Medium", "Hard"):
        assert difference(study, "FOCOPS-paper", "PPO-paper", "return_", level).low > 0


def test_one_seed_of_saclag_learns_to_fly(study: Results, findings: ModuleType):
    """By the bar of the page, which is that of the findings at its top."""
    least = importlib.import_module("study_flights").FLIES
    returns = sorted(score_matrix(flown(study, "SACLag")).mean(axis=0), reverse=True)
    page = " ".join((BENCHMARKS.parent / "docs" / "findings.md").read_text(encoding="utf-8").split())
    first, *others = (f"{each:.2f}" for each in returns)
    assert [each >= least for each in returns] == [True, False, False]
    assert (
        f"one of SACLag's three seeds learns to fly and returns {first}; the others return {' and '.join(others)}"
        in page
    )


def test_what_is_lost_under_other_conditions(study: Results):
    at_home, away = (
        {name: mean_estimate(flown(study, name, where), "return_") for name in FLYING} for where in ("", "unseen")
    )
    assert [name for name in FLYING if away[name].high < at_home[name].low] == ["PPO", "PPOLag", "P3O"]
    for name in FLYING:
        under_looks = return_change(flown(study, name, "all_at_once"), flown(study, name))
        assert isinstance(under_looks, Estimate) and under_looks.high < 0
    for name in (*FLYING, "OnCRPO", "SACLag", "PPO-paper", "FOCOPS-paper"):
        most_probable = return_change(flown(study, name, "deterministic"), flown(study, name))
        assert isinstance(most_probable, Estimate) and not is_certain(most_probable)


def test_effects_of_adapters(ways: Results):
    assert difference(ways, "SACLag-box_scaled", "SACLag", "return_").low > 0
    assert difference(ways, "DDPGLag", "DDPGLag-box_scaled", "return_").low > 0
    assert difference(ways, "DDPGLag-box_literal", "DDPGLag", "cost").low > 0
    for name, share in (("DDPGLag", 0.4), ("SACLag", 0.7), ("CCEPETS", 0.7)):
        backwards = [row.reason == "YawOverDeviation" for row in flown(ways, f"{name}-box_literal")]
        assert share < np.mean(backwards) < share + 0.1


def test_effects_of_mask_and_multiplier_on_focops(ways: Results):
    surely = {
        field: [
            way
            for way in ("broken_mask", "ascent", "adam", "pid")
            if is_certain(difference(ways, f"FOCOPS-{way}", "FOCOPS", field))
        ]
        for field in ("return_", "cost")
    }
    assert surely == {"return_": ["adam"], "cost": ["broken_mask", "adam"]}
    for field, level in product(("return_", "cost"), ("Easy", "Hard")):
        assert not is_certain(difference(ways, "FOCOPS-adam", "FOCOPS", field, level))
    usual, pid = (flown(ways, name) for name in ("FOCOPS", "FOCOPS-pid"))
    assert [row.return_ for row in usual] == [row.return_ for row in pid]


def test_what_was_an_effect_of_settings():
    seen = [row for row in read_csv(BENCHMARKS / "through_frames.csv", ("arm", "return")) if row["first_river"] == "1"]
    flown = {name: [float(row["return"]) for row in seen if row["arm"] == name] for name in ("OnCRPO", "TD3Lag")}
    assert {name: [round(each, 1) for each in found] for name, found in flown.items()} == {
        "OnCRPO": [6.0], "TD3Lag": [8.8],
    }  # fmt: skip
    mean = {name: np.mean([float(row["return"]) for row in seen if row["arm"] == name]) for name in ("PPO", "PPOLag")}
    assert mean["PPOLag"] >= mean["PPO"]
    (timed,) = [row for row in read_csv(BENCHMARKS / "pace.csv", ("algorithm",)) if row["algorithm"] == "DDPGLag"]
    assert round(float(timed["return_mean_50"]), 1) == 8.7


def test_training_costs_in_each_quarter(study: Results, findings: ModuleType):
    paid = {
        name: np.array([findings.cost_by_quarter(log) for log in study.training if log.algorithm == name])
        for name in ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "SACLag")
    }
    expected = (dict.fromkeys(("PPOLag", "FOCOPS", "P3O", "OnCRPO", "SACLag"), -1), {}, {"PPOLag": 1}, {"P3O": -1})
    for quarter, signs in enumerate(expected):
        without = paid["PPO"][:, quarter]
        welch = {
            name: ttest_ind(costs[:, quarter], without, equal_var=False).confidence_interval(0.95)
            for name, costs in paid.items()
            if name != "PPO"
        }
        assert {name: np.sign(ends.low) for name, ends in welch.items() if ends.low * ends.high > 0} == signs
