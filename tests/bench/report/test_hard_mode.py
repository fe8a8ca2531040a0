"""Tests that reports name the end of an episode by the first cost of its task, in results of the hard mode only."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from tests.env import handmade
from thalweg.bench.evaluate.episodes import FIRST_COST, REASON_TEXT, REASONS
from thalweg.bench.report.failure_maps import failure_maps
from thalweg.bench.report.figures import REASON_COLOURS, failure_bars
from thalweg.bench.report.html.page import page
from thalweg.bench.report.result_tables import detail_table, paper_table
from thalweg.bench.report.sections import SECTIONS, FigureSection
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import summarise

(FAILURES,) = (each for each in SECTIONS if isinstance(each, FigureSection) and each.name == "failures")


@pytest.fixture
def hard(tiny_results: Path) -> Results:
    """Results in which one of the two flights of PPO on Medium ended by a cost."""
    path = tiny_results / "evaluation" / "PPO-0-Medium.csv"
    path.write_text(path.read_text().replace("OutOfVolumeHorizontal", FIRST_COST))
    return read_results(tiny_results)


def test_the_bars_name_it(hard: Results):
    _, medium = failure_bars(hard).axes
    bars = {bars.get_label(): bars for bars in medium.containers}
    assert list(bars) == [REASON_TEXT[reason] for reason in (*REASONS, FIRST_COST)]
    of_cost = bars["incurred a cost"]
    assert [bar.get_width() for bar in of_cost] == [0, 0.5]
    assert sum(bar.get_width() for each in bars.values() for bar in each[1:]) == 1.0


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("River", "Yellow to grey: loose ones, cost 0.2."),
        ("Nests", "Grey: the deadline, which costs nothing. Purple: ended by the first cost of the task."),
    ],
)
def test_the_note_says_which_colours_cost(task: str, words: str, hard: Results):
    assert f"{words}</p>" in page(replace(hard, suite=hard.suite | {"task": task}), [FAILURES], {}, {}, [])


def test_the_note_names_no_end_by_a_cost_where_there_is_none(tiny_results: Path):
    results = read_results(tiny_results)
    found = page(replace(results, suite=results.suite | {"task": "Nests"}), [FAILURES], {}, {}, [])
    assert "Grey: the deadline, which costs nothing.</p>" in found


def test_the_tables_count_it(hard: Results):
    rows = list(csv.DictReader(paper_table(hard).csv.splitlines()))
    counts = {row["level"]: row[FIRST_COST] for row in rows if row["policy"] == "PPO" and row["source"] == "thalweg"}
    assert counts == {"Easy": "0", "Medium": "1"}
    details = detail_table(hard)
    assert "ended by a cost" in details.text.columns
    shares = [float(row["cost_incurred"]) for row in csv.DictReader(details.csv.splitlines()) if row["policy"] == "PPO"]
    assert shares == [0.0, 0.5]


def test_the_map_marks_it(hard: Results):
    rows = [replace(row, end_x=1.0, end_y=2.0, end_z=5.0) for row in hard.episodes]
    figure = failure_maps(replace(hard, episodes=rows), "Medium", handmade.ring())
    assert figure is not None
    assert figure.legends[0].get_texts()[-1].get_text() == "incurred a cost"
    dots = figure.axes[0].collections[-1]
    assert dots.get_offsets().tolist() == [[1.0, 2.0]]  # pyright: ignore[reportAttributeAccessIssue]


def test_a_suite_in_hard_mode_names_it_even_if_no_flight_ended_so(tiny_results: Path):
    results = read_results(tiny_results)
    assert replace(results, suite={**results.suite, "hard": True}).reasons == (*REASONS, FIRST_COST)


def test_results_of_the_paper_do_not_name_it(tiny_results: Path):
    results = read_results(tiny_results)
    assert results.reasons == REASONS
    assert FIRST_COST not in paper_table(results).csv.splitlines()[0].split(",")
    assert "ended by a cost" not in detail_table(results).text.columns
    assert "incurred a cost" not in [each.get_label() for each in failure_bars(results).axes[0].containers]


def test_each_reason_has_a_colour_of_its_own():
    assert len(set(REASON_COLOURS.values())) == len(REASON_COLOURS) == len(REASONS) + 1


def test_a_summary_counts_each_end(hard: Results):
    rows = [row for row in hard.episodes if row.level == "Medium"]
    assert {name: count for name, count in summarise(rows).reasons.items() if count} == {
        "YawOverDeviation": 1,
        FIRST_COST: 1,
    }
