"""Tests of the estimate of what can be told of the banks from what lies ahead: of numbers that follow from those given,
and of noise."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from thalweg.bench.csv_files import read_csv
from thalweg.train.encoder.views import TARGETS

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.delitem(sys.modules, "seen_ahead", raising=False)
    return importlib.import_module("seen_ahead")


def test_what_is_given_lies_seven_metres_ahead_or_farther_and_is_not_told(script: ModuleType):
    points = {name.rpartition(" at ")[2] for name in script.AHEAD}
    assert points == {"7 m", "11 m", "16 m", "24 m"} and len(script.AHEAD) == 4 * 4
    assert not set(script.GIVEN) & set(script.TOLD) and {*script.GIVEN, *script.TOLD} <= set(TARGETS)


def test_what_follows_from_the_given_is_told_and_noise_is_not(script: ModuleType, monkeypatch: pytest.MonkeyPatch):
    rng = np.random.default_rng(0)

    def numbers(_: str) -> np.ndarray:
        truths = rng.normal(5.0, 2.0, (3000, len(TARGETS)))
        left, height = (script.columns(truths, (name,))[:, 0] for name in ("left at 7 m", "height"))
        truths[:, TARGETS.index("left bank")] = 30.0 + 4.0 * left - 2.0 * height
        truths[:, TARGETS.index("right bank")] = np.abs(left - 5.0)
        return truths

    monkeypatch.setattr(script, "numbers", numbers)
    monkeypatch.setattr(script, "PASSES", 12)
    found = script.measured()
    assert list(found) == list(script.TOLD)
    assert found["left bank"] > 0.95 and found["right bank"] > 0.8 and found["heading error"] < 0.05


def test_the_committed_table_has_each_quantity(script: ModuleType):
    rows = read_csv(script.TABLE, ("quantity", "r_squared"))
    assert [row["quantity"] for row in rows] == list(script.TOLD)
    page = " ".join((BENCHMARKS.parent / "docs" / "encoder.md").read_text(encoding="utf-8").split())
    left, right, heading = (f"{float(row['r_squared']):.2f}" for row in rows[:3])
    assert left == right and f"tells the banks beside it with {left} and the heading with {heading}" in page
