"""Multipliers or budgets, and costs, over the steps of runs of `known_answer.py` that miss what is required.

All runs of SafeLOOP on `mixture` are here, since those that reach it show why one misses.

    python benchmarks/known_answer_traces.py [--only ALGORITHM ...]

trains those of `RUNS` that have no rows of today's versions again, which repeats them to the last bit, and writes their
reports into known_answer_traces.csv, one of each `INTERVAL` steps and the last. The pages of the algorithms say what
the rows show.
"""

import argparse
import math
from collections.abc import Mapping
from pathlib import Path

# The rows come first: they let the problems, which are part of the tests, be imported.
from known_answer_rows import HERE, folder_name, row_versions
from tables import Rows, put, rows_of, thinned

from tests.known_answer.harness import REQUIREMENTS, Case, trained
from thalweg.algos.constraint.cost_limits import cost_suffixes
from thalweg.bench.csv_files import read_csv

RUNS = (
    ("TD3Lag", "dense", 2),
    ("FOCOPS", "dense", 4),
    ("CUP", "dense", 2),
    ("CUP", "mixture", 0),
    ("CUP", "two", 1),
    ("PPOLag", "mixture", 1),
    ("PPOLag", "mixture", 2),
    ("OnCRPO", "two", 1),
    ("DDPGLag", "mixture", 3),
    ("TD3Lag", "end", 2),
    ("TD3Lag", "end", 3),
    ("TD3Lag", "end", 4),
    ("SACLag", "mixture", 4),
    ("DDPGLag", "end", 4),
    ("DDPGLag", "dense", 4),
    ("DDPGLag", "two", 3),
    ("DDPGLag", "two", 4),
    ("TD3Lag", "mixture", 0),
    ("SACLag", "end", 2),
    ("SACLag", "end", 3),
    ("TD3Lag", "two", 3),
    *(("SafeLOOP", "mixture", seed) for seed in range(5)),
)
"""Algorithm, problem and seed of each run."""
INTERVAL = 2048
"""Steps between two rows of a run."""
KEY = ("algorithm", "problem", "seed", "algorithm_version", "training_version")
COLUMNS = (*KEY, "steps", "multiplier", "budget", "cost_mean_50", "return_mean_50")
"""With two limits, `multiplier` has two numbers, for tight and for loose costs, and so has `budget`, what a plan of a
planner may cost; either is empty for an algorithm without. `cost_mean_50` is the sum of all costs."""
OF_LIMITS = ("multiplier", "budget")
"""Columns with a number for each limit."""


def key_of(algorithm: str, problem: str, seed: int) -> dict[str, str]:
    """Return the key of a run with today's versions."""
    return {"algorithm": algorithm, "problem": problem, "seed": str(seed)} | row_versions(algorithm)


def trace(case: Case, metrics: Rows) -> Rows:
    """Return steps, multipliers or budgets, and the mean cost and return of the last 50 episodes of a run."""
    limits = cost_suffixes(len(case.limit) if isinstance(case.limit, tuple) else 1)
    return [
        {
            "steps": row["steps"],
            **{name: " ".join(_rounded(row.get(f"{name}{at}", "nan")) for at in limits).strip() for name in OF_LIMITS},
            "cost_mean_50": _rounded(row["cost_mean_50"]),
            "return_mean_50": _rounded(row["return_mean_50"]),
        }
        for row in thinned(metrics, INTERVAL)
    ]


def _rounded(number: str) -> str:
    """Return a number with three decimal places; empty for NaN, before there is any."""
    return "" if math.isnan(float(number)) else f"{float(number):.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=REQUIREMENTS, default=list(REQUIREMENTS), help="algorithms to run")
    parser.add_argument(
        "--runs", type=Path, default=HERE.parent / "runs" / "known_answer_traces", help="folder of runs"
    )
    parser.add_argument("--out", type=Path, default=HERE / "known_answer_traces.csv", help="the table")
    chosen = parser.parse_args()
    for run in RUNS:
        key = key_of(*run)
        if run[0] not in chosen.only or any(key.items() <= row.items() for row in rows_of(chosen.out, COLUMNS)):
            continue
        algorithm, problem, seed = run
        case = Case(algorithm, "multidiscrete", problem)
        folder = chosen.runs / folder_name(case, seed)
        result = trained(case, seed, folder)
        print(f"{algorithm}, {problem}, seed {seed}: share {result.share:.3f}, costs {result.score.costs}", flush=True)
        new = [key | row for row in trace(case, read_csv(folder / "metrics.csv", ("steps",)))]
        put(chosen.out, COLUMNS, new, KEY[:3], place_of)


def place_of(row: Mapping[str, str]) -> int:
    """Return the place of a row in the table, which has the order of `RUNS`."""
    return RUNS.index((row["algorithm"], row["problem"], int(row["seed"])))


if __name__ == "__main__":
    main()
