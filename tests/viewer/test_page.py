"""The page to fly as a reader has it: in a browser, by keyboard and mouse, on a desk and on a phone."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser import Browser
from tests.viewer.pages import STEP, TEXT, serving, wait_for
from thalweg.viewer.flight.recording import Folder
from thalweg.world import World

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("page") / "flights"


@pytest.fixture(scope="module")
def address(folder: Path, easy_world: World) -> Iterator[str]:
    """The address of a server."""
    with serving(folder, "--level", "Easy", "--seed", "3", "--size", "64") as (address, _):
        yield address


@pytest.fixture
def page(browser: Browser, address: str) -> Browser:
    """The page with its first frame, paused."""
    browser.complaints()
    browser.requests()
    browser.open(address, width=1280)
    wait_for(browser, STEP, lambda step: step == 0)
    return browser


def test_the_page_loads_without_complaints_and_from_its_server_alone(page: Browser, address: str):
    asked = page.requests()
    assert {url.removeprefix(address) for url in asked} - {"data:,"} == {
        "",
        "page.css",
        "page.js",
        "map.js",
        "controls.js",
    }
    assert page.complaints() == []


def test_a_flight_key_flies_one_step_of_a_paused_flight(page: Browser):
    body = page.driver.find_element("tag name", "body")
    page.press("w", on=body)
    wait_for(page, STEP, lambda step: step == 1)
    page.press("ARROW_UP", on=body)
    wait_for(page, STEP, lambda step: step == 2)
    assert page.run("return document.getElementById('pilot').value") == "hand"


def test_the_space_key_flies_and_pauses_and_p_hands_over(page: Browser):
    body = page.driver.find_element("tag name", "body")
    page.press("p", on=body)
    wait_for(page, "return document.getElementById('pilot').value", lambda name: name == "pilot")
    page.press(" ", on=body)
    wait_for(page, STEP, lambda step: step >= 4)
    assert page.run(TEXT.format("go")) == "Pause"
    page.press(" ", on=body)
    wait_for(page, TEXT.format("go"), lambda text: text == "Fly")
    assert float(page.run(TEXT.format("return"))) > 0


def test_a_flight_is_saved_and_replayed_with_the_mouse(page: Browser, folder: Path):
    body = page.driver.find_element("tag name", "body")
    for step in (1, 2, 3):
        page.press("w", on=body)
        wait_for(page, STEP, lambda done, step=step: done == step)
    page.run("document.getElementById('save').click()")
    wait_for(page, TEXT.format("folder"), lambda text: "Saved Easy-River-hand-001" in text)
    wait_for(page, "return document.querySelectorAll('#list li').length", lambda count: count == 1)
    page.run("document.querySelector('#list button').click()")
    wait_for(page, "return document.getElementById('pilot').value", lambda name: name == "replay")
    page.run("document.getElementById('go').click()")
    wait_for(page, STEP, lambda step: step == 3)
    assert len(Folder(folder).read("Easy-River-hand-001").actions) == 3


def test_another_picture_is_shown_and_an_impossible_flight_is_named(page: Browser):
    pixel = "return [...document.getElementById('view').getContext('2d').getImageData(32, 60, 1, 1).data]"
    page.run("const p = document.getElementById('picture'); p.value = 'mask'; p.dispatchEvent(new Event('change'))")
    wait_for(page, pixel, lambda colour: colour in ([255] * 4, [0, 0, 0, 255]))
    page.run("document.forms.options.wind_m_per_s.value = 20; document.forms.options.requestSubmit()")
    assert "it holds against a wind of" in wait_for(page, TEXT.format("error"))


def test_the_end_of_a_flight_is_told_on_the_picture(page: Browser):
    body = page.driver.find_element("tag name", "body")
    page.run("document.getElementById('speed').value = 'fastest'")
    page.press(" ", on=body)
    notice = wait_for(page, TEXT.format("notice"), lambda text: "has ended" in text)
    assert "idle" in notice and "cost 0.20" in notice
    page.press("n", on=body)
    wait_for(page, TEXT.format("where"), lambda text: text.endswith("start 4"))


@pytest.mark.parametrize("width", [375, 800, 1280])
def test_nothing_is_wider_than_the_screen(browser: Browser, address: str, width: int):
    browser.open(address, width=width)
    wait_for(browser, STEP, lambda step: step == 0)
    assert browser.run("return document.documentElement.scrollWidth") <= width
    pads = browser.run("return document.getElementById('pads').checkVisibility()")
    assert pads == (width == 375)


def test_a_button_of_the_pads_flies(browser: Browser, address: str):
    browser.open(address, width=375)
    wait_for(browser, STEP, lambda step: step == 0)
    browser.run("""
const pad = document.querySelector("[data-hold='2 1']");
pad.setPointerCapture = () => {};
for (const kind of ["pointerdown", "pointerup"]) pad.dispatchEvent(new PointerEvent(kind, {bubbles: true}));
""")
    wait_for(browser, STEP, lambda step: step == 1)
