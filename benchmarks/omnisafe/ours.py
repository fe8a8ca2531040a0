"""Thalweg's side of the comparison, in a process of its own: the counterpart of `side.py`.

A request has the `algorithm`, the `config`, the `preset`, `steps`, `seed`, `envs`, `threads` and `stamp_every`. The
answer is that of `side.py`, except

* acting: [steps, seconds of acting] of each update, instead of decisions;
* passes: number of passes of each update over its steps, for algorithms that log it.
"""

import csv
import json
import math
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from benchmarks.omnisafe.toy_vector import ToyVectorEnv
from thalweg.algos.common.adam import Adam
from thalweg.algos.policy.networks import Critics
from thalweg.core.machine import package_versions
from thalweg.train.run import run


class Stamped(ToyVectorEnv):
    """The toy, with a time stamp after every `every` steps."""

    def __init__(self, num_envs: int, every: int) -> None:
        super().__init__(num_envs)
        self.every, self.steps, self.stamps = every, 0, []

    def step(self, actions: np.ndarray) -> tuple:
        if self.steps // self.every >= len(self.stamps):
            self.stamp()
        self.steps += self.num_envs
        return super().step(actions)

    def stamp(self) -> None:
        self.stamps.append((self.steps, time.perf_counter(), time.process_time()))


def run_request(order: dict, folder: Path) -> dict:
    """Train as requested; returns the answer."""
    counted = {"networks": 0, "critics in loops": 0}
    step, fit_epoch = Adam.step, Critics.fit_epoch

    def counting(self: Adam, max_norm: float = math.inf) -> None:
        counted["networks"] += 1
        step(self, max_norm)

    def passing(self: Critics, *given: Any, **named: Any) -> Tensor:
        errors = fit_epoch(self, *given, **named)
        counted["critics in loops"] += len(errors)
        return errors

    Adam.step, Critics.fit_epoch = counting, passing  # pyright: ignore[reportAttributeAccessIssue]
    given = {name: order[name] for name in ("steps", "seed", "config", "threads", "preset")}
    env = Stamped(order["envs"], order["stamp_every"])
    run(order["algorithm"], env, folder=folder, **given)
    env.stamp()
    metrics, episodes = rows(folder / "metrics.csv"), rows(folder / "episodes.csv")
    return {
        "episodes": [
            [int(row["step"]), *(float(row[name]) for name in ("return", "cost", "length"))] for row in episodes
        ],
        "stamps": env.stamps,
        "acting": [[int(row["steps"]), float(row["time_act"])] for row in metrics],
        "environment_s": sum(float(row["time_env"]) for row in metrics),
        "gradient_steps": {name: count for name, count in counted.items() if count},
        "passes": [float(row["passes"]) for row in metrics if row.get("passes")],
        "versions": package_versions(),
    }


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as text:
        return list(csv.DictReader(text))


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    warnings.simplefilter("ignore")  # short runs cause warnings that do not matter here
    order = json.load(sys.stdin)
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(run_request(order, Path(folder) / "run")), file=answers, flush=True)


if __name__ == "__main__":
    main()
