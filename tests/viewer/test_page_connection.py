"""Tests of the page when its connection ends: broken, out of reach, refused, or stopped with the server."""

import signal
import subprocess
from collections.abc import Iterator

import pytest

from tests.browser import Browser
from tests.viewer.pages import STEP, TEXT, Relay, choose, serving, start, wait_for
from thalweg.world import World

pytestmark = pytest.mark.browser

NEXT_SOCKET = """
const change = {
  nothing: (event, hear) => hear(event),
  firstFlightFails(event, hear) {
    const started = !this.failed && typeof event.data === "string" && JSON.parse(event.data).type === "started";
    this.failed ||= started;
    hear(started ? { data: JSON.stringify({ type: "error", message: "no such river" }) } : event);
  },
  anotherIsChosenAtOnce(event, hear) {
    hear(event);
    if (typeof event.data !== "string" || JSON.parse(event.data).type !== "hello") return;
    document.forms.options.elements.seed.value = 7;
    document.forms.options.requestSubmit();
  },
};
const kind = arguments[0];
window.sent = [];
window.WebSocket = class extends WebSocket {
  send(text) { window.sent.push(JSON.parse(text)); super.send(text); }
  set onmessage(hear) { super.onmessage = (event) => change[kind](event, hear); }
};
"""
"""Changes what the page hears from the socket by which it connects again, and notes what it sends."""
SENT = "return window.sent.filter(({{type}}) => type === '{}')"
NO_PLACE = """
const Real = window.WebSocket;
window.WebSocket = class {
  static OPEN = 1;
  constructor() {
    window.WebSocket = Real;
    setTimeout(() => this.onclose({ code: 1013, reason: "6 tabs are open: close one" }));
  }
};
"""
"""Lets the next socket be refused as by a server with six tabs, and those after it be as usual."""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, easy_world: World) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address of a server, and its process."""
    with serving(tmp_path_factory.mktemp("page"), "--level", "Easy", "--seed", "3", "--size", "64") as served:
        yield served


@pytest.fixture
def relay(served: tuple[str, subprocess.Popen[str]], browser: Browser) -> Iterator[Relay]:
    """A way to the server that can be cut, with the page at its other end."""
    port = int(served[0].split(":")[2].split("/")[0])
    relay = Relay(port)
    browser.open(served[0].replace(f":{port}/", f":{relay.port}/"))
    wait_for(browser, STEP, lambda step: step == 0)
    yield relay
    relay.close()


def test_a_connection_that_broke_is_made_again_with_the_same_options(browser: Browser, relay: Relay):
    start(browser, seed="5", look="autumn")
    wait_for(browser, TEXT.format("where"), lambda text: text.endswith("start 5"))
    wait_for(browser, STEP, lambda step: step == 0)
    browser.press("w", on=browser.driver.find_element("tag name", "body"))
    wait_for(browser, STEP, lambda step: step == 1)
    relay.cut()
    wait_for(browser, TEXT.format("error"), lambda text: "The connection was broken, and the flight was lost" in text)
    wait_for(browser, STEP, lambda step: step == 0)
    assert browser.run(TEXT.format("where")).endswith("start 5")
    assert browser.run("return document.forms.options.look.value") == "autumn"
    assert not browser.run("return document.getElementById('go').disabled")
    browser.press("w", on=browser.driver.find_element("tag name", "body"))
    wait_for(browser, STEP, lambda step: step == 1)


def at_start(browser: Browser, seed: int) -> None:
    """Wait for the first frame of a flight from a start."""
    wait_for(browser, TEXT.format("where"), lambda text: text.endswith(f"start {seed}"))
    wait_for(browser, STEP, lambda step: step == 0)


def test_who_flew_and_that_flights_are_saved_are_restored(browser: Browser, relay: Relay):
    choose(browser, "pilot", "steady")
    browser.run("document.getElementById('record').click()")
    browser.run(NEXT_SOCKET, "nothing")
    relay.cut()
    wait_for(browser, TEXT.format("error"), lambda text: text.endswith("the flight was lost. It begins again here."))
    wait_for(browser, "return document.getElementById('pilot').value", lambda name: name == "steady")
    assert browser.run(SENT.format("control")) == [{"type": "control", "pilot": "steady"}]
    assert browser.run(SENT.format("record")) == [{"type": "record", "on": True}]


def test_cruise_is_held_again_where_its_box_is_ticked(browser: Browser, relay: Relay):
    browser.run("document.getElementById('cruise').click()")
    browser.run(NEXT_SOCKET, "nothing")
    relay.cut()
    wait_for(browser, TEXT.format("error"), lambda text: text.endswith("the flight was lost. It begins again here."))
    wait_for(browser, STEP, lambda step: step == 0)
    assert browser.run("return document.getElementById('cruise').checked")
    assert browser.run(SENT.format("hold")) == [{"type": "hold", "action": [0, 0, 1, 0]}]


def test_the_lost_flight_begins_also_where_the_first_one_of_the_server_cannot(browser: Browser, relay: Relay):
    start(browser, seed="5")
    at_start(browser, 5)
    browser.run(NEXT_SOCKET, "firstFlightFails")
    relay.cut()
    wait_for(browser, TEXT.format("error"), lambda text: "the flight was lost" in text)
    at_start(browser, 5)
    start(browser, seed="7")
    at_start(browser, 7)
    assert [flight["options"]["seed"] for flight in browser.run(SENT.format("start"))] == [5, 7]


def test_a_flight_that_is_chosen_meanwhile_is_not_replaced_by_the_lost_one(browser: Browser, relay: Relay):
    browser.run(NEXT_SOCKET, "anotherIsChosenAtOnce")
    relay.cut()
    at_start(browser, 7)
    assert [flight["options"]["seed"] for flight in browser.run(SENT.format("start"))] == [7]


def test_a_server_that_is_full_is_tried_again(browser: Browser, relay: Relay):
    browser.run(NO_PLACE)
    relay.cut()
    wait_for(browser, TEXT.format("notice"), lambda text: "2 of 10" in text)
    wait_for(browser, TEXT.format("error"), lambda text: "the flight was lost" in text)


def test_a_server_that_cannot_be_reached_is_not_said_to_have_stopped(browser: Browser, relay: Relay):
    relay.close()
    wait_for(browser, TEXT.format("notice"), lambda text: "The connection is broken" in text and "1 of 10" in text)
    assert browser.run("return document.getElementById('go').disabled")
    told = wait_for(browser, TEXT.format("notice"), lambda text: "cannot be reached" in text)
    assert told.endswith("It has stopped, or the way to it is broken. Reload this page to try again.")


def test_a_server_that_stops_says_so(browser: Browser, served: tuple[str, subprocess.Popen[str]]):
    browser.open(served[0])
    wait_for(browser, STEP, lambda step: step == 0)
    served[1].send_signal(signal.SIGINT)
    told = wait_for(browser, TEXT.format("notice"), lambda text: "The server has stopped" in text)
    assert told.endswith("Start it again and open its new address.")
    assert served[1].wait(30) == 0
