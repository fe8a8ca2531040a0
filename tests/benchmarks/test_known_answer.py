"""Tests of the benchmark on problems with a known answer: which rows are kept, and what its page highlights."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from tests.known_answer.harness import Case, Result, reference
from tests.known_answer.scores import Score
from thalweg.algos.common.errors import AlgorithmError
from thalweg.core.config import frozen_config

ROOT = Path(__file__).resolve().parents[2]
CELL = Case("CPO", "box", "end")


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch):
    """`benchmarks/known_answer.py`, which is in no package."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    yield importlib.import_module("known_answer")
    sys.modules.pop("known_answer", None)


def rows(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *shares: float) -> dict:
    """Rows of runs, one per seed, with these shares of the optimum's return."""
    best, found = reference(CELL), {}
    for seed, share in enumerate(shares):
        result = Result(CELL, Score.of(replace(best, reward=share * best.reward)), best)
        monkeypatch.setattr(script, "trained", lambda *_, result=result: result)
        found[script.key(CELL, seed)] = script.measure(CELL, seed, Path("unused"))
    return found


def test_written_rows_are_read_back_by_their_keys(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95, 0.85)
    script.write(tmp_path / "table.csv", written)
    assert script.finished(tmp_path / "table.csv") == written
    assert script.finished(tmp_path / "none.csv") == {}


def test_a_row_names_the_versions_of_its_algorithm_and_of_training(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setitem(script.versions.ALGORITHMS, "CPO", 7)
    monkeypatch.setattr(script.versions, "TRAINING", 4)
    written = rows(script, monkeypatch, 0.95) | {script.key(CELL, 1): script.failure(CELL, 1, ValueError("broken"))}
    script.write(tmp_path / "table.csv", written)
    found = script.finished(tmp_path / "table.csv").values()
    assert [(row["algorithm_version"], row["training_version"]) for row in found] == [("7", "4")] * 2


def test_rows_of_an_older_version_stay(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95)
    script.write(tmp_path / "table.csv", written)
    monkeypatch.setitem(script.versions.ALGORITHMS, "CPO", 7)
    assert script.finished(tmp_path / "table.csv") == written


def test_keys_differ_by_seed_settings_and_problem(script: ModuleType):
    others = [script.key(CELL, 1), script.key(Case("CPO", "box_scaled", "end"), 0)]
    others += [script.key(Case("CPO", "box", "dense"), 0)]
    assert script.key(CELL, 0) not in others
    assert script.key(CELL, 0) == script.key(Case("CPO", "box", "end"), 0)


def test_rows_of_other_defaults_are_dropped(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95)
    script.write(tmp_path / "table.csv", written)
    entry = script.ALGORITHMS["CPO"]

    @frozen_config(AlgorithmError)
    class Changed(entry.config):
        damping: float = 0.2

    monkeypatch.setitem(script.ALGORITHMS, "CPO", replace(entry, config=Changed))
    assert script.finished(tmp_path / "table.csv") == {}


def test_a_run_that_failed_is_a_row_and_does_not_count_as_finished(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    written = rows(script, monkeypatch, 0.95, 0.95)
    written[script.key(CELL, 1)] = script.failure(CELL, 1, ValueError("seed 1 is broken"))
    script.write(tmp_path / "table.csv", written)
    found = script.finished(tmp_path / "table.csv")
    assert found[script.key(CELL, 1)]["error"] == "ValueError: seed 1 is broken"
    assert list(script.remaining([(CELL, 0), (CELL, 1), (CELL, 2)], found)) == [(CELL, 1), (CELL, 2)]
    assert "**95%, 0.100 (1/2)**" in script.page(found, 2)


def test_rows_are_compared_with_the_current_optimum(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    written = rows(script, monkeypatch, 0.95)
    assert "95%, 0.100 (1/1)" in script.page(written, 1)
    better = replace(reference(CELL), reward=2.0 * reference(CELL).reward)
    monkeypatch.setattr(script, "reference", lambda case: better)
    assert "**48%, 0.100 (0/1)**" in script.page(written, 1)


def test_the_page_marks_what_some_seed_missed(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    page = script.page(rows(script, monkeypatch, 0.95, 0.85), 2)
    assert "**90%, 0.100 (1/2)**" in page
    page = script.page(rows(script, monkeypatch, 0.95, 0.97), 2)
    assert "| 96%, 0.100 (2/2) |" in page and "not run" in page
