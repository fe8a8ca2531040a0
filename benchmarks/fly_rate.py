"""Frames a second of the page to fly, as a client of its server gets them.

    python benchmarks/fly_rate.py                 # writes fly_rate.csv
    python benchmarks/write_figures.py            # writes the table into docs/fly.md

It starts `thalweg fly` on Medium in a process of its own, opens its socket as the page does, and says that a frame was
shown as soon as it has arrived: what a browser takes to show it comes on top. The pictures are those that the page
begins with, camera and water mask; `policy's view` adds what the policy sees and the bird's-eye map.

Two paces are told to the server. `2 x` is the one that the page begins with: eight steps a second, between which the
camera moves on, and at most 40 frames. `fastest` takes a step for each frame, at most 150 a second. A flight
that ends begins again from the next start; the time between flights, and the first frames of each, do not count.
"""

import argparse
import json
import os
import re
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from page_sections import beside, wrap

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import machine_info
from thalweg.core.parent_process import ending_with_parent

TABLE = Path(__file__).resolve().parent / "fly_rate.csv"
COLUMNS = (
    "size_px", "flies", "view", "speed", "frames", "frames_per_s", "median_ms", "p95_ms",
    "cpu_type", "vector_bits", "cores", "load",
)  # fmt: skip
SIZES = (256, 384)
SHOWN = (("pilot", "frame"), ("packaged", "frame"), ("packaged", "policy's view"))
"""Who flies, and what is shown."""
SPEEDS = {"2 x": 2.0, "fastest": None}
FIRST = 10
"""Frames at the beginning of a flight that do not count."""
PATIENCE_S = 300.0


@dataclass(frozen=True)
class Case:
    """What is measured at a time."""

    size_px: int
    flies: str
    view: str
    speed: str


class Page:
    """The page's end of a socket."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket

    def say(self, kind: str, **about: Any) -> None:
        """Send a message."""
        self._socket.send(json.dumps({"type": kind, **about}))

    def hear(self) -> dict[str, Any]:
        """Return the next message, of a frame its header; it counts as shown."""
        content = self._socket.recv(timeout=PATIENCE_S)
        if isinstance(content, str):
            return json.loads(content)
        (length,) = struct.unpack("<I", content[:4])
        told = json.loads(content[4 : 4 + length])
        self.say("drawn", frame=told["frame"])
        return {"type": "frame", **told}


def until(page: Any, kind: str) -> dict[str, Any]:
    """Return the next message of a kind; raises `RuntimeError` with an error of the server."""
    while (told := page.hear())["type"] != kind:
        if told["type"] == "error":
            raise RuntimeError(told["message"])
    return told


def begin(page: Any, case: Case, options: dict[str, Any], seed: int) -> None:
    """Begin a flight and let it go, as the page does."""
    page.say("start", options={**options, "size_px": case.size_px, "seed": seed})
    while until(page, "started")["options"]["seed"] != seed:
        pass
    page.say("view", picture="camera", mask=True, seen=case.view != "frame")
    page.say("control", pilot=case.flies)
    page.say("run", paused=False, speed=SPEEDS[case.speed])
    while not until(page, "frame")["moving"]:
        pass


def intervals(
    page: Any, case: Case, options: dict[str, Any], seconds: float, clock: Callable[[], float] = time.perf_counter
) -> list[float]:
    """Return the seconds from each frame to the next one, in flights that last so many seconds together."""
    found: list[float] = []
    seed = int(options["seed"])
    while sum(found) < seconds:
        begin(page, case, options, seed)
        for _ in range(FIRST):
            until(page, "frame")
        last, ended = clock(), False
        while sum(found) < seconds and not ended:
            ended = bool(until(page, "frame")["ended"])
            found.append(-last + (last := clock()))
        seed += 1
    page.say("run", paused=True)
    return found


def row_of(case: Case, found: Sequence[float]) -> list[str]:
    """Return what is told of a case: frames, their number a second, and milliseconds between two, the median and what
    95 of 100 do not exceed."""
    ordered = sorted(found)
    p95 = ordered[min(int(0.95 * len(ordered)), len(ordered) - 1)]
    times = [f"{1e3 * each:.1f}" for each in (statistics.median(ordered), p95)]
    rate = f"{len(found) / sum(found):.1f}"
    return [str(case.size_px), case.flies, case.view, case.speed, str(len(found)), rate, *times]


def cases() -> list[Case]:
    """Return all cases in the order of the table."""
    return [Case(size, *shown, speed) for size in SIZES for shown in SHOWN for speed in SPEEDS]


@contextmanager
def served() -> Iterator[str]:
    """Start a server, and give its address."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "thalweg", "fly", "--level", "Medium", "--port", "0", "--out", folder]
        server = subprocess.Popen(ending_with_parent(command), stdout=subprocess.PIPE, text=True)
        try:
            assert server.stdout is not None
            found = re.search(r"http://(\S+)/", server.stdout.readline())
            assert found, "the server told no address"
            yield found[1]
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(30)


def measured(seconds: float) -> list[list[str]]:
    """Return a row for each case, with the processor and the load before."""
    from websockets.sync.client import connect
    from websockets.typing import Origin

    machine, load = machine_info(), f"{os.getloadavg()[0]:.1f}"
    about = [str(machine[name]) for name in ("cpu_type", "vector_bits", "cores")]
    rows = []
    with served() as address:
        origin = Origin(f"http://{address.split('/')[0]}")
        with connect(f"ws://{address}/socket", origin=origin, compression=None) as socket:
            page = Page(socket)
            options = until(page, "hello")["options"]
            for case in cases():
                rows.append([*row_of(case, intervals(page, case, options, seconds)), *about, load])
                print(*rows[-1], flush=True)
    return rows


def table() -> str:
    """Return the table of the page."""
    rows = read_csv(TABLE, COLUMNS)
    of = {tuple(row[name] for name in COLUMNS[:4]): row for row in rows}
    lines = []
    for size, flies, view in dict.fromkeys(tuple(row[name] for name in COLUMNS[:3]) for row in rows):
        line = [f"{size} x {size}", flies + (f", {view}" if view != "frame" else "")]
        for speed in SPEEDS:
            row = of[size, flies, view, speed]
            line += [f"{float(row['frames_per_s']):.0f}", f"{float(row['p95_ms']):.0f}"]
        lines.append(line)
    names = ["frames", "flies", *(f"{speed}: {what}" for speed in SPEEDS for what in ("frames/s", "ms, 95 of 100"))]
    first = rows[0]
    note = wrap(
        "Frames a second at the pace that the page begins with, at most 40, and at *fastest*, at most 150;"
        " and within how many milliseconds 95 of 100 frames follow the one before. A client on the same machine takes"
        " each frame at once and shows none: a browser needs time of its own. Medium, full quality,"
        f" {first['cores']} cores of type {first['cpu_type']}, with vectors of {first['vector_bits']} bits,"
        f" {beside(first['load'])}."
    )
    return f"{markdown(frame(names, lines))}\n{note}"


def main() -> None:
    """Measure, and write the table of this folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of flight in each of the cases")
    write_atomic(TABLE, csv_text(COLUMNS, measured(parser.parse_args().seconds)))


if __name__ == "__main__":
    main()
