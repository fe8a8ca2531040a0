"""Tests of the table of training times and the learning curves of `benchmarks/pace.py`."""

import csv
import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from thalweg.core import versions


@pytest.fixture
def pace(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "pace", raising=False)
    return importlib.import_module("pace")


def metrics(updates: int = 9, steps: int = 2048) -> list[dict[str, str]]:
    """Return rows of a log in which each update takes 2 s, half of them in the environment."""
    shares = {"act": 0.1, "env": 1.0, "learn": 0.5, "encode": 0.3, "other": 0.1}
    return [
        {
            "steps": str(steps * update),
            "seconds": str(2.0 * update),
            "return_mean_50": str(update),
            "cost_mean_50": "0.25",
        }
        | {f"time_{stage}": str(share) for stage, share in shares.items()}
        for update in range(1, updates + 1)
    ]


def test_a_row_has_the_sum_of_each_stage_and_the_final_return_and_cost(pace: ModuleType):
    row = pace.row_of("PPO", "fast", metrics())
    assert [row[stage] for stage in pace.STAGES] == ["0.9", "9.0", "4.5", "2.7", "0.9"]
    assert (row["steps"], row["seconds"], row["return_mean_50"], row["cost_mean_50"]) == (
        "18432",
        "18.0",
        "9.000",
        "0.250",
    )
    assert set(row) == set(pace.COLUMNS)


def test_a_curve_has_a_point_every_4096_steps_and_a_last_one(pace: ModuleType):
    curve = pace.curve_of("PPO", metrics())
    assert [int(row["steps"]) for row in curve] == [2048, 4096, 8192, 12288, 16384, 18432]
    assert curve[-1]["return_mean_50"] == "9.000"


def test_a_repeated_run_replaces_the_previous_one(pace: ModuleType, tmp_path: Path):
    path = tmp_path / "pace.csv"
    for name, returns in (("SACLag", 1), ("PPO", 2), ("SACLag", 3)):
        pace.replace_rows(path, pace.COLUMNS, [pace.row_of(name, "fast", metrics(returns))])
    rows = list(csv.DictReader(path.open()))
    assert [(row["algorithm"], row["return_mean_50"]) for row in rows] == [("PPO", "2.000"), ("SACLag", "3.000")]


def test_the_table_has_minutes_and_shares(pace: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pace, "TABLE", tmp_path / "pace.csv")
    pace.replace_rows(pace.TABLE, pace.COLUMNS, [pace.row_of("PPO", "fast", metrics())])
    version = versions.ALGORITHMS["PPO"]
    seen = "the privileged state and progress too"
    assert f"| PPO | {seen} | {version} | 0.3 | 1,024 | 5% | 50% | 25% | 15% | 5% | 9.00 | 0.25 |" in pace.table()
    assert pace.table().endswith("\nProcessor: fast.\n")
    pace.replace_rows(pace.TABLE, pace.COLUMNS, [pace.row_of("PPO", "fast", metrics()) | {"version": "0"}])
    assert "| PPO | unknown | 0 |" in pace.table()


def test_a_finished_run_of_another_version_gives_no_row(
    pace: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(pace, "TABLE", tmp_path / "pace.csv")
    monkeypatch.setattr(pace, "load_compatible_encoder", lambda _: None)
    monkeypatch.setattr(pace.RiverTraining, "train", lambda *_, **__: None)
    monkeypatch.setattr(pace, "read_config", lambda _: {"made_with": {"PPO": 0}})
    with pytest.raises(SystemExit, match=f"holds a run of PPO 0, not {versions.ALGORITHMS['PPO']}: remove it"):
        pace.measure("PPO", tmp_path / "run")
    assert not pace.TABLE.exists()


def test_an_algorithm_of_another_version_has_no_row(pace: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pace, "TABLE", tmp_path / "pace.csv")
    row = pace.row_of("PPO", "fast", metrics())
    pace.replace_rows(pace.TABLE, pace.COLUMNS, [row])
    assert pace.has_row("PPO") and not pace.has_row("CPO")
    pace.replace_rows(pace.TABLE, pace.COLUMNS, [row | {"version": "0"}])
    assert not pace.has_row("PPO")


@pytest.mark.parametrize("changed", ["TRAINING", "WORLD", "RENDER", "RULES", "PACKAGED_ENCODER"])
def test_a_row_of_another_river_or_training_is_not_todays(
    changed: str, pace: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(pace, "TABLE", tmp_path / "pace.csv")
    pace.replace_rows(pace.TABLE, pace.COLUMNS, [pace.row_of("PPO", "fast", metrics())])
    monkeypatch.setattr(versions, changed, 99)
    assert not pace.has_row("PPO")


def test_a_finished_run_of_another_training_gives_no_row(
    pace: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(pace, "load_compatible_encoder", lambda _: None)
    monkeypatch.setattr(pace.RiverTraining, "train", lambda *_, **__: None)
    monkeypatch.setattr(
        pace, "read_config", lambda _: {"made_with": {"PPO": versions.ALGORITHMS["PPO"], "training": 0}}
    )
    with pytest.raises(SystemExit, match="holds a run of training 0, not 1: remove it"):
        pace.measure("PPO", tmp_path / "run")


def test_the_curve_is_drawn_as_a_png(pace: ModuleType, tmp_path: Path):
    path = tmp_path / "new" / "ppo.png"
    pace.draw("PPO", "3", pace.curve_of("PPO", metrics()), path)
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_the_page_shows_todays_table(pace: ModuleType):
    assert pace.main(["--check"]) == 0, "python benchmarks/pace.py --write"
