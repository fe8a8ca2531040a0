"""Thalweg on the toy, in a process of its own: the counterpart of `side.py`, which answers the same order alike.

An order names the `algorithm`, the `config`, the `preset`, `steps`, `seed`, `envs` and `threads`. Stamps are the rows
of metrics.csv, so the first lies after the first update, not before; all else is told in `side.py`.
"""

import csv
import inspect
import json
import os
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from torch.optim.optimizer import register_optimizer_step_post_hook

from benchmarks.omnisafe.toy_vector import ToyVectorEnv
from thalweg.train.machine import versions
from thalweg.train.run import run


def carry_out(order: dict, folder: Path) -> dict:
    """Train as ordered; the answer as in `side.py`, with `act_s`, the seconds of acting since each of the stamps."""
    steps = [0]

    def count(*_: Any) -> None:
        steps[0] += 1

    register_optimizer_step_post_hook(count)
    given: dict[str, Any] = {name: order[name] for name in ("steps", "seed", "config", "threads")}
    if "preset" in inspect.signature(run).parameters:
        given["preset"] = order["preset"]
    run(order["algorithm"], ToyVectorEnv(order["envs"]), folder=folder, **given)
    metrics, episodes = rows(folder / "metrics.csv"), rows(folder / "episodes.csv")
    return {
        "episodes": [
            [int(row["step"]), *(float(row[name]) for name in ("return", "cost", "length"))] for row in episodes
        ],
        "stamps": [[0, 0.0], *([int(row["steps"]), float(row["seconds"])] for row in metrics)],
        "act_s": [float(row["time_act"]) for row in metrics],
        "environment_s": sum(float(row["time_env"]) for row in metrics),
        "gradient_steps": {"all networks": steps[0]},
        "passes": [float(row["passes"]) for row in metrics if row.get("passes")],
        "versions": versions(),
    }


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as text:
        return list(csv.DictReader(text))


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    warnings.simplefilter("ignore")  # short runs cannot do what training warns of
    order = json.load(sys.stdin)
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(carry_out(order, Path(folder) / "run")), file=answers, flush=True)


if __name__ == "__main__":
    main()
