"""A place for the runner where everything takes a moment: what the tests of resuming and failing run on.

As a program it does a suite and can be told to die at some call: `python small_backend.py FOLDER DIE_AT`.
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import REASONS, Episode
from thalweg.bench.evaluate.evaluation import Step
from thalweg.bench.execute.runner import run_suite
from thalweg.bench.pictures.film_format import FilmFormat
from thalweg.bench.report import report
from thalweg.bench.report.sections import SECTIONS, FigureSection
from thalweg.bench.suite.arms import Arm, Run
from thalweg.bench.suite.config import Suite

ARMS = tuple(Arm(name, seeds=(0, 1), steps=100) for name in ("PPO", "FOCOPS"))
SUITE = Suite("small", ARMS, episodes=3, baselines=("hover",), packaged=False)


class SmallBackend:
    """Trains by writing its seed, evaluates by drawing from it; counts its calls."""

    def __init__(
        self, die_at: int = -1, broken: tuple[str, ...] = (), dies: tuple[str, ...] = (), sleeps_s: float = 0.0
    ) -> None:
        """`dies`: runs whose training ends the process; `sleeps_s`: how long any training takes, after a note of who
        does it."""
        self.die_at, self.dies, self.sleeps_s = die_at, dies, sleeps_s
        self.broken = broken
        self.calls: list[str] = []

    def _call(self, name: str) -> None:
        if len(self.calls) == self.die_at:
            os._exit(9)
        self.calls.append(name)

    def train(self, run: Run, folder: Path) -> None:
        self._call(f"train {run.name}")
        if run.name in self.dies:
            os._exit(9)
        folder.mkdir(parents=True, exist_ok=True)
        if self.sleeps_s:
            (folder / "process.txt").write_text(str(os.getpid()))
            time.sleep(self.sleeps_s)
        (folder / "episodes.csv").write_text("step,return,tight,loose\n10,1.5,1.0,0.0\n50,2.5,0.0,0.2\n")
        if run.name in self.broken:
            raise ArithmeticError("the loss is NaN\nin line two")
        (folder / "policy.safetensors").write_bytes(b"")

    def evaluate(self, run: Run, folder: Path, trial: Trial, on_step: Callable[[Step], None]) -> list[Episode]:
        self._call(f"evaluate {run.name} {trial}")
        level, about = trial.level, (run.algorithm, trial.level, trial.condition.name)
        random = np.random.default_rng([run.seed, *map(len, about)])
        rows = []
        for episode in range(SUITE.episodes):
            cost = float(random.choice([0.0, 0.2, 1.0]))
            tight, loose = (cost, 0.0) if cost == 1 else (0.0, cost)
            start = (0.0, 0.0, 5.0, 0.0)
            length = int(random.integers(1, 500))
            rows.append(
                Episode(
                    run.algorithm, run.seed, level, 1, episode, *start, float(random.uniform(0, 10)), cost, tight,
                    loose, length, str(random.choice(REASONS)), False, float(random.uniform()),
                    1.0, 2.0, 5.0,
                )
            )  # fmt: skip
        return rows

    def title(self, run: Run, folder: Path) -> str:
        return run.name

    def film(
        self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None], *, shape: FilmFormat
    ) -> None:
        self._call(f"film {run.name}")
        if "film" in self.broken:
            raise RuntimeError("ffmpeg is\nnot there")
        path.write_bytes(b"film")


def write_film_of(folder: Path, name: str = "film") -> None:
    """What stands for a film, and its caption."""
    (folder / f"{name}.mp4").parent.mkdir(exist_ok=True)
    (folder / f"{name}.mp4").write_bytes(b"a film")
    (folder / f"{name}.txt").write_text(f"What {name} shows.\n")


def draw_nothing(patch: pytest.MonkeyPatch) -> None:
    """Let reports have no figures."""
    sections = tuple(section for section in SECTIONS if not isinstance(section, FigureSection))
    patch.setattr(report, "SECTIONS", sections)


if __name__ == "__main__":
    draw_nothing(pytest.MonkeyPatch())
    run_suite(SUITE, Path(sys.argv[1]), SmallBackend(die_at=int(sys.argv[2])))
