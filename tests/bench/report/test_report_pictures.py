"""Tests of a report with all its figures: which files there are, and that the page loads nothing from elsewhere."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from tests.bench.small_backend import SUITE, SmallBackend, write_film_of
from thalweg.bench.evaluate.conditions import Condition
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.report.figures import failure_bars, fix_layout, pdf, png, training_curves
from thalweg.bench.report.report import write_report
from thalweg.bench.results.reading import read_results
from thalweg.bench.suite.builtin import suite_named


@pytest.mark.slow
def test_the_page_loads_nothing_but_the_film_beside_it(tiny_results: Path):
    write_film_of(tiny_results)
    page = write_report(tiny_results).page.read_text()
    sources = re.findall(r"""(?:src|href|poster|action|data)\s*=\s*['"]([^'"]*)""", page)
    inside = [source for source in sources if source.startswith("data:")]
    assert len(inside) == 5  # icon, levels, curves, failures, profiles
    anchors = [source for source in sources if source.startswith("#")]
    assert {*sources} - {*inside} - {*anchors} == {"film.mp4"}
    assert all(f"id='{anchor[1:]}'" in page for anchor in anchors)
    assert not re.search(r"https?://|@import|url\(", page)


@pytest.mark.slow
def test_every_picture_of_the_page_has_words_beside_it(tiny_results: Path):
    page = write_report(tiny_results).page.read_text()
    assert len(re.findall(r"<img [^>]*alt='[^']{20,}'", page)) == page.count("<img ") == 4


@pytest.mark.slow
def test_a_report_is_written_to_the_working_directory_and_can_be_replaced(
    tiny_results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    for _ in range(2):
        assert write_report(tiny_results, Path()).page.read_text().startswith("<!doctype html>")
        tables = ("table", "details", "limits", "methods", "runs")
        names = {f"{name}.{kind}" for name in tables for kind in ("md", "tex", "csv")}
        pictures = ("levels", "failures", "curves", "profiles")
        names |= {f"{name}.{kind}" for name in pictures for kind in ("png", "pdf")} | {"report.html"}
        assert {file.name for file in here.iterdir()} == names
        assert Path().stat().st_ino == here.stat().st_ino  # still the folder that one stands in


@pytest.mark.slow
def test_the_suite_of_the_learning_curves_makes_its_report_of_one_level(tmp_path: Path):
    suite = replace(suite_named("easy"), episodes=SUITE.episodes)
    report = run_suite(suite, tmp_path, SmallBackend()).report
    results = read_results(tmp_path)
    figure = training_curves(results)
    assert figure is not None
    assert [line.get_label() for line in figure.axes[0].lines] == ["PPO (3 seeds)", "FOCOPS (3 seeds)"]
    (bars,) = failure_bars(results).axes
    assert [label.get_text() for label in bars.get_yticklabels()] == [*suite.baselines, "PPO", "FOCOPS"]
    assert report.table.read_text().startswith("| policy | seeds | Easy return | Easy cost | critics see |\n")
    assert "on Easy, start" in (tmp_path / "film.txt").read_text()
    assert report.page.read_text().count("<img ") == 5


@pytest.mark.slow
def test_the_page_of_twelve_algorithms_is_small(tmp_path: Path):
    """36 runs of 200,000 steps, with all their figures; films are not on the page."""
    study = Path(__file__).resolve().parents[3] / "benchmarks" / "privileged"
    page = write_report(study, tmp_path / "report").page
    text = page.read_text()
    assert page.stat().st_size < 2_000_000
    assert len(re.findall(r"<img src='data:image/(png|jpeg);", text)) == 8
    assert text.index("id='ranking'") < text.index("<img ") < text.index("id='table'")


@pytest.mark.slow
def test_the_page_of_the_whole_study_is_small(tmp_path: Path):
    """All arms of the suite under all its conditions; those that have not been run have the flights of FOCOPS."""
    study = read_results(Path(__file__).resolve().parents[3] / "benchmarks" / "paper", as_recorded=True)
    planned, suite = [arm.label for arm in suite_named("paper").arms], suite_named("paper").as_data()
    others = [name for name in planned if name not in {row.algorithm for row in study.episodes}]

    def with_others(rows: list[Any]) -> list[Any]:
        own = [row for row in rows if row.algorithm == "FOCOPS"]
        return [*rows, *(replace(row, algorithm=name) for name in others for row in own)]

    runs = [replace(row, run=f"{row.algorithm}-{row.seed}") for row in with_others(study.runs)]
    whole = replace(
        study,
        suite=study.suite | {"arms": suite["arms"]},
        runs=runs,
        episodes=with_others(study.episodes),
        training=with_others(study.training),
        condition_episodes={name: with_others(rows) for name, rows in study.condition_episodes.items()},
    )
    page = write_report(study.folder, tmp_path / "report", results=whole).page
    text = page.read_text()
    assert all(f">{name}<" in text for name in planned) and len(planned) == 17
    assert page.stat().st_size < 3_000_000


@pytest.mark.slow
def test_results_with_every_gap_are_drawn(tmp_path: Path):
    """Runs that failed, an algorithm that did in all of them, none packaged, conditions, a level without a river."""
    suite = replace(
        SUITE,
        arms=(*SUITE.arms, replace(SUITE.arms[0], algorithm="P3O")),
        packaged=True,
        conditions=(Condition("deterministic", deterministic=True), Condition("real", rivers=("Cam",))),
    )
    run_suite(suite, tmp_path, SmallBackend(broken=("FOCOPS-1", "P3O-0", "P3O-1", "packaged-0")))
    path = tmp_path / "evaluation" / "PPO-0-Hard.csv"
    (path.parent / "PPO-0-Delta.csv").write_text(path.read_text().replace(",Hard,", ",Delta,"))
    report = write_report(tmp_path)
    names = {"levels", "curves", "failures", "profiles", "conditions_grid", "map_easy", "map_medium", "map_hard"}
    assert {path.stem for path in report.folder.glob("*.png")} == names
    assert len([line for line in report.problems if line.startswith("Run ")]) == 3


def test_a_fixed_layout_is_the_same_in_each_file():
    figure = Figure(layout="constrained")
    axis = figure.subplots()
    axis.set_ylabel("a label\nof three\nlines")
    fix_layout(figure)
    before = axis.get_position().bounds
    assert before[0] > 0.1
    png(figure)
    pdf(figure)
    assert axis.get_position().bounds == before
