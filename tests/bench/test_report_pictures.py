"""The report with all its pictures: what is there, and that it needs nothing from elsewhere."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.bench.small_place import SUITE, SmallPlace, write_film_of
from thalweg.bench.figures import failure_bars, training_curves
from thalweg.bench.reading import read_results
from thalweg.bench.report import write_report
from thalweg.bench.runner import run_suite
from thalweg.bench.suites import suite_named


def test_the_page_loads_nothing_from_elsewhere(tiny_results: Path):
    write_film_of(tiny_results)
    page = write_report(tiny_results).page.read_text()
    sources = re.findall(r"""(?:src|href|poster|action|data)\s*=\s*['"]([^'"]*)""", page)
    assert len(sources) == 6  # icon, film, levels, curves, failures, profiles
    assert all(source.startswith("data:") for source in sources)
    assert not re.search(r"https?://|@import|url\(", page)


def test_every_picture_of_the_page_has_words_beside_it(tiny_results: Path):
    page = write_report(tiny_results).page.read_text()
    assert len(re.findall(r"<img [^>]*alt='[^']{20,}'", page)) == page.count("<img ") == 4


def test_a_report_goes_to_the_folder_one_stands_in_and_again(
    tiny_results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    for _ in range(2):
        assert write_report(tiny_results, Path()).page.read_text().startswith("<!doctype html>")
        names = {f"{name}.{kind}" for name in ("table", "details", "limits", "runs") for kind in ("md", "tex", "csv")}
        pictures = ("levels", "failures", "curves", "profiles")
        names |= {f"{name}.{kind}" for name in pictures for kind in ("png", "pdf")} | {"report.html"}
        assert {file.name for file in here.iterdir()} == names
        assert Path().stat().st_ino == here.stat().st_ino  # still the folder that one stands in


def test_the_suite_of_the_learning_curves_makes_its_report_of_one_level(tmp_path: Path):
    suite = replace(suite_named("easy"), episodes=SUITE.episodes)
    report = run_suite(suite, tmp_path, SmallPlace()).report
    results = read_results(tmp_path)
    figure = training_curves(results)
    assert figure is not None
    assert [line.get_label() for line in figure.axes[0].lines] == ["PPO (3 seeds)", "FOCOPS (3 seeds)"]
    (bars,) = failure_bars(results).axes
    assert [label.get_text() for label in bars.get_yticklabels()] == [*suite.baselines, "PPO", "FOCOPS"]
    assert report.table.read_text().startswith("| policy | Easy return | Easy cost |\n")
    assert "on Easy, start" in (tmp_path / "film.txt").read_text()
    assert report.page.read_text().count("<img ") == 5
