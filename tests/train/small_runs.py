"""Runs of every algorithm that are over in seconds, and what of them must not depend on chance."""

import csv
from pathlib import Path
from typing import Any

from tests.train.toys import Walk
from thalweg.algos import ALGORITHMS
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.planning.config import PlanningConfig
from thalweg.train import run

SMALL: dict[str, Any] = {"steps_per_update": 128, "minibatch": 64, "passes": 2, "hidden": (16,)}
SMALL_REPLAY = {"steps_per_update": 128, "steps_per_collection": 128, "minibatch": 16, "hidden": (16,)}
SMALL_REPLAY |= {"random_steps": 100, "replay_size": 1000}
SMALL_PLANS = SMALL_REPLAY | {"samples": 8, "iterations": 2, "elites": 2, "horizon": 3, "members": 2}
SMALL_PLANS |= {"model_hidden": (16,), "model_steps": 8, "critic_steps": 4}
"""A checkpoint every 128 steps for each family; a replay is full before the run is over."""
STEPS = 1500


def small(algorithm: str) -> dict[str, Any]:
    kind = ALGORITHMS[algorithm].config if algorithm in ALGORITHMS else object
    if issubclass(kind, PlanningConfig):
        return SMALL_PLANS
    return SMALL_REPLAY if issubclass(kind, OffPolicyConfig) else SMALL


def rows_of(folder: Path, name: str) -> list[dict[str, str]]:
    with open(folder / name) as file:
        return list(csv.DictReader(file))


def numbers(folder: Path) -> tuple[list[dict[str, str]], str, bytes]:
    """What must not depend on interruptions: metrics without times, episodes, the policy's bytes."""
    timing = ("time_", "seconds", "steps_per_second")
    metrics = [{k: v for k, v in row.items() if not k.startswith(timing)} for row in rows_of(folder, "metrics.csv")]
    return metrics, (folder / "episodes.csv").read_text(), (folder / "policy.safetensors").read_bytes()


def train(folder: Path, algorithm: str = "FOCOPS", env: Walk | None = None, **settings: Any):
    given: dict[str, Any] = {
        "steps": STEPS,
        "seed": 3,
        "config": small(algorithm),
        "checkpoint_seconds": 0.0,
    } | settings
    return run(algorithm, env or Walk(), folder=folder, **given)


class Stop(Exception):
    pass


class StopsAt(Walk):
    """Raises in the given vector step, once."""

    def __init__(self, at: int, **settings) -> None:
        super().__init__(**settings)
        self.stop = at

    def step(self, actions):
        if self.total + 1 == self.stop:
            self.stop = 0
            raise Stop
        return super().step(actions)
