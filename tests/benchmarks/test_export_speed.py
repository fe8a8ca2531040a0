"""The benchmark of exported policies: its row, and its table on the page."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from thalweg.bench.packaged import PACKAGED_POLICIES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    monkeypatch.delitem(sys.modules, "export_speed", raising=False)
    return importlib.import_module("export_speed")


@pytest.mark.parametrize("name", PACKAGED_POLICIES)
def test_both_ways_of_flying_take_turns(name: str, script: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    asked = []

    def in_turns(works, turns, _):
        asked.append((len(works), turns))
        for work in works:
            work()
        return [[0.4, 4.0], [0.2, 2.0], [0.9, 9.0]]

    monkeypatch.setattr(script, "in_turns", in_turns)
    monkeypatch.setattr(script, "STEPS", 2)
    row = script.measured(name, tmp_path)
    assert asked == [(2, script.TURNS)]
    assert (row["onnx_ms"], row["torch_ms"]) == ("200.000", "2000.000")
    assert row["file_mb"] == f"{(tmp_path / name).with_suffix('.onnx').stat().st_size / 1e6:.1f}"


def test_the_page_has_the_committed_table_of_every_packaged_policy(script: ModuleType):
    rows = script.read_csv(script.TABLE, script.COLUMNS)
    assert [row["policy"] for row in rows] == list(PACKAGED_POLICIES)
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    assert script.replace_section(page, "speed", script.page_table(rows)) == page
