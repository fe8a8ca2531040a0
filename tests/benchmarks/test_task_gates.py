"""Tests of the gates of tasks: what holds and what does not, which rows count, and that the page shows the tables."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from thalweg.bench.fronts.fronts import FrontPoint

SAFE = FrontPoint("Nests", "Medium", "fixed", 10.0, 100, 6.0, 5.9, 6.1, 0.0, 0.0, 0.0, 1)
FAST = replace(SAFE, price=0.0, return_=10.0, cost=40.0)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    for name in ("task_gates", "ideal_eye"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    module = importlib.import_module("task_gates")
    monkeypatch.setattr(module, "LIMITS", {"Nests": (4.0, 10.0, 20.0)})
    monkeypatch.setattr(module, "read_fronts", lambda: [SAFE, FAST, replace(SAFE, level="Hard", return_=9.9)])
    return module


def row(script: ModuleType, policy: str, seed: int, return_: float, cost: float) -> dict[str, str]:
    """A row of today's versions."""
    identity = dict(zip(script.KEY, script.key_of("Nests", policy, seed), strict=True))
    return identity | {"return": str(return_), "cost": str(cost)}


def test_gates_are_the_span_the_share_of_hovering_and_the_cheapest_multiple_of_the_middle_limit(script: ModuleType):
    rows = [row(script, "hover", 0, 0.2, 0.0), *(row(script, "PPO", seed, 9.0, 30.0 + seed) for seed in range(3))]
    gates = script.gates_of("Nests", rows)
    assert gates.span == pytest.approx(4.0) and gates.hover_share == pytest.approx(0.02)
    assert gates.limits == (4.0, 10.0, 20.0) and gates.multiple == pytest.approx(3.0) and gates.held


@pytest.mark.parametrize(("hover", "cost"), [(0.6, 35.0), (0.2, 29.0)])
def test_a_gate_that_is_missed_is_told(script: ModuleType, hover: float, cost: float):
    assert not script.gates_of("Nests", [row(script, "hover", 0, hover, 0.0), row(script, "PPO", 0, 9.0, cost)]).held


def test_a_gate_that_was_not_measured_does_not_hold_and_is_unknown(script: ModuleType):
    assert not script.gates_of("Nests", []).held
    hover, ppo = row(script, "hover", 0, 0.2, 0.0), row(script, "PPO", 0, 9.0, 35.0)
    ends = [script.gate_table(rows).splitlines()[2].strip("| ").split(" | ") for rows in ([], [hover], [ppo])]
    assert [(cells[2].strip(), cells[-1].strip()) for cells in ends] == [
        ("not measured", "unknown"), ("2.0 %", "unknown"), ("not measured", "unknown")
    ]  # fmt: skip
    assert script.gate_table([hover, ppo]).splitlines()[2].rstrip(" |").endswith("yes")


def test_rows_of_other_versions_and_settings_do_not_count(script: ModuleType):
    old = row(script, "PPO", 0, 9.0, 5.0) | {"tasks": "0"}
    other = row(script, "PPO", 1, 9.0, 5.0) | {"config": "0"}
    assert script.gates_of("Nests", [old, other, row(script, "PPO", 2, 9.0, 35.0)]).learners == ((9.0, 35.0),)


@pytest.mark.parametrize("policy", ["hover", "PPO"])
@pytest.mark.parametrize("name", ["WORLD", "RULES", "EVALUATION"])
def test_flights_of_other_worlds_and_rules_do_not_count(
    script: ModuleType, policy: str, name: str, monkeypatch: pytest.MonkeyPatch
):
    made = row(script, policy, 0, 0.2, 30.0)
    monkeypatch.setattr(script.versions, name, 99)
    gates = script.gates_of("Nests", [made])
    assert np.isnan(gates.hover) and gates.learners == ()


def test_policies_of_other_versions_do_not_count(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    made = row(script, "PPO", 0, 8.0, 30.0)
    assert script.gates_of("Nests", [made]).learners == ((8.0, 30.0),)
    monkeypatch.setitem(script.versions.ALGORITHMS, "PPO", 10**6)
    assert script.gates_of("Nests", [made]).learners == ()
    assert script.gate_table([made]).splitlines()[2].split(" | ")[4] == "not measured"


def test_a_line_of_the_fronts_has_both_ends_half_of_the_span_and_the_area(script: ModuleType):
    line = script.front_table([SAFE, FAST]).splitlines()[2]
    # A trapezium of heights 6 and 10 below the line, of a rectangle of height 10.
    assert [cell.strip() for cell in line.strip("|").split("|")] == [
        *("Nests", "Medium", "fixed", "100", "6.00 at 0", "10.00 at 40", "20", "0.80")
    ]


def test_the_page_shows_todays_tables(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "task_gates", raising=False)
    module = importlib.import_module("task_gates")
    assert module.PAGE.read_text() == module.written_page(), "python benchmarks/task_gates.py --write"
