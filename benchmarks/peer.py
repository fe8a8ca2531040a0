"""Speed of Thalweg beside Safety-Gymnasium's vision task, measured in one run.

`python benchmarks/peer.py` makes a virtual environment for Safety-Gymnasium and measures both sides in turns,
repeatedly, so that other load on the machine affects both: about six minutes. Each environment of the peer holds about
0.9 GB of memory. `peer.json` and `peer.png`, with frames of either side, are written beside this file;
`write_peer.py` puts the figures into the pages.

Both draw 128 x 128 pixels on the processor and take random actions. Every choice favours the peer: its vector
environment is tried at several sizes and its resets are not counted, while Thalweg has its defaults, resets included.
Learning, and the content of the frames, are not compared.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from peer_setup import PINS, SIDE, Setup, drawing_by, set_up
from peer_venv import SetupError, last_lines
from PIL import Image
from ratios import ratio

from thalweg.core.atomic_io import atomic_path, write_atomic
from thalweg.core.machine import machine_info, package_versions

HERE = Path(__file__).resolve().parent
SIZE = 128
"""Pixels on a side of a frame."""
PEER, OURS = "Safety-Gymnasium", "Thalweg"
BATCH = 16
"""Environments of Thalweg's vector environment, and the maximum of the peer's."""
PICTURES = 5
"""Frames of each side in the picture."""
KINDS = {
    "one": "steps, one environment",
    "vector": "steps, the vector environment",
    "frame": "frames alone, one camera",
}
COMPARED = {
    "steps, one environment each": ("one",),
    "steps, each at its fastest": ("one", "vector"),
    "frames alone, one camera each": ("frame",),
}
"""The comparisons, and the kinds of lines from which each side's fastest one is taken."""


@dataclass(frozen=True)
class Contender:
    """One line of the table: a side in one way of use."""

    side: str
    kind: str
    """A key of `KINDS`."""
    count: int = 1
    """Environments that are stepped together."""


def contenders(cores: int) -> list[Contender]:
    """Return every line, kind by kind. The peer has a process per environment: one per core, and two."""
    counts = {min(max(cores, 2) * each, BATCH) for each in (1, 2)}
    return [
        Contender(PEER, "one"),
        Contender(OURS, "one"),
        *(Contender(PEER, "vector", count) for count in sorted(counts)),
        Contender(OURS, "vector", BATCH),
        Contender(PEER, "frame"),
        Contender(OURS, "frame"),
    ]


def in_turns(lines: Sequence[Contender], turn: int) -> list[Contender]:
    """Return the lines in the order of a turn: every second turn is reversed, so that no position has an advantage."""
    return list(reversed(lines)) if turn % 2 else list(lines)


class Side:
    """A running process of `peer_side.py`, which waits for orders."""

    def __init__(self, contender: Contender, setup: Setup):
        self.contender = contender
        environment, interpreter = dict(os.environ), [sys.executable]
        if contender.side == PEER:
            interpreter = [str(setup.python), "-I"]
            environment |= drawing_by(setup.gl)
            if contender.kind == "vector":
                environment["LP_NUM_THREADS"] = "1"  # threads of the rasteriser: its processes fill the cores already
        self.log = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            [*interpreter, str(SIDE), contender.side, contender.kind, str(contender.count), str(SIZE)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.log,
            text=True,
        )

    def __enter__(self) -> "Side":
        self.about = self._answer()
        if self.about["frame"][:2] != [SIZE, SIZE]:
            raise RuntimeError(f"{self.contender} draws {self.about['frame']}, not {SIZE} x {SIZE} pixels")
        return self

    def __exit__(self, *_: object) -> None:
        assert self.process.stdin and self.process.stdout
        self.process.stdin.close()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self.log.close()

    def ask(self, **order: object) -> dict:
        """Send an order and return the answer."""
        assert self.process.stdin
        self.process.stdin.write(json.dumps(order) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def rate(self, seconds: float) -> float:
        """Return the units of work per second, measured over `seconds`."""
        done = self.ask(seconds=seconds)
        return done["units"] / done["seconds"]

    def frames(self) -> np.ndarray:
        """Return first frames of episodes side by side, uint8 [size, PICTURES * size, 3]."""
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "frames.npy")
            self.ask(pictures=file, count=PICTURES)
            return np.concatenate(np.load(file), axis=1)

    def _answer(self) -> dict:
        assert self.process.stdout
        line = self.process.stdout.readline()
        if not line:
            self.log.seek(0)
            raise RuntimeError(f"{self.contender} failed:\n{last_lines(self.log.read())}")
        return json.loads(line)


def comparisons(measurements: Sequence[dict]) -> list[dict]:
    """Return for each of `COMPARED` the line of Thalweg with the highest median against that of the peer."""
    found = []
    for name, kinds in COMPARED.items():
        best = {}
        for side in (OURS, PEER):
            lines = [line for line in measurements if line["side"] == side and line["kind"] in kinds]
            best[side] = max(lines, key=lambda line: statistics.median(line["rates"]))
        median, least, greatest = ratio(best[OURS]["rates"], best[PEER]["rates"])
        found.append({"what": name, "ratio": median, "least": least, "greatest": greatest})
    return found


def measure(setup: Setup, repeats: int, seconds: float, picture: Path) -> dict:
    """Measure every contender in turns, and write a picture with a row of frames for each side."""
    lines = contenders(int(machine_info()["cores"]))
    rates: dict[Contender, list[float]] = {line: [] for line in lines}
    with ExitStack() as stack:
        sides = {}
        for line in lines:
            print(f"starting {line.side}, {KINDS[line.kind]}, {line.count}", flush=True)
            sides[line] = stack.enter_context(Side(line, setup))
        for turn in range(repeats):
            for line in in_turns(lines, turn):
                rates[line].append(sides[line].rate(seconds))
            print(f"repetition {turn + 1} of {repeats}:", *(f"{rates[line][-1]:.0f}" for line in lines), flush=True)
        rows = [sides[line].frames() for line in lines if line.kind == "one"]
    with atomic_path(picture) as draft:
        Image.fromarray(np.concatenate(rows)).save(draft)
    pins = {name: number for name, _, number in (pin.partition("==") for pin in PINS)}
    measured = [asdict(line) | {"reset_s": sides[line].about["reset_s"], "rates": rates[line]} for line in lines]
    return {
        "peer": {"python": sides[lines[0]].about["python"], **pins},
        "opengl": f"MUJOCO_GL={setup.gl}: {setup.opengl}",
        "size": SIZE,
        "seconds": seconds,
        "measurements": measured,
        "comparisons": comparisons(measured),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description="Thalweg beside Safety-Gymnasium, in one run on this machine")
    parser.add_argument(
        "--out", type=Path, default=HERE / "peer.json", help="output file; a picture is written beside it"
    )
    parser.add_argument("--python", help="a Python 3.8 to 3.10 for Safety-Gymnasium; by default the newest on the path")
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=4.0, help="duration of each repetition")
    given = parser.parse_args()
    if given.repeats < 1 or not 0 < given.seconds < 3600:
        parser.error(f"at least one repetition of some seconds, not {given.repeats} of {given.seconds:g} s")
    try:
        setup = set_up(given.python)
    except SetupError as error:
        print(error, file=sys.stderr)
        return 1
    before = {"machine": machine_info(), "load_before": os.getloadavg()[0], "versions": package_versions()}
    found = measure(setup, given.repeats, given.seconds, given.out.with_suffix(".png"))
    write_atomic(given.out, json.dumps(before | found, indent=2) + "\n")
    for line in found["comparisons"]:
        print(f"{line['what']}: {line['ratio']:.2f} times ({line['least']:.2f} to {line['greatest']:.2f})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
