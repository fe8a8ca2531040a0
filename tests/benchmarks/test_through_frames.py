"""Checks through frames: planned runs, the rivers that they fly, and the table of those that are of today."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from thalweg.bench.csv_files import read_csv
from thalweg.core import versions

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPTS = ("any_river", "ladder_arms", "ladder_page", "ladder", "river_flights", "through_frames")
FIGURES = {"return": "9.000", "return_error": "0.100", "violations": "0.0200", "cost": "0.0100", "reasons": "Success=2"}
MARKS = "before\n<!-- through frames -->\nold\n<!-- /through frames -->\nafter\n"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    for name in SCRIPTS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("through_frames")


def row(script: ModuleType, arm: Any, returned: float) -> dict[str, str]:
    (cell,) = arm.cells(script.EPISODES, script.FLIGHTS)
    return sys.modules["ladder"].row_of(cell, FIGURES | {"return": f"{returned:.3f}"})


def test_settings_are_compared_on_another_river_with_other_seeds(script: ModuleType):
    found = [(script.label(arm), arm.settings) for arm in script.checks()]
    assert len({label for label, _ in found}) == len(found) == 56
    asymmetric = ("PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP", "TD3Lag")
    changed = ("PPO-symmetric", *(f"{name}-asymmetric" for name in asymmetric))
    assert [label for label, changes in found if changes] == [
        f"{name}-4000-{seed}" for name in changed for seed in (10, 11, 12)
    ]
    assert [label for label, _ in found if label.startswith("PPOLag-1-")] == ["PPOLag-1-0", "PPOLag-1-1", "PPOLag-1-2"]


def test_flights_are_on_the_river_of_training(script: ModuleType):
    (cell,) = script.checks()[-1].cells(3, script.FLIGHTS)
    found = [(course.world.seed, course.indices.tolist(), course.looks) for course in cell.courses(drawn=False)]
    assert (cell.level, found) == ("Medium", [(4000, [0, 1, 2], None)])


def test_the_table_has_the_rows_of_today_and_an_interval_over_three_seeds(script: ModuleType):
    ppo = [arm for arm in script.checks() if arm.name == "PPO"]
    other = next(arm for arm in script.checks() if arm.name == "PPOLag-asymmetric")
    rows = [row(script, arm, 7.0 + arm.seed) for arm in ppo] + [row(script, other, 6.5)]
    outdated = row(script, other, 1.0) | {"versions": "PPOLag=0"}
    page = " ".join(script.written_page(MARKS, [*rows, outdated]).split())
    told = "the privileged state and progress too"
    assert f"| PPO | {told} | 1 | 3 | 8.00 [5.52, 10.00] | 7.00, 8.00, 9.00 | 0.010 |" in page
    assert f"| PPOLag, `asymmetric_critics=True` | {told} | 4000 | 1 | 6.50 | 6.50 | 0.010 |" in page
    assert "old" not in page and page.startswith("before") and page.endswith("after")
    before = rows[-1] | {"versions": rows[-1]["versions"].replace(f" deadlines={versions.DEADLINES}", "")}
    assert before["versions"] != rows[-1]["versions"]
    page = " ".join(script.written_page(MARKS, [before]).split())
    assert f"| PPOLag, `asymmetric_critics=True` (before deadlines 1) | {told} | 4000 | 1 | 6.50 |" in page
    assert "(before" not in script.written_page(MARKS, [before | {"return": "1.000"}, rows[-1]])
    assert "Nothing was measured with today's versions." in script.written_page(MARKS, [outdated])


def test_the_page_is_as_the_committed_rows_have_it(script: ModuleType):
    page = script.PAGE.read_text(encoding="utf-8")
    assert script.written_page(page, read_csv(script.TABLE, script.COLUMNS)) == page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "TRPO-*"], "--only TRPO-* matches no check; --list shows their labels"),
        (["--jobs", "0"], "--jobs must be at least 1, not 0"),
        (["--write", "--out", "other.csv"], "--write is for the table of this folder; leave --out out"),
    ],
)
def test_wrong_arguments_are_refused(
    script: ModuleType, arguments: list[str], message: str, capsys, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(script, "status_of", lambda *_: pytest.fail("the checks were run"))
    with pytest.raises(SystemExit):
        script.main(arguments)
    assert message in capsys.readouterr().err
