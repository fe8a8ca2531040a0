"""A place for a cluster's runs where algorithms really train, on a toy, and can be held halfway."""

import os
import sys
import time
from pathlib import Path

import pytest

from tests.bench.small_backend import SmallBackend, draw_nothing
from tests.train.small_runs import train
from tests.train.toys import Walk
from thalweg.bench.execute.cluster.ray_executor import RayExecutor
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite

SUITE = Suite(
    "walks", (Arm("PPO", seeds=(0,)), Arm("FOCOPS", seeds=(0,))), baselines=("hover",), packaged=False, episodes=3
)
HELD_AT, LAST = 200, "000000000768"
"""The vector step at which a run is held, and the last checkpoint before it."""
DOOMED = "DOOMED"
"""In the environment of a node that is to be lost: the file where it says which run it holds, and as which process."""


class Held(Walk):
    """Comes halfway, says so, and waits for its end."""

    def __init__(self, note: Path, run: str) -> None:
        super().__init__()
        self.note, self.run = note, run

    def step(self, actions):
        if self.total == HELD_AT:
            self.note.write_text(f"{self.run} {os.getpid()}\n")
            time.sleep(600)
        return super().step(actions)


class WalkingBackend(SmallBackend):
    """Trains walkers; every run is held if `note` is given, else those on a doomed node."""

    def __init__(self, note: Path | None = None) -> None:
        super().__init__()
        self.note = note

    def train(self, run: Run, folder: Path) -> None:
        print("goes on from", *(path.name for path in sorted(folder.glob("checkpoints/[0-9]*"))))
        note = self.note or os.environ.get(DOOMED)
        train(folder, run.algorithm, Held(Path(note), run.name) if note else Walk(), seed=run.seed)


if __name__ == "__main__":
    draw_nothing(pytest.MonkeyPatch())
    address, results, note = sys.argv[1:]
    run_suite(SUITE, Path(results), WalkingBackend(Path(note)), executor=RayExecutor(address, sync_interval_s=0.0))
