import json
import time
from pathlib import Path

import pytest
from rich.console import Console

from thalweg.bench import speed
from thalweg.bench.speed import COLUMNS, Measurement, Plan, describe, rates, record, table_rows

LINE = Measurement("render", "frames/s", 1234.5, 987.65, 1400.0, 7, 16, 4, "128x128", "everything drawn")


def test_a_rate_is_work_done_over_time_passed():
    def work() -> int:
        time.sleep(0.02)
        return 3

    for found in rates(work, Plan(repeats=3, seconds=0.1)):
        assert 75 < found <= 150  # 3 in a little more than 0.02 s, on a busy machine too


def test_the_first_call_which_may_compile_is_not_counted():
    calls = []

    def work() -> int:
        calls.append(time.perf_counter())
        time.sleep(0.5 if len(calls) == 1 else 0.01)
        return 1

    (found,) = rates(work, Plan(repeats=1, seconds=0.1))
    assert found > 20


def test_the_slowest_is_the_least_rate_but_the_longest_time():
    rate = speed._line("render", "frames/s", [3.0, 1.0, 2.0])
    duration = speed._line("build", "s", [3.0, 1.0, 2.0])
    assert (rate.median, rate.slowest, rate.fastest) == (2, 1, 3)
    assert (duration.median, duration.slowest, duration.fastest) == (2, 3, 1)


def test_json_is_all_that_is_printed_and_names_machine_and_versions(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
):
    monkeypatch.setattr(speed, "measure", lambda plan: iter([LINE]))
    assert speed.speed(as_json=True, quick=True, out=tmp_path / "speed.json") == 0
    text = capsys.readouterr().out
    assert (tmp_path / "speed.json").read_text() == text
    found = json.loads(text)
    assert found["measurements"][0]["median"] == 1234.5
    assert set(found["machine"]) == {"cpu", "cores", "memory_gib", "system"}
    assert {"torch", "numba", "python", "thalweg"} <= set(found["versions"])


def test_a_row_names_everything_that_a_figure_depends_on():
    found = record([LINE])
    (row,) = table_rows(found)
    assert row == ["render", "1,234", "988", "1,400", "frames/s", "16", "4", "128x128", "everything drawn"]
    assert len(row) == len(COLUMNS)
    console = Console(record=True, width=200, file=open("/dev/null", "w"))  # noqa: SIM115
    speed.print_table(found, console)
    shown = console.export_text()
    assert "everything drawn" in shown
    assert f"{found['machine']['cores']} cores" in describe(found)
