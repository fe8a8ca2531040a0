"""Options of commands that train, run suites, report and measure speed: each reaches what it is for."""

from pathlib import Path
from typing import Any

import pytest

from tests.bench.small_backend import SUITE, SmallBackend, write_film_of
from tests.bench.suite.test_rivers import LINE
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.execute.executors import ProcessPoolExecutor
from thalweg.bench.suite.config import Suite
from thalweg.cli.main import main
from thalweg.train.river import RiverTraining
from thalweg.train.run_in_folder import RunResult


def test_options_of_training_are_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: dict[str, Any] = {}

    def train(ground: RiverTraining, algorithm: str, encoder: Any, **options: Any) -> RunResult:
        told.update(options)
        return RunResult(tmp_path, algorithm, 300, 0, 0.0, 0.0, 0.0, 1.0, None, False, ())

    monkeypatch.setattr(RiverTraining, "train", train)
    options = ["--seed", "7", "--steps", "300", "--threads", "3", "--device", "cuda:1", "--graphs"]
    assert main(["train", "--observation", "privileged", *options, "--out", str(tmp_path)]) == 0
    asked = {"seed": 7, "steps": 300, "threads": 3, "device": "cuda:1", "graphs": True}
    assert {name: told[name] for name in asked} == asked


def test_options_of_bench_are_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    told: list[Any] = []

    def run_suite(suite: Suite, folder: Path, *, executor: Any, reuse: Path | None = None, **_: Any) -> None:
        told.append((folder, type(executor), executor.jobs, reuse, [each.name for each in suite.conditions][-1:]))
        raise ResultsError("told")

    monkeypatch.setattr("thalweg.bench.execute.runner.run_suite", run_suite)
    monkeypatch.setattr("thalweg.core.cores.usable_cores", lambda: 5)
    brook = tmp_path / "brook.geojson"
    brook.write_text(LINE)
    options = ["--out", "here", "--reuse", "there", "--river", str(brook), "--width-m", "9"]
    assert main(["bench", "quick", *options]) == 2
    assert told == [(Path("here"), ProcessPoolExecutor, 5, Path("there"), ["river"])]


def test_a_failed_run_is_told_and_is_the_status(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, no_pictures: None
):
    monkeypatch.setattr("thalweg.bench.suite.builtin.load_suite", lambda _: SUITE)
    monkeypatch.setattr("thalweg.bench.execute.runner.RiverBackend", lambda _: SmallBackend(broken=("PPO-1",)))
    assert main(["bench", "small", "--jobs", "1", "--out", str(tmp_path)]) == 1
    assert "Failed: PPO-1: ArithmeticError: the loss is NaN in line two" in capsys.readouterr().out


def test_a_report_takes_films_into_the_page_and_tells_its_notes(
    tiny_results: Path, capsys: pytest.CaptureFixture, no_pictures: None
):
    write_film_of(tiny_results)
    assert main(["report", str(tiny_results), "--inline-films"]) == 0
    assert "data:video/mp4" in (tiny_results / "report" / "report.html").read_text()
    assert "Note:   " in capsys.readouterr().err


def test_options_of_speed_are_obeyed(monkeypatch: pytest.MonkeyPatch):
    told: list[Any] = []
    monkeypatch.setattr("thalweg.bench.speed.speed_table.speed", lambda **given: told.append(given) or 0)
    assert main(["speed", "--quick", "--stages", "--json"]) == 0
    assert told == [{"as_json": True, "quick": True, "out": None, "stages": True}]
