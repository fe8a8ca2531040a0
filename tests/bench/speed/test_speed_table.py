"""Tests of what `thalweg speed` prints and writes."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from thalweg.bench.speed import speed_table
from thalweg.bench.speed.measure import Measurement
from thalweg.bench.speed.speed_table import COLUMNS, describe, print_table, record, speed_frame

LINE = Measurement("render", "frames/s", 1234.5, 987.65, 1400.0, 7, 16, 4, "128x128", "everything drawn")


def test_json_is_all_that_is_printed_and_names_machine_and_versions(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
):
    monkeypatch.setattr(speed_table, "measure", lambda plan: iter([LINE]))
    assert speed_table.speed(as_json=True, quick=True, out=tmp_path / "speed.json") == 0
    text = capsys.readouterr().out
    assert (tmp_path / "speed.json").read_text() == text
    found = json.loads(text)
    assert found["measurements"][0]["median"] == 1234.5
    assert set(found["machine"]) == {"cpu", "cpu_type", "vector_bits", "cores", "memory_gib", "system"}
    assert {"torch", "numba", "python", "thalweg"} <= set(found["versions"])


def test_a_row_names_everything_that_a_figure_depends_on():
    found = record([LINE])
    (row,) = speed_frame(found).itertuples(index=False, name=None)
    assert list(row) == ["render", "1,234", "988", "1,400", "frames/s", "16", "4", "128x128", "everything drawn"]
    assert len(row) == len(COLUMNS)
    console = Console(record=True, width=200, file=io.StringIO())
    print_table(found, console)
    shown = console.export_text()
    assert "everything drawn" in shown
    assert f"{found['machine']['cores']} cores" in describe(found)


def test_the_machine_is_described_by_processor_and_vectors_where_they_are_recorded():
    machine = {"cpu": "Maker's Chip", "cores": 2, "memory_gib": 8, "system": "Linux x86_64"}
    found = {"machine": machine, "versions": {"python": "3.11"}}
    assert describe(found) == "Maker's Chip, 2 cores, 8 GiB, Linux x86_64; python 3.11"
    found["machine"] = {**machine, "cpu_type": "znver4", "vector_bits": 512}
    assert describe(found) == "Maker's Chip (znver4, vectors of 512 bits), 2 cores, 8 GiB, Linux x86_64; python 3.11"
