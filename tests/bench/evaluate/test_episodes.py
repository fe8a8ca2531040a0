"""Tests of tables of episodes: rows survive, and values that are none are refused with line and column."""

from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import END_COLUMNS, Episode, read_episodes, write_episodes
from thalweg.bench.results.curve import read_training
from thalweg.bench.results.results import RunRow, read_runs, write_runs

START = (0.0, 0.0, 5.0, 0.1)
ROW = Episode("PPO", 0, "Easy", 1, 0, *START, 9.5, 0.2, 0.0, 0.2, 120, "Idle", False, 0.95)
RUN = RunRow("PPO-0", "train", "PPO", 0, 400, "finished", "", 1.0, 400.0)


def changed(path: Path, column: str, value: str) -> None:
    """Put a value into the second row of a table."""
    header, first, second = path.read_text().splitlines()
    values = second.split(",")
    values[header.split(",").index(column)] = value
    path.write_text("\n".join([header, first, ",".join(values)]) + "\n")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_episodes(tmp_path / "PPO-0-Easy.csv", [ROW, ROW])
    return tmp_path / "PPO-0-Easy.csv"


def test_rows_survive_and_may_lack_the_end(path: Path):
    rows = read_episodes(path)
    assert list(map(repr, rows)) == [repr(ROW)] * 2  # NaN equals nothing
    assert {name: repr(getattr(rows[1], name)) for name in END_COLUMNS} == dict.fromkeys(END_COLUMNS, "nan")


@pytest.mark.parametrize("column", ["x", "yaw", "return", "cost", "tight", "loose", "progress"])
@pytest.mark.parametrize("value", ["nan", "-inf", "1e999"])
def test_a_number_that_is_not_finite_is_refused_with_its_column(column: str, value: str, path: Path):
    changed(path, column, value)
    with pytest.raises(ResultsError, match=rf"PPO-0-Easy\.csv line 3: {column}: a finite number is needed, got"):
        read_episodes(path)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("success", "7", "success: 0 or 1 is needed, got '7'"),
        ("length", "1.5", "length: invalid literal"),
        ("seed", "9" * 5000, "seed: Exceeds the limit"),
        ("reason", "Bored", "unknown reason 'Bored'"),
    ],
)
def test_a_value_of_another_kind_is_refused(column: str, value: str, words: str, path: Path):
    changed(path, column, value)
    with pytest.raises(ResultsError, match=f"line 3: {words}"):
        read_episodes(path)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("10,nan,0.0,0.0", "a finite number is needed, got 'nan'"),
        ("1e300,1.0,0.0,0.0", r"step must be a whole number from 0 to 1e\+15, got 1e\+300"),
        ("-1,1.0,0.0,0.0", "step must be a whole number"),
        ("2.5,1.0,0.0,0.0", "step must be a whole number"),
    ],
)
def test_a_curve_holds_whole_steps_and_finite_numbers(row: str, words: str, tmp_path: Path):
    path = tmp_path / "episodes.csv"
    path.write_text(f"step,return,tight,loose\n{row}\n")
    with pytest.raises(ResultsError, match=rf"episodes\.csv: {words}"):
        read_training(path, RUN)


def test_the_times_of_runs_are_finite(tmp_path: Path):
    write_runs(tmp_path, [RUN, RUN])
    changed(tmp_path / "runs.csv", "wall_s", "nan")
    with pytest.raises(ResultsError, match=r"runs\.csv: a finite number is needed, got 'nan'"):
        read_runs(tmp_path)
