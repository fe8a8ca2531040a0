"""Which settings are an algorithm's defaults? A search on Medium, written down before it is run.

At most eight trials of 50,000 steps for each algorithm, with a training seed that no study uses. Of the trials whose
last 100 episodes kept the limit (with a margin for their number), the one with the highest return wins. Where none kept
it, which so short a run hardly can on Medium, a trial takes the place of the defaults if it has both more return and
less cost; and none that misses a known answer of CI which the defaults reach. (The second rule was to be the lowest
cost, until the first trials showed that whoever does nothing would win; the third was added when OnCRPO's wider steps
had won by little, and swung about the limit of `dense`.) Planners are not searched: a trial of theirs takes too long.

Rows without a number are runs that went before the trials of off-policy algorithms, mostly of 30,000 steps, with the
same seed. They found that targets of costs need a floor (`cost_floor`) and multipliers less haste, which are defaults
since; after them the trials of learning rates gave way to those of `cost_critics`. The third rule does not cover what
the multipliers' defaults are: known answers have their own, in the units of their problems.

PPOLag's bound of λ was taken against the second rule, for its trial cost more than the defaults: a run of 200,000 steps
with the bound of 10 had ended with neither return nor limit, λ at its bound and a policy that turned round at once,
while the bound of 2, which FOCOPS has, doubled the return of 50,000 steps.

    python benchmarks/search.py [ALGORITHM ...]

does what is left and appends a row to `search.csv` for each trial as it ends; a trial that was interrupted goes on.
"""

import argparse
import csv
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.algos.registry import algorithm_named
from thalweg.bench.csv_files import read_csv
from thalweg.core.config import to_plain
from thalweg.train.river import RiverTraining, load_compatible_encoder

HERE = Path(__file__).resolve().parent
TABLE = HERE / "search.csv"
STEPS, SEED, EPISODES = 50_000, 9001, 100
MARGIN = 0.06
"""Two standard errors of the mean of 100 costs of 0 or 1, one in ten of them 1."""

Trial = dict[str, Any]
TRIALS: dict[str, tuple[Trial, ...]] = {
    "PPO": ({}, {"entropy": 0.003}, {"learning_rate": 5e-4}, {"steps_per_update": 4096}),
    "PPOLag": (
        {},
        {"entropy": 0.003},
        {"multiplier_gain": 20.0, "multiplier_rate": 2.0},
        {"learning_rate": 5e-4},
        {"multiplier_max": 2.0},
    ),
    "FOCOPS": ({}, {"temperature": 1.0}, {"temperature": 0.25}, {"multiplier_max": 5.0}),
    "P3O": ({}, {"penalty": 5.0}, {"penalty": 1.0}, {"entropy": 0.003}),
    "OnCRPO": (
        {},
        {"trust_radius": 0.05},
        {"trust_radius": 0.05, "damping": 0.01},
        {"trust_radius": 0.05, "tolerance": 0.0},
    ),
    "CPO": ({}, {"trust_radius": 0.05}, {"trust_radius": 0.05, "damping": 0.01}),
    "CUP": ({}, {"entropy": 0.003}, {"multiplier_max": 5.0}),
    "DDPGLag": ({}, {"updates_per_step": 0.5}, {"cost_critics": 2}),
    "TD3Lag": ({}, {"updates_per_step": 0.5}, {"cost_critics": 2}),
    "SACLag": ({}, {"updates_per_step": 0.5}, {"entropy_share": 0.3}),
}
"""Settings that differ from the defaults that the search began with, trial by trial."""


def in_words(changes: Trial) -> str:
    return " ".join(f"{key}={value}" for key, value in changes.items()) or "none"


def run_trial(algorithm: str, number: int, folder: Path) -> dict[str, Any]:
    """Train, or go on; returns the row of the trial."""
    changes = TRIALS[algorithm][number]
    ground = RiverTraining("Medium", 16)
    result = ground.train(
        algorithm, load_compatible_encoder(None), steps=STEPS, seed=SEED, folder=folder, settings=changes or None
    )
    last = read_csv(folder / "episodes.csv", ("return", "cost"))[-EPISODES:]
    returns, costs = (np.array([float(row[name]) for row in last]) for name in ("return", "cost"))
    limit = to_plain(algorithm_named(algorithm).configure(changes)).get("cost_limit", float("nan"))
    return {
        "algorithm": algorithm,
        "trial": number,
        "changes": in_words(changes),
        "seed": SEED,
        "steps": STEPS,
        "return_mean": round(float(returns.mean()), 4),
        "cost_mean": round(float(costs.mean()), 4),
        "cost_limit": limit,
        "within": int(not costs.mean() > limit + MARGIN),
        "seconds": round(result.seconds, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("algorithms", nargs="*", default=list(TRIALS), help="all if none is named")
    parser.add_argument("--out", type=Path, default=Path("results/search"), help="folder of the runs")
    given = parser.parse_args()
    for name in given.algorithms:
        algorithm = algorithm_named(name).name
        for number, changes in enumerate(TRIALS[algorithm]):
            key = (algorithm, in_words(changes), str(STEPS))
            done = read_csv(TABLE, ("algorithm", "changes", "steps")) if TABLE.exists() else []
            if any((row["algorithm"], row["changes"], row["steps"]) == key for row in done):
                continue
            row = run_trial(algorithm, number, given.out / f"{algorithm} {in_words(changes)}")
            new = not TABLE.exists()
            with open(TABLE, "a", newline="") as file:
                writer = csv.DictWriter(file, list(row), lineterminator="\n")
                if new:
                    writer.writeheader()
                writer.writerow(row)
            print(" ".join(f"{key} {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
