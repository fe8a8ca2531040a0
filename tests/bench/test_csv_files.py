"""Tests of the CSV files of results: what is written reads back, and what is no table is refused by name."""

from pathlib import Path

import pytest

from thalweg.bench.csv_files import ResultsError, csv_text, finite, read_csv
from thalweg.bench.results.results import RunRow, read_runs, runs_text


def test_line_breaks_and_commas_inside_a_value_survive(tmp_path: Path):
    path = tmp_path / "runs.csv"
    path.write_text(csv_text(["run", "error"], [["a", "one,\ntwo \u2028 three"], ["b", ""]]))
    assert read_csv(path, ["run"]) == [{"run": "a", "error": "one,\ntwo \u2028 three"}, {"run": "b", "error": ""}]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"a,b\n1,\xff\n", "is not text"),
        (b"a,c\n1,2\n", "lacks the column b"),
        (b"a,b\n1,2", "is half-written"),
        (b"a,b\n1\n", "line 2 has not as many values"),
        (b"a,b,a\n1,2,3\n", "has the column a twice"),
        (b"a,b\n1," + b"x" * 200_000 + b"\n", "is not CSV: field larger than field limit"),
    ],
)
def test_what_is_no_such_table_is_refused_by_name(content: bytes, words: str, tmp_path: Path):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=f"table.csv {words}"):
        read_csv(path, ["a", "b"])


def test_a_number_is_finite():
    assert finite("-1.5e3") == -1500.0
    for text in ("nan", "-inf", "1e999"):
        with pytest.raises(ValueError, match=f"a finite number is needed, got '{text}'"):
            finite(text)


@pytest.mark.parametrize("name", ["x" * 201, "", "../PPO-0"])
def test_a_run_whose_name_cannot_be_that_of_its_folder_is_refused(name: str, tmp_path: Path):
    (tmp_path / "runs.csv").write_text(runs_text([RunRow("PPO-0", "train", "PPO", 0, 400, "finished")]))
    assert [row.run for row in read_runs(tmp_path)] == ["PPO-0"]
    (tmp_path / "runs.csv").write_text(runs_text([RunRow(name, "train", "PPO", 0, 400, "finished")]))
    with pytest.raises(ResultsError, match=r"runs\.csv: the run '.*' must have a name of 1 to 200 characters"):
        read_runs(tmp_path)
