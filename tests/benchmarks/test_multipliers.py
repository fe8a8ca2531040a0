"""The comparison of multipliers: which runs there are, what a run costs and how it swings, and the table."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in ("ideal_eye", "river_flights", "multipliers"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("multipliers")


def row(script: ModuleType, trial: Any, fixed_cost: float, **values: object) -> dict[str, str]:
    filled = dict.fromkeys(script.MEASURED, "1.0") | {"fixed_cost": f"{fixed_cost:.3f}"}
    return dict(zip(script.KEY, trial.key, strict=True)) | filled | {name: str(each) for name, each in values.items()}


def test_three_algorithms_are_compared_at_the_middle_limit_of_each_task(script: ModuleType):
    found = script.trials()
    assert len(found) == len({trial.key for trial in found}) == 4 * 3 * 2 * 3
    assert {(trial.task, trial.limit) for trial in found} == {
        ("Swimmers", 15.0),
        ("Nests", 23.0),
        ("RacingLine", 2.3),
        ("Portage", 9.2),
    }
    assert {trial.seed for trial in found} == {10, 11, 12}  # those of the suites are 0, 1 and 2


def test_a_run_is_known_by_its_settings_and_versions(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    trial = script.Trial("Nests", "TD3Lag", "limit", 10)
    assert trial.settings["cost_scale"] == "limit" and trial.settings["cost_limit"] == 23.0
    assert trial.key[:6] == ("Nests", "TD3Lag", "cost_scale=limit multiplier_max=10.0", "23", "100000", "10")
    config = script.KEY.index("config")
    assert trial.key[config] != replace(trial, change="defaults").key[config]
    before = trial.key
    monkeypatch.setattr(script.versions, "TASKS", 99)
    assert trial.key != before and trial.key[config] == before[config]


def test_the_swing_is_that_of_the_last_quarter(script: ModuleType):
    costs = ["nan", "7", "7", "7", "7", "7", "1", "3"]
    assert script.training_figures([{"cost_mean": cost} for cost in costs]) == {
        "training_cost": "2.000",
        "swing": "1.000",
    }
    assert script.training_figures([{"cost_mean": cost} for cost in [*costs[:-1], "nan"]]) == {
        "training_cost": "1.000",
        "swing": "0.000",
    }


def test_the_page_has_a_line_for_each_setting(script: ModuleType):
    plain, limited = (script.Trial("RacingLine", "SACLag", change, 10) for change in ("defaults", "limit"))
    rows = [row(script, replace(plain, seed=seed), cost, swing=2.3) for seed, cost in ((10, 1), (11, 2.3), (12, 9))]
    rows.append(row(script, limited, 2.31, swing=0.46, fixed_return=4.0, unseen_cost=0.5, unseen_return=3.0))
    outdated = row(script, replace(limited, seed=11), 8.0) | {"tasks": "0"}
    page = script.written_page("a\n<!-- multipliers -->\nold\n<!-- /multipliers -->\n", [*rows, outdated, rows[0]])
    lines = page.splitlines()
    assert "| RacingLine | 2.3 | SACLag | the defaults | 1.00 | 1, 2.3, 9; 1.00 | 1, 1, 1; 1.00 | 2 of 3 |" in lines
    settings = "`cost_scale=limit` `multiplier_max=10.0`"
    assert f"| RacingLine | 2.3 | SACLag | {settings} | 0.20 | 2.31; 4.00 | 0.5; 3.00 | 0 of 1 |" in lines
    assert "old" not in page and len(lines) == 1 + 1 + 2 + 2 + 1


def test_runs_are_listed_and_selected(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(sys, "argv", ["multipliers.py", "--list", "--only", "Nests-TD3Lag-limit-*"])
    assert script.main() == 0
    assert capsys.readouterr().out.split() == [f"Nests-TD3Lag-limit-{seed}" for seed in (10, 11, 12)]
    monkeypatch.setattr(sys, "argv", ["multipliers.py", "--only", "Nest-*"])
    with pytest.raises(SystemExit):
        script.main()
    assert "--only Nest-* selects no run; --list names them" in capsys.readouterr().err


@pytest.mark.slow
def test_a_short_run_is_measured_once(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(script, "OFF_POLICY_STEPS", 16_384)
    monkeypatch.setattr(script, "EPISODES", 3)
    table = tmp_path / "table.csv"
    given = ["multipliers.py", "--only", "RacingLine-DDPGLag-limit-10", "--runs", str(tmp_path), "--out", str(table)]
    monkeypatch.setattr(sys, "argv", given)
    assert script.main() == 0
    (measured,) = script.read_csv(table, script.COLUMNS)
    assert float(measured["fixed_cost"]) >= 0.0 and float(measured["training_cost"]) > 0.0
    capsys.readouterr()
    assert script.main() == 0 and not capsys.readouterr().out
    assert len(script.read_csv(table, script.COLUMNS)) == 1
    table.unlink()
    (metrics,) = tmp_path.glob("*/metrics.csv")
    before = metrics.stat().st_mtime_ns
    assert script.main() == 0 and script.read_csv(table, script.COLUMNS) == [measured]
    assert metrics.stat().st_mtime_ns == before  # flown again, not trained
