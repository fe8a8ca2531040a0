"""The page of a report as a reader has it: in a browser, without a network, by mouse and by keyboard, on a phone."""

import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bench.versioned import record_current_versions
from tests.browser import Browser
from thalweg.bench.report.report import write_report
from thalweg.bench.report.table import PAPER
from thalweg.core.video import write_video

pytestmark = pytest.mark.browser
HERE = Path(__file__).parent
RUNS = """FOCOPS-0,train,FOCOPS,0,90,failed,NaN,1.0,90.0
P3O-2,train,P3O,2,1234567,finished,,5000.0,1046.5
P3O-10,train,P3O,10,20000,finished,,50.0,400.0
"""
PUBLISHED = {name: f"{name} ({PAPER})" for name in ("PPO", "FOCOPS", "P3O")}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the tiny results with a failed algorithm, one of long runs that flies every round with three seeds
    (only the flights are known of one), and films."""
    folder = Path(shutil.copytree(HERE.parent / "tiny_results", tmp_path_factory.mktemp("page") / "results"))
    runs, flown = folder / "runs.csv", (folder / "evaluation" / "PPO-0-Easy.csv").read_text()
    runs.write_text(runs.read_text() + RUNS)
    for run in ("P3O-2", "P3O-10", "P3O-11"):
        shutil.copytree(folder / "runs" / "PPO-0", folder / "runs" / run)
        rows = flown.replace("PPO,0", run.replace("-", ",")).replace(",4.0,1.0,1.0,0.0,120,Collision,0,0.4", ",10.0,")
        rows = rows.replace(",10.0,\n", ",10.0,0.0,0.0,0.0,300,Success,1,1.0\n")
        (folder / "evaluation" / f"{run}-Easy.csv").write_text(rows)
    (folder / "films").mkdir()
    for name in ("film", "films/PPO-best", "films/P3O-best"):
        write_video(folder / f"{name}.mp4", [np.full((256, 384, 3), 99, np.uint8)] * 4, fps=4, crf=18)
        (folder / f"{name}.txt").write_text("The best of all flights there.\n")
    record_current_versions(folder, seeds=12)
    return write_report(folder).page


SEEN = """
const table = document.querySelector(`.wide[aria-label='${arguments[0]}'] table`);
const seen = (parts) => [...parts].filter((part) => part.checkVisibility());
return seen(table.rows).map((row) => seen(row.cells).map((cell) => cell.textContent))
"""


def rows(browser: Browser, title: str) -> list[list[str]]:
    """The cells of a table that are to be seen, row by row, heads aside."""
    return browser.run(SEEN, title)[1:]


def column(browser: Browser, title: str, name: str) -> list[str]:
    """What is to be seen in a column of a table, from above."""
    heads, *others = browser.run(SEEN, title)
    return [row[heads.index(name)] for row in others]


def head(browser: Browser, title: str, name: str) -> Any:
    """The head of a column of a table."""
    heads = browser.driver.find_elements("css selector", f".wide[aria-label='{title}'] thead th")
    (found,) = (each for each in heads if each.get_property("textContent") == name)
    return found


def sort_by(browser: Browser, title: str, name: str) -> str | None:
    """Click on the head of a column; returns how the column says that it is sorted."""
    found = head(browser, title, name)
    browser.run("arguments[0].scrollIntoView({block: 'center'})", found)
    found.click()
    return found.get_attribute("aria-sort")


def filter_by(browser: Browser, **words: str) -> str:
    """Type into the fields of the form what they are to hold; returns what it says of the number of rows."""
    for name, text in words.items():
        browser.press("CONTROL", "a", "NULL", "BACKSPACE", text, on=browser.driver.find_element("name", name))
    return browser.run("return document.forms.filter.elements.count.value")


@pytest.mark.slow
def test_the_page_loads_its_films_without_complaints_and_asks_nobody_for_anything_else(browser: Browser, page: Path):
    assert browser.complaints() == browser.requests() == []
    browser.open(page)
    played = "return [...document.querySelectorAll('video')].map((film) => film.error === null && film.videoWidth)"
    end = time.monotonic() + 20
    while browser.run(played) != [384] * 3 and time.monotonic() < end:
        time.sleep(0.05)
    assert browser.run(played) == [384] * 3
    asked = browser.requests()
    assert page.as_uri() in asked
    films = [(page.parent / f"{name}.mp4").as_uri() for name in ("film", "films/PPO-best", "films/P3O-best")]
    assert {url for url in asked if url != page.as_uri() and not url.startswith("data:")} == {*films}
    assert browser.complaints() == []


def test_numbers_sort_as_numbers_both_ways_and_words_go_last(browser: Browser, page: Path):
    browser.open(page)
    before, numbers = column(browser, "Runs", "steps"), ["90", "300", "400", "20,000", "1,234,567"]
    orders = {sort_by(browser, "Runs", "steps"): column(browser, "Runs", "steps") for _ in range(3)}
    assert orders == {
        "ascending": [*numbers, "not trained"],
        "descending": [*numbers[::-1], "not trained"],
        None: before,
    }


def test_numbers_with_intervals_and_deviations_sort_by_what_leads_them(browser: Browser, page: Path):
    browser.open(page)
    sort_by(browser, "In detail", "success")
    shares = ["0%", "0%", "50%", "100% [61, 100]"]  # of six flights
    assert column(browser, "In detail", "success") == [*shares, "missing", "failed", "failed", "missing"]
    assert [sort_by(browser, "Return and cost", "Easy return") for _ in range(2)][-1] == "descending"
    ours = [row[2] for row in rows(browser, "Return and cost") if PAPER not in row[0]]
    assert ours == ["10.00 ± 0.00", "7.00 ± 3.00", "0.05 ± 0.00", "failed"]


def test_columns_of_words_sort_by_the_alphabet_and_runs_by_their_numbers(browser: Browser, page: Path):
    browser.open(page)
    sort_by(browser, "Runs", "run")
    assert column(browser, "Runs", "run") == ["FOCOPS-0", "hover-0", "P3O-2", "P3O-10", "PPO-0", "PPO-1"]
    sort_by(browser, "Runs", "status")
    assert column(browser, "Runs", "status") == ["failed"] * 2 + ["finished"] * 4
    assert head(browser, "Runs", "run").get_attribute("aria-sort") is None


def test_published_rows_stay_below_their_own(browser: Browser, page: Path):
    browser.open(page)
    groups = [["FOCOPS", PUBLISHED["FOCOPS"]], ["hover"], ["P3O", PUBLISHED["P3O"]], ["PPO", PUBLISHED["PPO"]]]
    for order in (groups, groups[::-1]):
        sort_by(browser, "Return and cost", "policy")
        assert column(browser, "Return and cost", "policy") == [name for group in order for name in group]


def test_heads_are_reached_and_sort_by_keyboard(browser: Browser, page: Path):
    browser.open(page)
    browser.run("document.forms.filter.elements.levels.focus()")
    states = []
    for key in ("TAB", "TAB", "ENTER", "SPACE"):  # to the table, which scrolls by keys, on to a head, and twice to sort
        browser.press(key)
        states.append(head(browser, "Return and cost", "policy").get_attribute("aria-sort"))
    assert states == [None, None, "ascending", "descending"]
    assert rows(browser, "Return and cost")[0][0] == "PPO"


def test_a_head_that_gets_the_focus_is_not_behind_the_form(browser: Browser, page: Path):
    browser.open(page)
    seen = """
    const button = document.querySelector(".wide[aria-label='Return and cost'] thead button");
    const isSeen = () => {
        const at = button.getBoundingClientRect();
        return document.elementFromPoint(at.left + 5, at.top + 1) === button;
    };
    window.scrollBy(0, button.getBoundingClientRect().top);
    const before = isSeen();
    button.focus();
    return [before, isSeen()]"""
    assert browser.run(seen) == [False, True]


def test_policies_are_filtered_by_name_in_every_table(browser: Browser, page: Path):
    browser.open(page)
    assert filter_by(browser, policies="p3o") == "6 of 23 rows are shown"
    assert column(browser, "Return and cost", "policy") == ["P3O", PUBLISHED["P3O"]]
    assert column(browser, "In detail", "policy") == ["P3O", "P3O"]
    assert column(browser, "Runs", "run") == ["P3O-2", "P3O-10"]
    filter_by(browser, policies="hover, focops")
    assert column(browser, "Runs", "run") == ["hover-0", "FOCOPS-0"]
    assert filter_by(browser, policies="") == "all 23 rows are shown"


def test_levels_are_filtered_in_rows_and_in_columns(browser: Browser, page: Path):
    browser.open(page)
    assert filter_by(browser, policies="ppo", levels="med") == "7 of 23 rows are shown"
    assert column(browser, "Return and cost", "Medium cost") == ["0.60 ± 0.40", "0.74 ± 0.44"]
    told = "the privileged state and progress too"
    assert rows(browser, "Return and cost")[0] == ["PPO", "1 of 2", "1.50 ± 0.50", "0.60 ± 0.40", told]
    assert [row[:2] for row in rows(browser, "In detail")] == [["PPO", "Medium"]]
    assert column(browser, "Runs", "run") == ["PPO-0", "PPO-1"]
    assert filter_by(browser, policies="", levels="nowhere") == "8 of 23 rows are shown"  # those that name none


def test_what_is_filtered_away_stays_away_when_sorted_and_a_filter_without_matches_says_so(
    browser: Browser, page: Path
):
    browser.open(page)
    filter_by(browser, policies="p3o")
    sort_by(browser, "Runs", "steps")
    assert column(browser, "Runs", "run") == ["P3O-10", "P3O-2"]
    assert filter_by(browser, policies="nobody") == "0 of 23 rows are shown"
    said = "return getComputedStyle(document.querySelector('.wide:has(table)'), '::after').content"
    assert browser.run(said) == '"No row matches."'


def test_pictures_and_films_have_words_and_are_drawn(browser: Browser, page: Path):
    browser.open(page)
    pictures = browser.driver.find_elements("css selector", "img")
    assert [picture.accessible_name.split()[0] for picture in pictures] == ["The", "Four", "Bars:", "Curves:"]
    assert all(browser.run("return arguments[0].naturalWidth", picture) > 500 for picture in pictures)
    films = browser.driver.find_elements("css selector", "video")
    first = "Film of a flight"
    assert [film.accessible_name for film in films] == [first, f"{first}: PPO, best", f"{first}: P3O, best"]
    assert films[1].location["y"] == films[2].location["y"]


WIDEST = "return Math.max(document.documentElement.scrollWidth, document.body.scrollWidth)"


def test_nothing_is_wider_than_a_phone_and_a_picture_can_be_enlarged(browser: Browser, page: Path):
    browser.open(page, width=360)
    picture = browser.driver.find_element("css selector", "img")
    assert browser.run(WIDEST) == 360
    assert picture.size["width"] <= 360
    browser.driver.find_element("css selector", ".enlarge").click()
    assert picture.size["width"] > 800
    assert browser.run(WIDEST) == 360


@pytest.mark.parametrize(("width", "together"), [(1280, True), (360, False)])
def test_the_ranking_stands_first_beside_the_film_or_above_it(browser: Browser, page: Path, width: int, together: bool):
    browser.open(page, width)
    places = "return [...document.querySelectorAll(arguments[0])].map((each) => each.getBoundingClientRect().toJSON())"
    (ranking,), (film, *_) = browser.run(places, ".ranking"), browser.run(places, "video")
    (form,) = browser.run(places, "#filter")
    assert 0 < ranking["top"] < ranking["bottom"] < form["top"] and ranking["right"] <= width
    assert (film["left"] > ranking["right"]) == together and (film["top"] > ranking["bottom"]) != together
    assert film["bottom"] < form["top"] and film["right"] <= width
    values = browser.driver.find_elements("css selector", ".ranking .value")
    assert [value.text for value in values] == ["1.50"]
    (whole,), (bar,) = browser.run(places, ".ranking .scale"), browser.run(places, ".ranking .bar")
    assert bar["width"] / whole["width"] == pytest.approx(0.15, abs=0.01)


def test_no_table_of_the_study_is_clipped_on_a_laptop(browser: Browser):
    root = HERE.parents[2]
    style = (root / "thalweg" / "bench" / "report" / "html" / "page.css").read_text(encoding="utf-8")
    browser.open(root / "benchmarks" / "paper" / "report" / "report.html", width=1280)
    browser.run("document.querySelector('style').textContent = arguments[0]", style)  # as it is written today
    boxes = browser.run(
        "return [...document.querySelectorAll('.wide')].map((box) => [box.ariaLabel, box.scrollWidth, box.clientWidth])"
    )
    assert {"Return and cost", "In detail"} <= {name for name, *_ in boxes}
    assert [name for name, whole, shown in boxes if whole > shown] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_first_column_stays_in_sight_when_a_table_is_scrolled(browser: Browser, page: Path, scheme: str):
    browser.open(page, 360, scheme)
    inside = """
    const box = document.querySelector(".wide[aria-label='In detail']");
    box.scrollIntoView();
    box.scrollLeft = 9999;
    const name = box.querySelector("tbody th"), at = name.getBoundingClientRect();
    const top = document.elementFromPoint(at.left + at.width / 2, at.top + at.height / 2);
    return [box.scrollLeft > 300, at.left - box.getBoundingClientRect().left, top === name,
            getComputedStyle(name).backgroundColor]"""
    ground = {"light": "rgb(255, 255, 255)", "dark": "rgb(20, 20, 20)"}[scheme]
    assert browser.run(inside) == [True, 0, True, ground]


def contrast(colours: list[str]) -> float:
    """Of two colours as `rgb(r, g, b)`, by WCAG 2.2's definition."""

    def luminance(colour: str) -> float:
        shares = np.array([float(part) / 255 for part in colour[4:-1].split(",")])
        linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dark, light = sorted(map(luminance, colours))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_stand_out_from_their_ground(browser: Browser, page: Path, scheme: str):
    browser.open(page, 1200, scheme)
    ground = browser.run("return getComputedStyle(document.documentElement).backgroundColor")
    places = ("h1", "p.note", "tr.elsewhere td", "tbody td", "thead button", "output")
    style = "return getComputedStyle(document.querySelector(arguments[0])).color"
    assert {place for place in places if contrast([browser.run(style, place), ground]) < 4.5} == set()


def test_on_paper_there_is_no_form_and_no_table_is_cut(browser: Browser, page: Path):
    browser.open(page, 400, "dark", "print")
    shown = "return [...document.querySelectorAll(arguments[0])].map((each) => each.checkVisibility())"
    assert browser.run(shown, "#filter, video") == [False] * 4
    ways = "return [...document.querySelectorAll('.wide')].map((box) => getComputedStyle(box).overflowX)"
    assert set(browser.run(ways)) == {"visible"}
    assert browser.run("return getComputedStyle(document.documentElement).backgroundColor") == "rgb(255, 255, 255)"


def test_without_its_script_the_page_says_the_same(browser: Browser, page: Path):
    browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.open(page)
        assert not browser.driver.find_element("id", "filter").is_displayed()
        assert len(browser.driver.find_elements("css selector", ".wide tbody tr")) == 23
        assert browser.driver.find_elements("css selector", "button") == []
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
