from pathlib import Path

import pytest

from thalweg.bench.report.latex import escaped, latex
from thalweg.bench.report.report import write_report
from thalweg.bench.report.tables import ELSEWHERE


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
def test_signs_that_latex_reads_otherwise_are_escaped(text: str, expected: str):
    assert escaped(text) == expected


def test_a_table_is_a_tabular_with_rules_and_published_rows_in_italics():
    rows = [["PPO", "Easy", "9.00 ± 1.00"], [f"PPO ({ELSEWHERE})", "Easy", "9.19 ± 2.63"], ["a_b", "Easy", "failed"]]
    assert latex(["policy", "level", "return"], rows).splitlines() == [
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
def test_every_row_of_a_report_has_as_many_cells_as_its_tabular_has_columns(tiny_results: Path, name: str):
    text = (write_report(tiny_results).folder / f"{name}.tex").read_text()
    lines = text.splitlines()
    columns = len(lines[1].removeprefix(r"\begin{tabular}{").removesuffix("}"))
    rows = [line for line in lines if line.endswith(r"\\")]
    markdown = (tiny_results / "report" / f"{name}.md").read_text().splitlines()
    assert len(rows) == len(markdown) - 1
    assert {row.replace(r"\&", "").count(" & ") + 1 for row in rows} == {columns}
