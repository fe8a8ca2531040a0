"""Tests of the fuzzing: valid samples are read, silent and foreign errors are failures, finished pieces are skipped."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

KINDS = (
    *("geojson", "overpass", "gpx", "kml", "world", "suite", "run config", "run status"),
    *("checkpoint arrays", "checkpoint state", "policy", "encoder", "flight", "suite record", "versions", "runs"),
    *("episodes", "training", "curve"),
    *("run settings", "metrics", "episode log", "encoder checkpoint", "geometry checkpoint", "finder of water"),
    *("cached maps", "plug-in", "exported policy", "fronts", "study measures", "probes", "verified curve"),
    *("verified flights", "report: suite", "report: runs", "report: versions", "report: flights", "report: curve"),
    *(
        "lerobot description",
        "lerobot info",
        "lerobot table",
        "minari metadata",
        "minari data",
        "lerobot draft",
        "lerobot draft's flight",
        "minari draft",
        "minari draft's flight",
        "video",
    ),
    "calibration",
)
SLOW = ("exported policy", "encoder checkpoint", "geometry checkpoint", "video")
"""Kinds of which a test takes seconds."""
PARAMETERS = [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else []) for name in KINDS]


@pytest.fixture
def fuzz(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("fuzz")


def test_every_kind_is_listed(fuzz: ModuleType):
    assert tuple(fuzz.KINDS) == KINDS


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_sample_is_read_without_mutation(name: str, fuzz: ModuleType, tmp_path: Path):
    kind = fuzz.KINDS[name]
    samples = kind.samples(tmp_path)
    for content in samples:
        (tmp_path / kind.file).write_bytes(content)
        assert fuzz.outcome(kind, tmp_path / kind.file) == ("read", "")
    assert samples


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_few_mutated_files_of_every_kind_are_read_or_refused(name: str, fuzz: ModuleType):
    tally = fuzz.fuzz(name, 0, 8)
    assert tally.failures == [] and tally.read + tally.refused == 8


@pytest.mark.parametrize(
    ("read", "result"),
    [
        (lambda path: 1.5, ("read", "")),
        (lambda path: {"a": [np.zeros(2), float("nan")]}, ("failed", "silent: it.a[1] is nan")),
        (lambda path: np.array([np.inf]), ("failed", "silent: it holds a number that is not finite")),
        (lambda path: "\ud800", ("failed", "silent: it is text that cannot be written: '\\ud800'")),
        (lambda path: {}["key"], ("failed", "KeyError: 'key'")),
    ],
)
def test_what_a_reader_does_is_judged(read: Callable, result: tuple[str, str], fuzz: ModuleType, tmp_path: Path):
    kind = replace(fuzz.KINDS["runs"], read=read)
    assert fuzz.outcome(kind, tmp_path / "runs.csv") == result


@pytest.mark.parametrize(("message", "result"), [("runs.csv: no", "refused"), ("no", "failed")])
def test_an_error_must_name_the_file(message: str, result: str, fuzz: ModuleType, tmp_path: Path):
    def refuse(path: Path) -> None:
        raise fuzz.KINDS["runs"].errors[0](message)

    kind = replace(fuzz.KINDS["runs"], read=refuse)
    assert fuzz.outcome(kind, tmp_path / "runs.csv")[0] == result


@pytest.mark.parametrize("name", ["report: runs", "report: versions", "report: flights", "report: curve"])
def test_a_file_that_a_report_leaves_out_is_refused(name: str, fuzz: ModuleType, tmp_path: Path):
    kind = fuzz.KINDS[name]
    kind.samples(tmp_path)
    (tmp_path / kind.file).write_bytes(b"\xff")
    result, why = fuzz.outcome(kind, tmp_path / kind.file)
    assert (result, kind.file in why) == ("refused", True), why


def test_a_row_names_the_commit_of_the_code(fuzz: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fuzz, "fuzz", lambda *given: fuzz.Tally(read=given[2]))
    monkeypatch.setattr(fuzz, "bound_memory", lambda: None)
    monkeypatch.setattr(fuzz.subprocess, "run", lambda *_, **__: SimpleNamespace(stdout="2026-11-30 abc\n"))
    table = tmp_path / "fuzz.csv"
    monkeypatch.setattr("sys.argv", ["fuzz.py", "--kinds", "runs", "--pieces", "1", "--out", str(table)])
    assert fuzz.main() == 0 and table.read_text().endswith(",2026-11-30 abc\n")


def test_a_finished_piece_is_skipped_and_one_with_failures_is_run_again(
    fuzz: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    fuzzed: list[str] = []
    outcomes = {"runs": ["0: KeyError"], "episodes": []}

    def fuzz_one(name: str, piece: int, files: int, kept: Path | None):
        fuzzed.append(name)
        return fuzz.Tally(read=files - len(outcomes[name]), failures=outcomes[name])

    monkeypatch.setattr(fuzz, "fuzz", fuzz_one)
    monkeypatch.setattr(fuzz, "bound_memory", lambda: None)
    command = ["fuzz.py", "--kinds", "runs", "episodes", "--pieces", "1", "--out", str(tmp_path / "fuzz.csv")]
    monkeypatch.setattr("sys.argv", command)
    assert fuzz.main() == 1
    outcomes["runs"] = []
    assert fuzz.main() == 0
    assert fuzz.main() == 0
    assert fuzzed == ["runs", "episodes", "runs"]
    lines = (tmp_path / "fuzz.csv").read_text().splitlines()
    assert lines[0] == "kind,piece,files,read,refused,failed,slowest_s,commit"
    rows = sorted(line.rsplit(",", 2)[0] for line in lines[1:])
    assert rows == ["episodes,0,1000,1000,0,0", "runs,0,1000,1000,0,0"]


def test_no_more_files_are_read_than_the_whole_has(fuzz: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    fuzzed: list[tuple[str, int]] = []

    def fuzz_one(name: str, piece: int, files: int, kept: Path | None):
        fuzzed.append((name, piece))
        return fuzz.Tally(read=files)

    for name, wanted in (("runs", 3000), ("versions", 1000)):
        monkeypatch.setitem(fuzz.KINDS, name, replace(fuzz.KINDS[name], wanted=wanted))
    monkeypatch.setattr(fuzz, "fuzz", fuzz_one)
    monkeypatch.setattr(fuzz, "bound_memory", lambda: None)
    monkeypatch.setattr("sys.argv", ["fuzz.py", "--kinds", "versions", "runs", "--out", str(tmp_path / "fuzz.csv")])
    assert fuzz.main() == 0
    assert fuzzed == [("versions", 0), ("runs", 0), ("runs", 1), ("runs", 2)]


def test_every_kind_asks_for_whole_pieces(fuzz: ModuleType):
    assert all(kind.wanted > 0 and kind.wanted % fuzz.FILES == 0 for kind in fuzz.KINDS.values())
