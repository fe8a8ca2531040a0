"""Tests of the films of a report: linked files by default, parts of the page on request."""

import re
from pathlib import Path

import pytest

from tests.bench.small_backend import write_film_of
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.report.films import is_film
from thalweg.bench.report.report import write_report
from thalweg.bench.results.reading import read_results

pytestmark = pytest.mark.usefixtures("no_pictures")
LARGE = 4_000_000
NAMES = ("film", "films/PPO-best", "films/PPO-failure")


@pytest.fixture
def filmed(tiny_results: Path) -> Path:
    """Results with three films of four megabytes and their posters."""
    for name in NAMES:
        write_film_of(tiny_results, name)
        (tiny_results / f"{name}.mp4").write_bytes(name.encode().ljust(LARGE, b"\0"))
        (tiny_results / f"{name}.jpg").write_bytes(name.encode())
    return tiny_results


def sources(page: Path) -> list[str]:
    """What the films of a page and their posters are loaded from, the film first."""
    films = re.findall(r"<video [^>]*?poster='([^']*)'[^>]*? src='([^']*)'", page.read_text())
    return [source for poster, film in films for source in (film, poster)]


def test_films_are_linked_and_lie_beside_the_page(filmed: Path, tmp_path: Path):
    report = write_report(filmed, tmp_path / "elsewhere")
    assert sources(report.page) == [f"{name}{end}" for name in NAMES for end in (".mp4", ".jpg")]
    for source in sources(report.page):
        assert (report.folder / source).read_bytes() == (filmed / source).read_bytes()
    assert report.page.stat().st_size < 100_000


def test_films_are_in_the_page_if_it_is_to_be_one_file(filmed: Path):
    linked = write_report(filmed)
    assert (linked.folder / "films").is_dir()
    report = write_report(filmed, inline_films=True)
    assert all(source.startswith("data:") for source in sources(report.page)) and len(sources(report.page)) == 6
    assert 3 * LARGE < report.page.stat().st_size < 5 * LARGE
    assert not (report.folder / "films").exists()
    assert report.film == report.folder / "film.mp4"


def test_the_film_of_a_policy_with_other_versions_has_an_address(filmed: Path):
    for end in (".mp4", ".jpg", ".txt"):
        (filmed / f"films/PPO-best{end}").rename(filmed / f"films/P O%-best{end}")
    runs = filmed / "runs.csv"
    runs.write_text(runs.read_text() + "P O%-0,baseline,P O%,0,0,finished,,0.0,0.0\n")
    report = write_report(filmed)
    assert "films/P%20O%25-best.mp4" in sources(report.page)
    assert (report.folder / "films" / "P O%-best.mp4").exists()


def test_a_film_without_its_poster_shows_its_first_frame(filmed: Path):
    (filmed / "film.jpg").unlink()
    page = write_report(filmed).page.read_text()
    assert "preload='metadata' src='film.mp4'" in page
    assert page.count("preload='none' poster=") == 2


def test_films_that_the_results_lack_are_removed_from_an_earlier_report(filmed: Path, tmp_path: Path):
    write_report(filmed, tmp_path / "out")
    for name in NAMES[1:]:
        (filmed / f"{name}.mp4").unlink()
    report = write_report(filmed, tmp_path / "out")
    assert sources(report.page) == ["film.mp4", "film.jpg"]
    assert not (report.folder / "films").exists() and (report.folder / "film.jpg").exists()


@pytest.mark.parametrize("name", ["films/holiday.mp4", "films/PPO-best/a.mp4", "film.txt", "films"])
def test_films_of_somebody_else_are_no_part_of_a_report(filmed: Path, tmp_path: Path, name: str):
    assert not is_film(name)
    out = tmp_path / "out"
    (out / name).parent.mkdir(parents=True)
    (out / name).write_bytes(b"years of work")
    with pytest.raises(ResultsError, match=rf"out holds {name.partition('/a')[0]}, which is no part of a report"):
        write_report(filmed, out)
    assert (out / name).read_bytes() == b"years of work"


def test_a_policy_whose_name_is_too_long_for_a_file_has_no_film(tiny_results: Path):
    runs = tiny_results / "runs.csv"
    runs.write_text(runs.read_text() + f"{'x' * 300}-0,baseline,{'x' * 300},0,0,finished,,0.0,0.0\n")
    assert read_results(tiny_results).films == {}
