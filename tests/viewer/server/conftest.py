"""A server without a network, and a page's end of its socket."""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.viewer.flight.options import FlightOptions
from thalweg.viewer.flight.recording import Folder
from thalweg.viewer.server.app import make_app, make_shared
from thalweg.world import World

ORIGIN = "http://127.0.0.1:8765"
TOKEN = "the-token-of-the-tests"


class Page:
    """What a page hears, in its order."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket

    def say(self, kind: str, **about: Any) -> None:
        """Send a message."""
        self.socket.send_text(json.dumps({"type": kind, **about}))

    def hear(self) -> dict[str, Any]:
        """Return the next message; of a frame its header, with its pictures under `images`."""
        event = self.socket.receive()
        if event.get("text") is not None:
            return json.loads(event["text"])
        assert event["type"] == "websocket.send", event
        content = event["bytes"]
        (length,) = struct.unpack("<I", content[:4])
        told, at, images = json.loads(content[4 : 4 + length]), 4 + length, {}
        for name, size in told["pictures"]:
            images[name] = content[at : at + size]
            at += size
        assert at == len(content)
        self.say("drawn", frame=told["frame"])
        return {"type": "frame", "images": images, **told}

    def until(self, kind: str) -> dict[str, Any]:
        """Return the next message of a kind; an error that is not asked for fails the test."""
        while (told := self.hear())["type"] != kind:
            assert told["type"] != "error", told
        return told

    def at_step(self, step: int) -> dict[str, Any]:
        """Return the next frame at or past a step."""
        while (told := self.until("frame"))["step"] < step:
            pass
        return told


class Server:
    """A server whose flights begin on Easy with frames of 32 pixels."""

    def __init__(self, folder: Path) -> None:
        self.folder = Folder(folder)
        options = FlightOptions(level="Easy", size_px=32, seed=3)
        shared = make_shared({"forward": lambda: BASELINES["forward"]}, self.folder, options=options)
        self.client = TestClient(make_app(shared, TOKEN), base_url=ORIGIN)

    @contextmanager
    def open(self, origin: str | None = ORIGIN, token: str = TOKEN, host: str = "127.0.0.1:8765") -> Iterator[Page]:
        """Open the socket of a page."""
        headers = {"origin": origin, "host": host}
        given = {name: value for name, value in headers.items() if value is not None}
        with self.client.websocket_connect(f"/{token}/socket", headers=given) as socket:
            yield Page(socket)

    @contextmanager
    def flying(self) -> Iterator[Page]:
        """Open the socket of a page, and wait for the first frame."""
        with self.open() as page:
            page.until("frame")
            yield page


@pytest.fixture
def server(tmp_path: Path, easy_world: World) -> Server:
    """A server that saves flights in the test's folder."""
    return Server(tmp_path / "flights")
