"""Connections that break while the server works for them: the work ends, the tab is gone, and other tabs go on."""

import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

from tests.viewer.server.conftest import TOKEN, Page
from thalweg.viewer.flight.cockpit import Cockpit
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.server import app
from thalweg.viewer.server.app import THREADS, bind, make_app, make_server, make_shared
from thalweg.viewer.server.tab import Tab
from thalweg.world import World

PATIENCE_S = 60.0
FORWARD = (0, 0, 1, 0)


class Wire:
    """A socket over the network, as `Page` takes it."""

    def __init__(self, port: int, until: ExitStack) -> None:
        """`until`: closes it at the latest."""
        address, origin = f"ws://127.0.0.1:{port}/{TOKEN}/socket", f"http://127.0.0.1:{port}"
        self._socket = until.enter_context(connect(address, origin=Origin(origin), compression=None))

    def send_text(self, text: str) -> None:
        self._socket.send(text)

    def receive(self) -> dict[str, Any]:
        content = self._socket.recv(timeout=PATIENCE_S)
        return {"type": "websocket.send", "text" if isinstance(content, str) else "bytes": content}

    def drop(self) -> None:
        """Break the connection without a word."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)

    def fall_silent(self) -> None:
        """Answer nothing any more, as a machine that has lost its network; to be called once."""
        self._socket.protocol.data_to_send = list


class Gate:
    """Holds a function up where it begins, once, until it is opened."""

    def __init__(self) -> None:
        self.shut, self.reached, self.opened, self.passed = False, threading.Event(), threading.Event(), 0

    def before(self, work: Callable[..., Any]) -> Callable[..., Any]:
        def held(*arguments: Any, **named: Any) -> Any:
            here, self.shut = self.shut, False
            if here:
                self.reached.set()
                assert self.opened.wait(PATIENCE_S)
            done = work(*arguments, **named)
            self.passed += here
            return done

        return held


class Running:
    """A server on a port of this machine."""

    def __init__(self, folder: Path) -> None:
        options = FlightOptions(level="Easy", size_px=32, seed=3)
        self.folder = Folder(folder)
        self.shared = make_shared({}, self.folder, options=options)
        self._bound, self._server = bind(0), make_server(make_app(self.shared, TOKEN))
        self._bound.listen()
        self._thread = threading.Thread(target=self._server.run, kwargs={"sockets": [self._bound]})
        self._thread.start()
        self._pages = ExitStack()

    def page(self) -> Page:
        """A page with its first frame."""
        page = Page(Wire(self._bound.getsockname()[1], self._pages))
        page.until("frame")
        return page

    def stop(self) -> None:
        """Stop the server."""
        self._pages.close()
        self._server.should_exit = True
        self._thread.join(PATIENCE_S)
        for threads in (self.shared.drawing, self.shared.building):
            threads.shutdown(wait=False)


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets servers notice at once that a connection is silent."""
    monkeypatch.setattr(app, "PING_S", 0.2)
    monkeypatch.setattr(app, "SILENCE_S", 0.5)


@pytest.fixture
def server(tmp_path: Path, easy_world: World) -> Iterator[Running]:
    """A server whose threads must end with it."""
    before = set(threading.enumerate())
    server = Running(tmp_path / "flights")
    yield server
    server.stop()
    wait_until(lambda: not [each for each in set(threading.enumerate()) - before if each.name.startswith(THREADS)])


@pytest.fixture
def loops(monkeypatch: pytest.MonkeyPatch) -> set[Tab]:
    """Tabs whose loops have not ended."""
    running: set[Tab] = set()
    loop = Tab._loop

    async def counted(tab: Tab) -> None:
        running.add(tab)
        try:
            await loop(tab)
        finally:
            running.discard(tab)

    monkeypatch.setattr(Tab, "_loop", counted)
    return running


@pytest.mark.parametrize(
    ("owner", "work", "asked"),
    [
        (Cockpit, "frame", {"kind": "step", "action": FORWARD}),
        (Cockpit, "advance", {"kind": "step"}),
        (Cockpit, "start", {"kind": "start", "options": {"level": "Easy", "size_px": 32}}),
        (Folder, "save", {"kind": "save"}),
    ],
    ids=["draws", "flies", "starts", "saves"],
)
def test_a_connection_that_breaks_while_the_server_works_harms_no_other_tab(
    server: Running,
    loops: set[Tab],
    monkeypatch: pytest.MonkeyPatch,
    owner: type,
    work: str,
    asked: dict[str, Any],
):
    gate = Gate()
    monkeypatch.setattr(owner, work, gate.before(getattr(owner, work)))
    other, lost = server.page(), server.page()
    lost.say("step", action=FORWARD)
    lost.at_step(1)
    assert len(server.shared.tabs) == 2
    gate.shut = True
    lost.say(**asked)
    assert gate.reached.wait(PATIENCE_S)
    lost.socket.drop()
    wait_until(lambda: len(server.shared.tabs) == len(loops) == 1)  # it is counted no more before its work is done
    gate.opened.set()
    other.say("step", action=FORWARD)
    assert other.at_step(1)["step"] == 1
    assert gate.passed == 1
    server.shared.drawing.submit(lambda: None).result(PATIENCE_S)  # nothing else is done for who has gone
    late = server.page()  # and another tab can come
    assert len(server.shared.tabs) == 2
    late.socket.drop()
    if work == "save":
        assert len(server.folder.read("Easy-River-hand-001").actions) == 1


def test_a_tab_that_breaks_off_while_a_river_is_built_harms_no_other_tab(
    server: Running, monkeypatch: pytest.MonkeyPatch
):
    gate = Gate()
    monkeypatch.setattr(type(server.shared.rivers), "world", gate.before(type(server.shared.rivers).world))
    other, lost = server.page(), server.page()
    gate.shut = True
    lost.say("start", options={"level": "Easy", "size_px": 32})
    assert gate.reached.wait(PATIENCE_S)
    lost.socket.drop()
    wait_until(lambda: len(server.shared.tabs) == 1)
    other.say("step", action=FORWARD)  # while the river is still being built
    assert other.at_step(1)["step"] == 1
    gate.opened.set()
    wait_until(lambda: gate.passed == 1)


@pytest.mark.usefixtures("hasty")
def test_a_connection_that_falls_silent_gives_up_its_place(server: Running):
    server.page().socket.fall_silent()
    wait_until(lambda: not server.shared.tabs)


def test_a_page_tries_again_until_its_silent_connection_has_given_up_its_place():
    script = files("thalweg.viewer").joinpath("page", "page.js").read_text(encoding="utf-8")
    found = re.search(r"TRIES = (\d+), TRY_MS = (\d+);", script)
    assert found
    assert int(found[1]) * int(found[2]) / 1000 >= app.PING_S + app.SILENCE_S + 2.0
