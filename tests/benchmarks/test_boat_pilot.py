"""The benchmark of the boat's pilot: its table, and that rivers which are in it are not run again."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.env.vehicle.basins import basin


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    monkeypatch.delitem(sys.modules, "boat_pilot", raising=False)
    return importlib.import_module("boat_pilot")


def test_the_table_says_the_least_return_and_how_many_rivers_cost_nothing(script: ModuleType):
    values = [
        ("Easy", "1", "10.0000", "0", "0", "0"),
        ("Easy", "2", "9.5000", "0", "0.2", "0.3"),
        ("Hard-Deep", "1", "10", "0", "0", "0.0001"),
    ]
    rows = [
        dict(zip(script.COLUMNS, (*each, str(length), "Success", *script.VERSIONS.values()), strict=True))
        for each, length in zip(values, (200, 500, 420), strict=True)
    ]
    section = script.page_section(rows)
    assert "| Easy | 2 of 300 | 9.50 | 1 | 500 |" in section
    assert "| Medium-Deep | 0 of 300 | not measured | not measured | not measured |" in section
    assert "| Hard-Deep | 1 of 300 | 10.00 | 0 | 420 |" in section
    assert "| Easy | 300 | 9.50 |" in script.page_section(rows[:2] * 150)
    assert script.page_section([]) == "Nothing was measured with today's versions.\n"


def test_only_rivers_that_are_missing_are_run(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    shallow = lambda x, y: np.where(np.abs(x - 20.0) < 2.0, 0.37, 1.5)  # noqa: E731
    built = []

    def load(level, seed: int):
        built.append(seed)
        return basin(shallow, length_m=40.0)

    monkeypatch.setattr(script, "load_or_sound", load)
    out = str(tmp_path / "trial.csv")
    for seeds in (["3000:3002"], ["3001:3003"]):
        monkeypatch.setattr(sys, "argv", ["boat_pilot.py", "--levels", "Easy", "--seeds", *seeds, "--out", out])
        script.main()
    assert built == [3000, 3001, 3002]
    rows = script.rows_of(Path(out), script.COLUMNS)
    assert [row["seed"] for row in rows] == ["3000", "3001", "3002"]
    lines = Path(out).read_text().splitlines()
    lines = [f"{line.rpartition(',')[0]},0" if ",3001," in line else line for line in lines]
    Path(out).write_text("\n".join(lines) + "\n")  # a boat of an earlier version
    script.main()
    assert built == [3000, 3001, 3002, 3001] and len(script.rows_of(Path(out), script.COLUMNS)) == 3
    assert all(float(row["tight"]) == 0.0 and row["reason"] == "Success" for row in rows), rows
