"""Tests of the traces of runs with a known answer: which reports are kept, and the committed ones."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.known_answer.harness import Case
from thalweg.core import versions

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def traces(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    for name in ("known_answer_traces", "known_answer_rows"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("known_answer_traces")


def reports(*steps: int) -> list[dict[str, str]]:
    """Reports of a run, whose multipliers are a thousandth of the steps; the first has no finished episode."""
    rows = [
        {
            "steps": str(step),
            "multiplier": str(step / 1000),
            "multiplier_tight": str(step / 1000),
            "multiplier_loose": "0.5",
            "cost_mean_50": "0.25",
            "return_mean_50": "3.0",
        }
        for step in steps
    ]
    rows[0] |= {"cost_mean_50": "nan", "return_mean_50": "nan"}
    return rows


def test_a_trace_has_the_first_report_of_each_interval_and_the_last(traces: ModuleType):
    found = traces.trace(Case("TD3Lag", "multidiscrete", "dense"), reports(512, 1024, 2048, 4000, 4096, 4608))
    assert [row["steps"] for row in found] == ["512", "2048", "4096", "4608"]
    numbers = ("steps", "multiplier", "budget", "cost_mean_50", "return_mean_50")
    assert found[0] == dict(zip(numbers, ("512", "0.512", "", "", ""), strict=True))
    assert found[-1] == dict(zip(numbers, ("4608", "4.608", "", "0.250", "3.000"), strict=True))


def test_two_limits_have_two_multipliers(traces: ModuleType):
    found = traces.trace(Case("CUP", "multidiscrete", "two"), reports(2048))
    assert (found[0]["multiplier"], found[0]["budget"]) == ("2.048 0.500", "")


def test_planners_have_budgets_instead(traces: ModuleType):
    (found,) = traces.trace(
        Case("SafeLOOP", "multidiscrete", "mixture"),
        [{"steps": "2048", "budget": "0.1749", "cost_mean_50": "0.1", "return_mean_50": "4"}],
    )
    assert (found["multiplier"], found["budget"]) == ("", "0.175")


def test_a_run_of_another_version_has_a_folder_of_its_own(
    traces: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folders: list[Path] = []

    class Stopped(Exception): ...

    def trained(case: Case, seed: int, folder: Path) -> None:
        folders.append(folder)
        raise Stopped

    monkeypatch.setattr(traces, "trained", trained)
    monkeypatch.setattr(sys, "argv", ["traces", "--runs", str(tmp_path), "--out", str(tmp_path / "rows.csv")])
    first = versions.ALGORITHMS["TD3Lag"]
    for version in (first, first, first + 1):
        monkeypatch.setitem(versions.ALGORITHMS, "TD3Lag", version)
        with pytest.raises(Stopped):
            traces.main()
    assert folders[0] == folders[1] != folders[2]
    assert all(folder.name.startswith("TD3Lag-multidiscrete-dense-2-") for folder in folders)


def test_every_run_has_rows_of_todays_versions(traces: ModuleType):
    rows = traces.rows_of(ROOT / "benchmarks" / "known_answer_traces.csv", traces.COLUMNS)
    for run in traces.RUNS:
        key = traces.key_of(*run)
        of_run = [row for row in rows if key.items() <= row.items()]
        assert len(of_run) > 4 and int(of_run[-1]["steps"]) >= Case(run[0], "multidiscrete", run[1]).requirement.steps
