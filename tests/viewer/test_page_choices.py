"""Tests of the choices on the page: rivers, looks and tasks, who flies, and what is shown of it; and a gamepad."""

from collections.abc import Iterator

import pytest

from tests.browser import Browser
from tests.image_policies import image_policy
from tests.viewer.pages import COLOURED, SHOWN, STEP, TEXT, choose, serving, start, wait_for
from thalweg.viewer.flight.seen_water import COLOURS, DRY, WATER
from thalweg.world import World

pytestmark = pytest.mark.browser
RIVER, TRACK, RETURN, COST = [169, 207, 234], [194, 65, 12], [11, 99, 176], [180, 35, 24]
"""Colours of the style sheet, by day."""
PICTURE = "return document.getElementById('view').toDataURL()"
FLIES = "return document.getElementById('pilot').value"
HELD = "return [...document.querySelectorAll('#keys-held span')].map((each) => each.textContent).join()"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory, easy_world: World, medium_world: World) -> Iterator[str]:
    """The address of a server on which a small policy of images flies first."""
    folder = tmp_path_factory.mktemp("choices")
    policy = folder / "small.safetensors"
    image_policy("rgb+mask").save(policy)
    options = (str(policy), "--level", "Easy", "--seed", "3", "--size", "64")
    with serving(folder / "flights", *options) as (address, _):
        yield address


@pytest.fixture
def page(browser: Browser, address: str) -> Browser:
    """The page with its first frame, paused."""
    browser.open(address, width=1280)
    wait_for(browser, STEP, lambda step: step == 0)
    return browser


def fly(page: Browser, steps: int) -> None:
    """Fly so many steps by whoever flies, and wait for their frames."""
    first = page.run(STEP)
    for step in range(first + 1, first + steps + 1):
        page.run("document.getElementById('one').click()")
        wait_for(page, STEP, lambda now, step=step: now == step)


def started(page: Browser, where: str) -> None:
    """Wait for the first frame of another flight."""
    wait_for(page, TEXT.format("where"), lambda text: where in text)
    wait_for(page, STEP, lambda step: step == 0)
    wait_for(page, TEXT.format("notice"), lambda text: "Ready" in text)


def test_another_river_and_task_are_flown(page: Browser):
    start(page, level="Medium", task="Swimmers")
    started(page, "Medium, river 1, ")
    assert page.run(TEXT.format("where")).endswith("task Swimmers, start 3")
    fly(page, 1)
    assert page.run(TEXT.format("costs")).startswith("tight 0.00 · loose 0.00 · swimmers ")
    assert page.run(TEXT.format("task-text")).startswith("Fast steps pay off")
    assert page.run("return document.querySelector('.back small').textContent") == "fast"
    assert page.run("return document.forms.options.level.value") == "Medium"
    assert page.run(TEXT.format("error")) == ""


def test_any_wind_that_the_server_takes_can_be_chosen(page: Browser):
    start(page, wind_m_per_s="0.3", seed="7")
    started(page, "start 7")
    assert page.run("return document.forms.options.wind_m_per_s.value") == "0.3"


def test_p_takes_over_and_hands_back_to_who_flew(page: Browser):
    policy, body = page.run(FLIES), page.driver.find_element("tag name", "body")
    assert policy.endswith("small.safetensors")
    page.press("p", on=body)
    wait_for(page, FLIES, lambda name: name == "hand")
    page.press("p", on=body)
    wait_for(page, FLIES, lambda name: name == policy)


def test_no_frame_of_an_earlier_flight_is_shown_in_the_next(page: Browser):
    page.run("""
        const decode = window.createImageBitmap.bind(window);
        const slow = async (picture) => { await new Promise((done) => setTimeout(done, 200)); return decode(picture); };
        window.createImageBitmap = slow;
        window.told = [];
        const text = (id) => document.getElementById(id).textContent;
        new MutationObserver(() => window.told.push([text("where"), text("step")]))
          .observe(document.getElementById("step"), {childList: true});
    """)
    choose(page, "pilot", "pilot")
    body = page.driver.find_element("tag name", "body")
    page.press(" ", on=body)
    wait_for(page, STEP, lambda step: step >= 2)
    page.press("n", on=body)
    started(page, "start 4")
    told = page.run("return window.told")
    assert any(where.endswith("start 3") and not step.startswith("0 of") for where, step in told)
    assert {step.split()[0] for where, step in told if where.endswith("start 4")} == {"0"}


def test_a_look_changes_the_picture_and_the_usual_one_brings_it_back(page: Browser):
    usual = page.run(PICTURE)
    start(page, look="mist", seed="4")
    started(page, "start 4")
    misty = page.run(PICTURE)
    start(page, look="mist", seed="3")
    started(page, "start 3")
    assert page.run(PICTURE) not in (usual, misty)
    start(page, look="as trained", seed="4")
    started(page, "start 4")
    start(page, look="as trained", seed="3")
    started(page, "start 3")
    assert page.run(PICTURE) == usual


def test_a_policy_is_watched_with_what_it_sees_and_the_birds_eye_map(page: Browser):
    assert page.run("return document.getElementById('pilot').selectedOptions[0].text").endswith("small.safetensors")
    page.run("document.getElementById('with-seen').click()")
    wait_for(page, SHOWN.format("bird"))
    assert page.run(SHOWN.format("bird-legend"))
    assert not page.run(SHOWN.format("seen"))  # it has not looked yet
    first = page.run(COLOURED, "bird", COLOURS[WATER]), page.run(COLOURED, "bird", COLOURS[DRY])
    assert min(first) > 50
    fly(page, 2)
    wait_for(page, SHOWN.format("seen"))
    assert page.run("const {width, height} = document.getElementById('seen'); return [width, height]") == [256, 128]
    mask_shows = "return new Set(document.getElementById('seen').getContext('2d').getImageData(128, 0, 128, 128).data)"
    assert page.run(f"return [...(() => {{ {mask_shows} }})()].sort((a, b) => a - b)") == [0, 255]
    assert page.run("return document.getElementById('bird').width") == 128


def test_the_map_grows_for_a_hand_too_and_is_hidden_with_the_policys_view(page: Browser):
    choose(page, "pilot", "pilot")
    page.run("document.getElementById('with-seen').click()")
    wait_for(page, SHOWN.format("bird"))
    first = page.run(COLOURED, "bird", COLOURS[WATER])
    fly(page, 4)
    assert page.run(COLOURED, "bird", COLOURS[WATER]) > first
    assert not page.run(SHOWN.format("seen"))
    page.run("document.getElementById('with-seen').click()")
    wait_for(page, SHOWN.format("bird"), lambda shown: not shown)
    assert not page.run(SHOWN.format("bird-legend"))


def test_map_track_and_chart_have_content(page: Browser):
    assert page.run(COLOURED, "map", RIVER) > 1000
    before = page.run(COLOURED, "map", TRACK)
    choose(page, "pilot", "pilot")
    page.run("document.getElementById('near').click()")
    fly(page, 6)
    assert page.run(COLOURED, "map", TRACK) > before + 4
    assert page.run(COLOURED, "chart", RETURN) > 20
    assert float(page.run(TEXT.format("return"))) > 0


def test_costs_are_told_by_kind_and_drawn(page: Browser):
    choose(page, "pilot", "hand")
    level = page.run(COLOURED, "chart", COST)
    body = page.driver.find_element("tag name", "body")
    page.run("document.getElementById('speed').value = 'fastest'")
    page.press(" ", on=body)
    wait_for(page, TEXT.format("notice"), lambda text: "has ended" in text)
    assert page.run(TEXT.format("costs")) == "tight 0.00 · loose 0.20"
    assert page.run(TEXT.format("cost")) == "0.20"
    assert page.run("return document.getElementById('cost').classList.contains('paid')")
    assert page.run(COLOURED, "chart", COST) != level


def test_a_gamepad_flies(page: Browser):
    choose(page, "pilot", "hand")
    plug = "Object.defineProperty(navigator, 'getGamepads', {configurable: true, value: () => arguments_});"
    connected = "{connected: true, axes: [-0.9, 0.1, 0, -1]}"  # left stick to the left, right stick forward
    page.run(plug.replace("arguments_", f"[null, {connected}, {{connected: false, axes: [0, -1, 0, 0]}}]"))
    assert wait_for(page, HELD) == "turn left,forward"  # 0.1 is a stick at rest
    heading = "return parseInt(document.getElementById('pose').textContent.split('m, ')[1])"
    before = page.run(heading)
    fly(page, 2)
    assert (page.run(heading) - before) % 360 > 10
    page.run(plug.replace("arguments_", "[]"))
    wait_for(page, HELD, lambda held: held == "")
