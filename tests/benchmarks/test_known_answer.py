"""Tests of the benchmark on problems with a known answer: which rows are kept, and what its page highlights."""

import importlib
import sys
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from tests.known_answer.harness import Case, Result, reference
from tests.known_answer.scores import Score
from thalweg.algos import ALGORITHMS
from thalweg.algos.common.errors import AlgorithmError
from thalweg.core import versions
from thalweg.core.config import frozen_config

ROOT = Path(__file__).resolve().parents[2]
CELL = Case("CPO", "box", "end")
SCRIPTS = ("known_answer", "known_answer_page", "known_answer_rows")


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch):
    """`benchmarks/known_answer.py`, which is in no package."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("known_answer")


@pytest.fixture
def table(script: ModuleType) -> ModuleType:
    return sys.modules["known_answer_page"]


def rows(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *shares: float) -> dict:
    """Rows of runs, one per seed, with these shares of the optimum's return."""
    best, found = reference(CELL), {}
    for seed, share in enumerate(shares):
        result = Result(CELL, Score.of(replace(best, reward=share * best.reward)), best)
        monkeypatch.setattr(script, "trained", lambda *_, result=result: result)
        found[script.key(CELL, seed)] = script.measure(CELL, seed, Path("unused"))
    return found


def write(script: ModuleType, path: Path, written: dict) -> None:
    """Write rows into a table one by one, as their runs end."""
    for row in written.values():
        script.put(path, row)


def test_written_rows_are_read_back_by_their_keys(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95, 0.85)
    write(script, tmp_path / "table.csv", written)
    assert script.finished(tmp_path / "table.csv") == written
    assert script.finished(tmp_path / "none.csv") == {}


def test_a_row_names_the_versions_of_its_algorithm_and_of_training(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setitem(versions.ALGORITHMS, "CPO", 7)
    monkeypatch.setattr(versions, "TRAINING", 4)
    written = rows(script, monkeypatch, 0.95) | {script.key(CELL, 1): script.failure(CELL, 1, ValueError("broken"))}
    write(script, tmp_path / "table.csv", written)
    found = script.finished(tmp_path / "table.csv").values()
    assert [(row["algorithm_version"], row["training_version"]) for row in found] == [("7", "4")] * 2


def test_rows_of_an_older_version_stay(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95)
    write(script, tmp_path / "table.csv", written)
    monkeypatch.setitem(versions.ALGORITHMS, "CPO", 7)
    assert script.finished(tmp_path / "table.csv") == written


def test_keys_differ_by_seed_settings_and_problem(script: ModuleType):
    others = [script.key(CELL, 1), script.key(Case("CPO", "box_scaled", "end"), 0)]
    others += [script.key(Case("CPO", "box", "dense"), 0)]
    assert script.key(CELL, 0) not in others
    assert script.key(CELL, 0) == script.key(Case("CPO", "box", "end"), 0)


def test_rows_of_other_defaults_are_dropped(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    written = rows(script, monkeypatch, 0.95)
    write(script, tmp_path / "table.csv", written)
    entry = ALGORITHMS["CPO"]

    @frozen_config(AlgorithmError)
    class Changed(entry.config):
        damping: float = 0.2

    monkeypatch.setitem(ALGORITHMS, "CPO", replace(entry, config=Changed))
    assert script.finished(tmp_path / "table.csv") == {}


def test_a_run_that_failed_is_a_row_and_does_not_count_as_finished(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    written = rows(script, monkeypatch, 0.95, 0.95)
    written[script.key(CELL, 1)] = script.failure(CELL, 1, ValueError("seed 1 is broken"))
    write(script, tmp_path / "table.csv", written)
    found = script.finished(tmp_path / "table.csv")
    assert found[script.key(CELL, 1)]["error"] == "ValueError: seed 1 is broken"
    assert list(script.remaining([(CELL, 0), (CELL, 1), (CELL, 2)], found)) == [(CELL, 1), (CELL, 2)]
    assert "**95%, 0.100 (1/2)**" in script.page(found, 2)
    found[script.key(CELL, 0)]["algorithm_version"] = "0"
    assert list(script.remaining([(CELL, 0)], found)) == [(CELL, 0)]


def test_rows_are_compared_with_the_current_optimum(
    script: ModuleType, table: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    written = rows(script, monkeypatch, 0.95)
    assert "95%, 0.100 (1/1)" in script.page(written, 1)
    better = replace(reference(CELL), reward=2.0 * reference(CELL).reward)
    monkeypatch.setattr(table, "reference", lambda case: better)
    monkeypatch.setattr(sys.modules["known_answer_rows"], "reference", lambda case: better)
    assert "**48%, 0.100 (0/1)**" in script.page(written, 1)


def test_the_page_marks_what_some_seed_missed(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    page = script.page(rows(script, monkeypatch, 0.95, 0.85), 2)
    assert "**90%, 0.100 (1/2)**" in page
    page = script.page(rows(script, monkeypatch, 0.95, 0.97), 2)
    assert "| 96%, 0.100 (2/2) |" in page and "not run" in page


def test_the_section_of_an_algorithm_names_the_seeds_that_miss(
    script: ModuleType, table: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    native = Case("CPO", "multidiscrete", "end")
    found = {}
    for seed, share in enumerate((0.95, 0.85, 1.0)):
        result = Result(
            native, Score.of(replace(reference(native), reward=share * reference(native).reward)), reference(native)
        )
        monkeypatch.setattr(script, "trained", lambda *_, result=result: result)
        found[script.key(native, seed)] = script.measure(native, seed, Path("unused"))
    found[script.key(native, 2)] = script.failure(native, 2, ValueError("broken"))
    text = " ".join(table.section(found, "CPO").split())
    assert text.endswith("| `end` | 0.1 | 2.07, 0.100 | 90.0%, 0.100 | 1 of 3 | seed 1: 85.0%, 0.100; seed 2 failed |")
    assert table.section({}, "CPO") == "No run of today's defaults yet.\n"
    only = {script.key(native, 0): script.failure(native, 0, ValueError("broken"))}
    assert "| failed | 0 of 1 | seed 0 failed |" in " ".join(table.section(only, "CPO").split())


def run(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str | None:
    """Call the script with its runs in threads of this process."""
    monkeypatch.setattr(script, "ProcessPoolExecutor", lambda jobs, *_: ThreadPoolExecutor(jobs))
    monkeypatch.setattr(sys, "argv", ["known_answer.py", "--spaces", "multidiscrete", "--seeds", "1", *arguments])
    return script.main()


def test_again_runs_what_is_selected_and_keeps_all_other_rows(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    best = {problem: reference(replace(CELL, problem=problem)) for problem in ("end", "two")}
    trained: list[tuple[str, bool]] = []

    def train(case: Case, seed: int, folder: Path) -> Result:
        trained.append((case.problem, folder.exists()))
        folder.mkdir(parents=True)
        return Result(case, Score.of(best[case.problem]), best[case.problem])

    monkeypatch.setattr(script, "trained", train)
    places = ["--out", str(tmp_path), "--runs", str(tmp_path / "runs"), "--only", CELL.algorithm]
    assert run(script, monkeypatch, *places, "--problems", "end", "two") is None
    kept = script.finished(tmp_path / "known_answer.csv")
    again = [*places, "--problems", "end", "--again", CELL.algorithm]
    assert run(script, monkeypatch, *again) is None and script.finished(tmp_path / "known_answer.csv") == kept
    assert sorted(trained) == [("end", False), ("end", False), ("two", False)] and len(kept) == 2


def test_a_killed_process_makes_no_rows_of_runs_that_never_began(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    def killed(*_: object) -> None:
        raise BrokenProcessPool("a process ended")

    monkeypatch.setattr(script, "measure", killed)
    said = run(script, monkeypatch, "--out", str(tmp_path), "--only", "PPO")
    assert said and "a process was killed" in said and not (tmp_path / "known_answer.csv").exists()


def test_rows_that_another_command_wrote_meanwhile_stay(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    one, other = rows(script, monkeypatch, 0.95, 0.85).values()
    path = tmp_path / "known_answer.csv"
    for row in (one, other):
        script.put(path, row)
    assert list(script.finished(path).values()) == [one, other]


def test_the_pages_are_as_the_rows_have_them(script: ModuleType, table: ModuleType):
    found = script.finished(ROOT / "benchmarks" / "known_answer.csv")
    assert (ROOT / "benchmarks" / "known_answer.md").read_text(encoding="utf-8") == table.page(found, script.SEEDS)
    for path, text in table.written_pages(found).items():
        assert path.read_text(encoding="utf-8") == text, (
            f"python benchmarks/known_answer.py --write changes {path.name}"
        )
