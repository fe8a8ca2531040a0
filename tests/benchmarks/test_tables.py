"""Tests of the tables of measurements, and that scripts keep the rows that other commands wrote meanwhile."""

import importlib
import sys
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from thalweg.bench.csv_files import read_csv


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """Import of a script by its name."""
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[2] / "benchmarks")
    return importlib.import_module


@pytest.fixture
def tables(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("tables")


COLUMNS = ("a", "b")


def rows(*pairs: tuple[object, object]) -> list[dict[str, str]]:
    return [{"a": str(a), "b": str(b)} for a, b in pairs]


def test_rows_are_put_in_place_of_those_of_the_same_key(tables: ModuleType, tmp_path: Path):
    table = tmp_path / "table.csv"
    tables.put(table, COLUMNS, rows((2, 1), (2, 2), (1, 3)), ("a",))
    found = tables.put(table, COLUMNS, [{"a": 2, "b": 4}], ("a",))
    assert found == read_csv(table, COLUMNS) == rows((1, 3), (2, 4))


def test_rows_are_sorted_by_their_place(tables: ModuleType, tmp_path: Path):
    for number in (2, 3, 1):
        found = tables.put(tmp_path / "table.csv", COLUMNS, rows((number, 0)), ("a",), lambda row: int(row["a"]))
    assert found == rows((1, 0), (2, 0), (3, 0))


def test_the_last_row_of_each_key_is_kept(tables: ModuleType):
    assert tables.last_of_each(rows((1, 1), (2, 2), (1, 3)), ("a",)) == rows((1, 3), (2, 2))


def test_rows_of_other_versions_are_left_out(tables: ModuleType):
    assert tables.of_versions(rows((1, 1), (1, 2), (2, 1)), {"a": 1, "b": 1}) == rows((1, 1))


def write_meanwhile(script: ModuleType, table: Path, row: dict[str, Any]) -> None:
    """Append a row as another command does."""
    importlib.import_module("tables").append(table, script.COLUMNS, dict.fromkeys(script.COLUMNS, "0") | row)


def test_a_river_of_the_boat_that_another_command_ran_meanwhile_stays(
    script: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    boat, out = script("boat_pilot"), tmp_path / "table.csv"
    today = {name: str(number) for name, number in boat.VERSIONS.items()}

    def voyages(level: str, seeds: list[int]) -> list[dict[str, str]]:
        write_meanwhile(boat, out, today | {"level": "Medium-Deep", "seed": "9"})
        return [dict.fromkeys(boat.COLUMNS, "0") | today | {"level": level, "seed": str(seed)} for seed in seeds]

    monkeypatch.setattr(boat, "voyages", voyages)
    monkeypatch.setattr(sys, "argv", ["boat_pilot.py", "--levels", "Easy", "--seeds", "3", "--out", str(out)])
    boat.main()
    assert [(row["level"], row["seed"]) for row in read_csv(out, boat.COLUMNS)] == [("Easy", "3"), ("Medium-Deep", "9")]


@pytest.mark.parametrize(("name", "place"), [("fixed_failures", "student"), ("same_failures", "policy")])
def test_failures_that_another_command_found_meanwhile_stay(
    name: str, place: str, script: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    failures, out = script(name), tmp_path / "table.csv"

    def flights_of(*given: Any) -> list[dict[str, str]]:
        write_meanwhile(failures, out, {place: "other"})
        return [dict.fromkeys(failures.COLUMNS, "") | {place: "own"}]

    monkeypatch.setattr(failures, "flights_of", flights_of)
    monkeypatch.setattr(failures, "key_of", lambda *given: ())
    monkeypatch.setattr(failures, "policy_path", Path)
    monkeypatch.setattr(failures, "policy_named", lambda *given: None, raising=False)
    students = ["a", "b"][: 1 if name == "fixed_failures" else 2]
    policies = [] if name == "fixed_failures" else ["--policies", "first"]
    assert failures.main([*students, *policies, "--levels", "Hard", "--out", str(out)]) == 0
    assert [row[place] for row in read_csv(out, failures.COLUMNS)] == ["other", "own"]


def test_launches_that_another_command_counted_meanwhile_stay(
    script: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    launches, out = script("launches"), tmp_path / "table.csv"

    def count(name: str, num_envs: int, device: Any) -> tuple[float, float]:
        write_meanwhile(launches, out, {"algorithm": "CPO"})
        return 1.0, 2.0

    monkeypatch.setattr(launches, "count_operations", count)
    monkeypatch.setattr(sys, "argv", ["launches.py", "--only", "PPO", "--out", str(out)])
    assert launches.main() == 0
    assert [row["algorithm"] for row in read_csv(out, launches.COLUMNS)] == ["PPO", "CPO"]


class NoPool:
    """A pool that does its work at once, in this process."""

    def __init__(self, *_: Any) -> None: ...

    def __enter__(self) -> "NoPool":
        return self

    def __exit__(self, *_: object) -> None: ...

    def submit(self, function: Callable, case: Any) -> "Future[Any]":
        ended: Future[Any] = Future()
        ended.set_result(function(case))
        return ended


def test_poses_that_another_command_drew_meanwhile_stay(
    script: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    accuracy, out = script("reference_accuracy"), tmp_path / "reference_accuracy.csv"
    planned = [accuracy.Case(number, "Easy", (0.0, 0.0, 1.0, 0.0), 0.0) for number in (5, 6)]
    figures = {"psnr_db": "30", "mask": "1", "class": "1", "seconds": "1"}

    def drawn(case: Any) -> tuple[None, float]:
        other = planned[1].identity | figures
        importlib.import_module("tables").append(out, list(other), other)
        return None, 1.0

    for name, value in {
        "cases": lambda: planned, "draw": lambda _: None, "draw_reference": drawn, "show": lambda *_: None,
        "compare": lambda case, *_: case.identity | figures, "verdict": lambda rows: None,
        "ProcessPoolExecutor": NoPool, "as_completed": list,
    }.items():  # fmt: skip
        monkeypatch.setattr(accuracy, name, value)
    monkeypatch.setattr(sys, "argv", ["reference_accuracy.py", "--poses", "1", "--out", str(tmp_path)])
    assert accuracy.main() is None
    assert [row["number"] for row in read_csv(out, ("number",))] == ["5", "6"]
