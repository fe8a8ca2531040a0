"""The benchmark of starts: its rows, its table, and flights of a policy that always turns the wrong way."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "starts", raising=False)
    return importlib.import_module("starts")


def test_every_start_counts_once_in_its_range(script: ModuleType):
    off, water = np.array([0.0, 19.9, 20.0, 79.0]), np.array([0.5, 0.0, 0.005, 0.004])
    rows = script.rows_of("Easy", off, water, np.array([True, False, True, True]))
    found = {(row["off_from"], row["water"]): (row["starts"], row["failures"]) for row in rows if row["starts"] != "0"}
    assert found == {
        ("0", "yes"): ("1", "1"),
        ("0", "no"): ("1", "0"),
        ("20", "yes"): ("1", "1"),
        ("70", "no"): ("1", "1"),
    }


def test_the_table_has_shares_of_each_range_and_of_all(script: ModuleType):
    off, water = np.array([10.0, 10.0, 75.0]), np.array([0.5, 0.5, 0.0])
    section = script.page_section(script.rows_of("Hard", off, water, np.array([True, False, True])))
    assert "| Hard | 0° to 20° | 50.0% of 2 |  |" in section
    assert "| Hard | 70° to 90° |  | 100.0% of 1 |" in section
    assert "| Hard | all | 50.0% of 2 | 100.0% of 1 |" in section


class Turns:
    """A policy that turns left at every step; notes which flights it is told are new."""

    def __init__(self) -> None:
        self.fresh: list[np.ndarray] = []

    def player(self, count: int, deterministic: bool) -> "Turns":
        return self

    def __call__(self, frames: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        self.fresh.append(fresh.copy())
        return np.tile([1, 0, 1, 1], (len(frames), 1))


def test_a_policy_that_only_turns_fails_at_all_starts_within_half_a_turn(
    script: ModuleType, monkeypatch: pytest.MonkeyPatch
):
    policy = Turns()
    monkeypatch.setattr(script, "load_policy", lambda path: policy)
    monkeypatch.setattr(script, "RIVERS", range(4000, 4001))
    monkeypatch.setattr(script, "TOGETHER", 4)
    off, water, failed = script.failures_at(Path("none"), "Easy", 6, 18)  # 10 degrees a step, at most 170 to go
    assert off.shape == water.shape == failed.shape == (6,)
    assert failed.all() and (off <= 80.1).all() and (water <= 1).all()
    assert all(fresh.all() for fresh in policy.fresh[::18])
