"""Tests of the trials with an ideal eye: which are run, and what a row holds."""

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from thalweg.cli.options import UsageError


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "ideal_eye", raising=False)
    return importlib.import_module("ideal_eye")


def test_a_table_that_a_killed_process_left_empty_gets_its_heading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    module, table, row = importlib.import_module("tables"), tmp_path / "table.csv", {"a": "1", "b": "2"}
    table.touch()
    for _ in range(2):
        module.append(table, list(row), row)
    assert table.read_text() == "a,b\n1,2\n1,2\n"


class Flights:
    """Two environments that pay 1 and cost 0.5 a step; the first episodes last 2 and 3 steps, later ones for ever."""

    done_reasons = ("Success", "Idle")

    def __init__(self, worlds: Any, count: int, rules: Any) -> None:
        self.steps = 0

    def reset(self, seed: int) -> tuple[np.ndarray, dict]:
        return np.zeros((2, 1)), {}

    def step(self, actions: Any) -> tuple[Any, ...]:
        self.steps += 1
        ended = np.array([self.steps == 2, self.steps == 3])
        reasons = np.where(ended, [0, 1], -1)
        info = {"cost": np.full(2, 0.5), "done_reason": reasons}
        return np.zeros((2, 1)), np.ones(2), ended, np.zeros(2, bool), info

    def close(self) -> None:
        pass


def test_a_flight_is_the_first_episode_of_each_environment(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(script, "RiverVectorEnv", Flights)
    policy = SimpleNamespace(player=lambda count, generator: lambda obs, fresh: np.zeros(count))
    assert script.fly(policy, [], 2) == (2.5, 1.25, 0.5)


def test_a_trial_is_known_by_its_settings_and_by_all_defaults(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    trial = script.Trial("TD3Lag", {"output_decay": 0.5, "minibatch": 64}, 1000, 3)
    assert trial.key[:6] == ("TD3Lag", "minibatch=64 output_decay=0.5", "Medium", "1000:1016", "1000", "3")
    same = script.Trial("TD3Lag", {"minibatch": 64, "output_decay": 0.5}, 1000, 3)
    assert trial.key == same.key and trial.config != script.Trial("TD3Lag", {}, 1000, 3).config
    assert script.Trial("TD3Lag", {}, 1000, 3, rivers=range(5, 6)).key[3] == "5"
    assert script.Trial("TD3Lag", {"hidden": [64, 32]}, 1000, 3).key[1] == "hidden=[64,32]"


def test_a_trial_with_a_row_is_not_run_again(script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    ran: list[tuple] = []

    def measure(trial: Any, runs: Path) -> dict[str, str]:
        ran.append((trial.algorithm, dict(trial.settings), trial.steps, trial.seed))
        return dict(zip(script.KEY, trial.key, strict=True)) | {"medium_return": "9.00"}

    monkeypatch.setattr(script, "measure", measure)
    table = tmp_path / "table.csv"
    line = ["ideal_eye.py", "--algorithm", "td3lag", "--set", "minibatch=64", "--seeds", "0", "1", "--out", str(table)]
    for seeds in ([], ["2"]):
        monkeypatch.setattr(sys, "argv", [*line[:7], *seeds, *line[7:]])
        script.main()
    assert [seed for *_, seed in ran] == [0, 1, 2] and ran[0] == ("TD3Lag", {"minibatch": 64}, 100_000, 0)
    assert len(table.read_text().splitlines()) == 4 and len(script.finished(table)) == 3


def test_the_table_of_trials_is_run_by_default_or_in_part(script: ModuleType):
    chosen = {
        "algorithm": None,
        "only": ["SACLag"],
        "seeds": [0, 1],
        "level": "Hard",
        "rivers": range(3),
        "choose": False,
    }
    found = script.trials_of(SimpleNamespace(**chosen))
    assert {(trial.algorithm, trial.level) for trial in found} == {("SACLag", "Hard")}
    assert len(script.trials_of(SimpleNamespace(**chosen | {"only": []}))) == 2 * len(script.TRIALS)
    for choose in (False, True):
        some = script.trials_of(SimpleNamespace(**chosen | {"rivers": None, "seeds": None, "choose": choose}))
        found = [(trial.seed, trial.rivers[0], trial.unseen[0]) for trial in some]
        assert found == [(seed + 10 * choose, 1000 + 3000 * choose, 2000 + 3000 * choose) for seed in (0, 1, 2)]
    with pytest.raises(UsageError, match="--set takes key=value"):
        script.trials_of(SimpleNamespace(**chosen | {"algorithm": "PPO", "set": ["clip"], "steps": 1}))


def test_rivers_are_a_range_or_one_seed(script: ModuleType):
    assert script.rivers_named("1000:1016") == range(1000, 1016) and script.rivers_named("7") == range(7, 8)


def test_a_page_has_the_defaults_and_then_what_was_tried(script: ModuleType):
    def row(changes: str, rivers: str, seed: int, returned: float, algorithm: str = "PPO") -> dict[str, str]:
        settings = {} if changes == "none" else {"entropy": 0.5}
        config = script.Trial(algorithm, settings, 1000, seed).config
        scores = {f"{place}_{what}": str(returned + seed) for place in script.PLACES for what in ("return", "cost")}
        key = (algorithm, changes, "Medium", rivers, "1000", str(seed), config, *script.versions_of(algorithm))
        return dict(zip(script.KEY, key, strict=True)) | scores

    other = row("none", "1000:1016", 0, 9.0)
    outdated = [other | {name: "0"} for name in ("config", *script.VERSION_COLUMNS)]
    rows = [
        row("none", "1000:1016", 0, 2.0),
        row("none", "1000:1016", 1, 2.0),
        row("entropy=0.5", "4000:4016", 10, 3.0),
        row("none", "1000:1016", 0, 9.0, "CPO"),
    ]
    assert [script.is_current(one) for one in [*rows, *outdated]] == [True] * 4 + [False] * 6
    first, second = script.page_section(rows, "PPO").split("other seeds:")
    assert "| none | Medium 1000:1016, 1,000 | 2 | 2.50 / 2.50 |" in first and "4000" not in first
    assert "| `entropy=0.5` | Medium 4000:4016, 1,000 | 1 | 13.00 / 13.00 |" in second and "none" not in second
    assert script.page_section(rows, "CUP") == "No trial of today's versions yet.\n"


def test_rows_from_before_deadlines_stand_in_for_those_of_today_and_say_so(script: ModuleType):
    told = script.Trial("CPO", {"asymmetric_critics": True}, 1000, 10, rivers=script.CHOOSING_RIVERS)
    today = dict(zip(script.KEY, told.key, strict=True)) | {
        f"{place}_{what}": "2.0" for place in script.PLACES for what in ("return", "cost")
    }
    older = today | {"config": script.settings_hash(told.resolved)}
    assert older["config"] != today["config"]
    assert script.shown_rows([older]) == [older] and script.shown_rows([older, today]) == [today]
    assert script.shown_rows([older | {"config": "00000000"}]) == []
    assert "| `asymmetric_critics=True` (before deadlines 1) | " in script.page_section([older], "CPO")
    assert "| `asymmetric_critics=True` | " in script.page_section([today], "CPO")
    plain = script.Trial("PPO", {"asymmetric_critics": True}, 1000, 10)  # which has no critics of costs
    assert plain.config == script.settings_hash(plain.resolved)


def test_a_trial_that_two_commands_ran_is_one_seed_with_its_last_row(script: ModuleType):
    key = dict(zip(script.KEY, script.Trial("PPO", {}, 1000, 0).key, strict=True))
    rows = [key | {"medium_return": returned} for returned in ("9.00", "7.00")]
    assert script.shown_rows(rows) == rows[1:]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (["--only", "PPOlag"], "argument --only: invalid choice: 'PPOlag'"),
        (["--set", "entropy=0.01"], "--set and --steps are of one trial: name its algorithm by --algorithm"),
        (["--steps", "50"], "--set and --steps are of one trial: name its algorithm by --algorithm"),
        (["--algorithm", "CUP", "--only", "PPO"], "--only is for the table's trials; leave it out beside --algorithm"),
        (["--write", "--out", "a.csv"], "--write and --check are for the table of this folder; leave --out out"),
        (["--check", "--out", "a.csv"], "--write and --check are for the table of this folder; leave --out out"),
    ],
)
def test_options_that_would_be_ignored_are_refused(
    script: ModuleType, wrong: list[str], told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr(sys, "argv", ["ideal_eye.py", *wrong])
    monkeypatch.setattr(script, "measure", None)
    monkeypatch.setattr(script, "written_pages", dict)
    with pytest.raises(SystemExit, match="2"):
        script.main()
    assert told in capsys.readouterr().err
