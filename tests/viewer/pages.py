"""A server for the tests of the page in a browser, and a way to it that can be broken."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tests.browser import Browser

ROOT = Path(__file__).resolve().parent.parent.parent
PATIENCE_S = 120.0
STEP = "return parseInt(document.getElementById('step').textContent || '-1')"
TEXT = "return document.getElementById('{}').textContent"
SHOWN = "return !document.getElementById('{}').hidden"
COLOURED = """
const canvas = document.getElementById(arguments[0]);
const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
let count = 0;
for (let at = 0; at < data.length; at += 4) {
  if (arguments[1].every((value, channel) => Math.abs(data[at + channel] - value) < 3)) count += 1;
}
return count;
"""
"""How many pixels of a canvas have a colour [3]."""


@contextmanager
def serving(folder: Path, *options: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The address that `thalweg fly` prints, and its process; it is interrupted at the end, and must end well."""
    server = subprocess.Popen(
        [sys.executable, "-m", "thalweg", "fly", *options, "--port", "0", "--out", str(folder)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert server.stdout is not None
    found = re.search(r"http://127\.0\.0\.1:\d+/\S+/", server.stdout.readline())
    assert found
    yield found[0], server
    server.send_signal(signal.SIGINT)
    assert server.wait(30) == 0


def wait_for(browser: Browser, script: str, holds: Callable[[Any], bool] = bool) -> Any:
    """Return what a script returns as soon as that holds."""
    deadline = time.monotonic() + PATIENCE_S
    while not holds(value := browser.run(script)):
        assert time.monotonic() < deadline, (script, value, browser.run("return document.body.innerText"))
        time.sleep(0.05)
    return value


def choose(browser: Browser, field: str, value: str) -> None:
    """Choose a value of a field outside the form as the mouse does."""
    browser.run(
        "const field = document.getElementById(arguments[0]); field.value = arguments[1];"
        "field.dispatchEvent(new Event('change', {bubbles: true}))",
        field,
        value,
    )


def start(browser: Browser, **options: str) -> None:
    """Start a flight from the form with some of its fields changed."""
    browser.run(
        "const form = document.forms.options;"
        "for (const [name, value] of Object.entries(arguments[0])) {"
        "  form.elements[name].value = value; form.elements[name].dispatchEvent(new Event('change')); }"
        "form.requestSubmit()",
        options,
    )


class Relay:
    """A port that leads to another one, until it is cut."""

    def __init__(self, port: int) -> None:
        self._to, self._ends = port, []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Break all connections."""
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._ends = []

    def close(self) -> None:
        """Break all connections, and accept no other one."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                there = socket.create_connection(("127.0.0.1", self._to))
                self._ends += [here, there]
                for pair in ((here, there), (there, here)):
                    threading.Thread(target=self._pump, args=pair, daemon=True).start()

    @staticmethod
    def _pump(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while content := source.recv(65536):
                sink.sendall(content)
        for end in (source, sink):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
