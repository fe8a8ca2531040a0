"""Tests of the tables of ways of training and of codes of geometry, on flights whose means are known."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from tests.bench.report.small_results import flights
from tests.benchmarks.test_findings import cells
from thalweg.bench.results.results import Results
from thalweg.bench.suite.builtin import SUITES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def further(findings: ModuleType, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.delitem(sys.modules, "further_findings", raising=False)
    return importlib.import_module("further_findings")


def results_of(suite: str, **given: list) -> Results:
    return Results(
        Path(), replace(SUITES[suite]).as_data(), [], given.pop("episodes"), [], [], condition_episodes=given
    )


def test_each_way_of_training_has_a_return_and_a_cost_on_each_level(
    further: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    """Three seeds return 2, 3 and 4 (5, 6 and 7 on Hard) in the mean of two starts, of which the second may cost."""
    flown = [
        *(row for level in ("Easy", "Medium", "Hard") for row in flights("FOCOPS", 3, 1.0, 0.0, level)),
        *flights("FOCOPS-Hard", 3, 4.0, 1.0, "Hard"),
        *flights("FOCOPS-Hard", 3, 0.5, 0.0, "Medium"),
    ]
    monkeypatch.setattr(further, "results_of", lambda folder: results_of(folder.name, episodes=flown))
    table, pairs = further.ways_of_training().split("\n\n")
    header, *rows = cells(table)
    assert header == [
        "policy",
        "seeds",
        *(f"{what}, {of}" for of in ("Easy", "Medium", "Hard") for what in ("return", "cost")),
    ]
    found = {row[0]: row[1:] for row in rows}
    assert list(found) == ["FOCOPS-Hard", "FOCOPS"]
    assert found["FOCOPS-Hard"][:3] == ["3", "missing", "missing"]
    assert found["FOCOPS-Hard"][5].startswith("6.00 [") and found["FOCOPS-Hard"][6].startswith("0.50")
    assert [cell.partition(" ")[0] for cell in found["FOCOPS"][1:]] == ["3.00", "0.00"] * 3
    header, (name, *differences) = cells(pairs)
    assert header == ["policy, against FOCOPS", *(f"return on {of}, difference" for of in ("Easy", "Medium", "Hard"))]
    assert (name, differences[0]) == ("FOCOPS-Hard", "missing")
    assert [cell.partition(" ")[0] for cell in differences[1:]] == ["-0.50", "3.00"]


def test_codes_of_geometry_stand_beside_those_of_the_autoencoder(further: ModuleType, monkeypatch: pytest.MonkeyPatch):
    flown = [row for level in ("Easy", "Medium", "Hard") for row in flights("PPO", 3, 5.0, 0.0, level)]
    given = {
        "geometry": results_of("geometry", episodes=flown, unseen=flights("PPO", 3, 3.0, 0.0)),
        "paper": results_of("paper", episodes=flights("PPO", 3, 1.0, 0.0)),
    }
    monkeypatch.setattr(further, "results_of", lambda folder: given[folder.name])
    header, row = cells(further.codes_of_geometry())
    assert header == [
        "policy, its return", "seeds", "Easy", "Medium", "Hard", "unseen rivers", "every look",
        "cost on Medium, limit met", "autoencoder, Medium",
    ]  # fmt: skip
    assert [cell.partition(" ")[0] for cell in row] == [
        "PPO", "3", "7.00", "7.00", "7.00", "5.00", "missing", "0.00", "3.00",
    ]  # fmt: skip
    monkeypatch.setattr(further, "of_same_versions", lambda *_: False)
    assert cells(further.codes_of_geometry())[1][-1] == "other versions"


def test_the_page_says_what_protocols_trains():
    page = (ROOT / "docs" / "findings.md").read_text()
    labels = [arm.label for arm in SUITES["protocols"].arms]
    assert labels == ["FOCOPS-Hard", "FOCOPS-curriculum", "FOCOPS-after-PPO", "FOCOPS"]
    assert "The suite `protocols` trains FOCOPS in four ways" in page
    assert all(f"`{label}`" in page for label in labels if label != "FOCOPS")


def test_geometry_trains_the_algorithms_of_the_study_as_the_page_says():
    page = (ROOT / "docs" / "findings.md").read_text()
    assert "The suite `geometry` trains the algorithms of the study on" in page
    ours, theirs = ({arm.algorithm for arm in SUITES[name].arms} for name in ("geometry", "paper"))
    assert ours == theirs
