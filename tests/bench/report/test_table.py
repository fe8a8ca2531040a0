"""Tests of the renderings of tables."""

import csv
from pathlib import Path

import pytest

from thalweg.bench.report.report import write_report
from thalweg.bench.report.table import PAPER, escape_latex, frame, latex, markdown, numeric_columns, table_from_cells
from thalweg.bench.results.inference import Proportion


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("83% [70, 92]", r"83\% [70, 92]"),
        ("P3O_paper & #1 $x {y}", r"P3O\_paper \& \#1 \$x \{y\}"),
        (r"a\b~c^d", r"a\textbackslash{}b\textasciitilde{}c\textasciicircum{}d"),
        ("8.30 ± 3.39", r"8.30 $\pm$ 3.39"),
        ("p < 0.01 | −2", r"p \textless{} 0.01 \textbar{} $-$2"),
        ("[1, 2]", "{[}1, 2]"),
        ("*best*", "{*}best*"),
        ("", ""),
    ],
)
def test_characters_that_latex_would_not_print_are_escaped(text: str, expected: str):
    assert escape_latex(text) == expected


def test_latex_is_a_booktabs_tabular_with_published_rows_in_italics():
    rows = [["PPO", "Easy", "9.00 ± 1.00"], [f"PPO ({PAPER})", "Easy", "9.19 ± 2.63"], ["a_b", "Easy", "failed"]]
    assert latex(frame(["policy", "level", "return"], rows)).splitlines() == [
        r"% Needs \usepackage{booktabs}.",
        r"\begin{tabular}{llr}",
        r"\toprule",
        r"policy & level & return \\",
        r"\midrule",
        r"PPO & Easy & 9.00 $\pm$ 1.00 \\",
        r"\quad \textit{PPO (paper, another simulator)} & \textit{Easy} & \textit{9.19 $\pm$ 2.63} \\",
        r"a\_b & Easy & failed \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("name", ["table", "details", "runs"])
def test_every_row_of_a_tabular_has_as_many_cells_as_columns(tiny_results: Path, name: str):
    text = (write_report(tiny_results).folder / f"{name}.tex").read_text()
    lines = text.splitlines()
    columns = len(lines[1].removeprefix(r"\begin{tabular}{").removesuffix("}"))
    rows = [line for line in lines if line.endswith(r"\\")]
    markdown = (tiny_results / "report" / f"{name}.md").read_text().splitlines()
    assert len(rows) == len(markdown) - 1
    assert {row.replace(r"\&", "").count(" & ") + 1 for row in rows} == {columns}


def test_a_column_is_numeric_where_a_cell_begins_with_a_number():
    rows = [["1-PPO", "Easy", "missing", "0 of 1", "failed"], ["hover", "2 rivers", "< 0.01", "−3", "absent"]]
    assert numeric_columns(frame(["policy", "level", "p", "seeds", "return"], rows)) == [False, True, True, True, False]


def test_cells_have_a_text_for_people_and_figures_for_programs():
    table = table_from_cells(("name", "share", "hours"), [["a", Proportion(2 / 3, 0.5, 0.75), 1 / 3], ["b", "none", 2]])
    assert table.text.to_numpy().tolist() == [["a", "67% [50, 75]", "0.33"], ["b", "none", "2"]]
    assert list(csv.reader(table.csv.splitlines())) == [
        ["name", "share", "share, low", "share, high", "hours"],
        ["a", repr(2 / 3), "0.5", "0.75", repr(1 / 3)],
        ["b", "none", "", "", "2"],
    ]


def test_a_table_without_rows_has_its_columns():
    table = table_from_cells(("name", "share"), [])
    assert table.text.empty and table.csv == "name,share\n"


def test_markdown_escapes_the_sign_that_separates_cells():
    assert markdown(frame(["a|b", "c"], [["1", "x|y"]])) == "| a\\|b | c |\n| --- | --- |\n| 1 | x\\|y |\n"
