"""Benchmark of every algorithm in every action space on problems with a known optimum, with five seeds.

    python benchmarks/known_answer.py --jobs 2

writes known_answer.csv, a row per run, and known_answer.md, a table per problem, into the folder of this script. Each
row is written when its run finishes, so that an interrupted benchmark resumes; an interrupted run resumes too, in the
folder `--runs`. A run that fails is a row with its error, and the next call runs it again. The requirements and
settings of each algorithm are data in `tests/known_answer/harness.py`: rows with other steps, settings (or defaults) or
problems are dropped and run again. Each row names the versions of the algorithm and of training
(`thalweg/core/versions.py`) that produced it; `--again` runs the rows of an algorithm again.
"""

import argparse
import hashlib
import json
import multiprocessing
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
import pandas as pd
from settings_hash import settings_hash

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # the problems are part of the tests

from tests.known_answer.harness import (  # noqa: E402
    ACTION_SETUPS,
    EXCESS,
    LEAST_EXCESS,
    REQUIREMENTS,
    SHARE,
    Case,
    Result,
    cases,
    reference,
    trained,
)
from tests.known_answer.problems import PROBLEMS  # noqa: E402
from tests.known_answer.scores import Score  # noqa: E402
from thalweg.algos import ALGORITHMS  # noqa: E402
from thalweg.bench.csv_files import csv_text, read_csv  # noqa: E402
from thalweg.bench.report.table import frame, markdown  # noqa: E402
from thalweg.core import versions  # noqa: E402
from thalweg.core.atomic_io import write_atomic  # noqa: E402
from thalweg.core.config import to_plain  # noqa: E402

SEEDS = 5
KEY = ("algorithm", "place", "problem", "tables", "seed", "steps", "settings", "config")
"""Columns that identify a run; a row that no planned run matches is dropped."""
COLUMNS = (
    *KEY,
    "algorithm_version",
    "training_version",
    "reward",
    "reward_error",
    "costs",
    "cost_error",
    "error",
)
Table = dict[tuple[str, ...], dict[str, str]]
"""Rows by their key."""


def key(case: Case, seed: int) -> tuple[str, ...]:
    """Return the values of `KEY` for a run, with the changed settings and a hash of all settings."""
    config = json.dumps(case.config, sort_keys=True)
    tables = PROBLEMS[case.problem].digest
    settings = settings_hash(to_plain(ALGORITHMS[case.algorithm].configure(case.config)))
    return (
        case.algorithm,
        case.action_setup,
        case.problem,
        tables,
        str(seed),
        str(case.requirement.steps),
        settings,
        config,
    )


def row_versions(algorithm: str) -> dict[str, str]:
    """Return the versions that a run of the algorithm depends on, by their columns."""
    return {
        "algorithm_version": str(versions.ALGORITHMS[algorithm]),
        "training_version": str(versions.TRAINING),
    }


def finished(path: Path) -> Table:
    """Return the rows of the table that match a planned run, by their key."""
    rows = read_csv(path, COLUMNS) if path.is_file() else []
    table = {tuple(row[name] for name in KEY): row for row in rows}
    planned = {key(case, seed) for case in cases() for seed in {int(row["seed"]) for row in rows}}
    return {name: row for name, row in table.items() if name in planned}


def measure(case: Case, seed: int, runs: Path) -> dict[str, str]:
    """Train, or resume, and score a run; returns its row."""
    name = key(case, seed)
    folder = hashlib.sha256(repr((row_versions(case.algorithm), name)).encode()).hexdigest()[:16]
    result = trained(case, seed, runs / f"{case.algorithm}-{case.action_setup}-{case.problem}-{seed}-{folder}")
    score = result.score
    return {
        **dict(zip(KEY, name, strict=True)),
        **row_versions(case.algorithm),
        "reward": f"{score.reward:.4f}",
        "reward_error": f"{score.reward_error:.4f}",
        "costs": " ".join(f"{cost:.4f}" for cost in score.costs),
        "cost_error": f"{score.cost_error:.4f}",
        "error": "",
    }


def failure(case: Case, seed: int, error: BaseException) -> dict[str, str]:
    """Return the row of a failed run."""
    row = dict.fromkeys(COLUMNS, "") | row_versions(case.algorithm) | {"error": f"{type(error).__name__}: {error}"}
    return row | dict(zip(KEY, key(case, seed), strict=True))


def result_of(case: Case, row: dict[str, str]) -> Result:
    """Return the result of a successful run's row, compared with the current optimum."""
    costs = np.array([float(cost) for cost in row["costs"].split()])
    score = Score(float(row["reward"]), costs, float(row["reward_error"]), float(row["cost_error"]))
    return Result(case, score, reference(case))


def remaining(planned: Sequence[tuple[Case, int]], rows: Table) -> list[tuple[Case, int]]:
    """Return the runs that have no row yet, or that failed."""
    done = {name for name, row in rows.items() if not row["error"]}
    return [(case, seed) for case, seed in planned if key(case, seed) not in done]


def write(path: Path, rows: Table) -> None:
    """Write the table, sorted by its keys."""
    write_atomic(path, csv_text(COLUMNS, ([rows[name][column] for column in COLUMNS] for name in sorted(rows))))


def page(rows: Table, seeds: int) -> str:
    """Return the Markdown page, with a table for each problem."""
    introduction = (
        f"Return of the final policy as a share of the optimum, and its cost, means over up to {seeds} seeds. In"
        f" brackets: the number of seeds that reached {SHARE:.0%} with a cost at most {EXCESS:.0%} or {LEAST_EXCESS}"
        " above the limit, out of those that were run. **Bold**: at least one missed this, or failed. `box_literal` is"
        " shown for comparison only. The optimum of PPO has no limit, that of DDPG and TD3 is the best deterministic"
        " policy, and that of planners a perfect planner with their horizon."
    )
    sections = [introduction]
    for name, problem in PROBLEMS.items():
        limits = " and ".join(f"{limit:g}" for limit in problem.limits)
        table = markdown(_problem_table(rows, name, seeds)).rstrip()
        sections.append(f"## {name}: limit {limits}\n\n{table}")
    return "\n\n".join(sections) + "\n"


def _problem_table(rows: Table, problem: str, seeds: int) -> pd.DataFrame:
    """Return the table of a problem, with a row for each algorithm that is run on it."""
    lines = []
    for algorithm, requirement in REQUIREMENTS.items():
        if problem not in requirement.problems:
            continue
        at = {setup: Case(algorithm, setup, problem) for setup in requirement.action_setups}
        best = reference(next(iter(at.values())))
        found = [_entry(rows, at[setup], seeds) if setup in at else "" for setup in ACTION_SETUPS]
        lines.append([algorithm, f"{best.reward:.2f}, {_costs([best.costs.tolist()])}", *found])
    return frame(["algorithm", "optimum: return, cost", *ACTION_SETUPS], lines)


def _entry(rows: Table, case: Case, seeds: int) -> str:
    """Return the entry of a case: share and cost of its runs, and the number of them that reached the optimum."""
    runs = [rows[name] for name in (key(case, seed) for seed in range(seeds)) if name in rows]
    results = [result_of(case, run) for run in runs if not run["error"]]
    if not results:
        return "**failed**" if runs else "not run"
    share = statistics.mean(result.share for result in results)
    costs = _costs([result.score.costs.tolist() for result in results])
    reached = sum(result.reached for result in results)
    text = f"{share:.0%}, {costs} ({reached}/{len(runs)})"
    return text if reached == len(runs) or case.action_setup == "box_literal" else f"**{text}**"


def _costs(costs: Sequence[Sequence[float]]) -> str:
    """Return the mean of each kind of cost as text."""
    return " + ".join(f"{statistics.mean(kind):.3f}" for kind in zip(*costs, strict=True))


def main() -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="+", choices=REQUIREMENTS, default=list(REQUIREMENTS), help="algorithms to run now"
    )
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS), help="problems to run now")
    parser.add_argument(
        "--spaces", nargs="+", choices=ACTION_SETUPS, default=list(ACTION_SETUPS), help="action spaces to run now"
    )
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of seeds, counted from 0")
    parser.add_argument("--again", nargs="+", choices=REQUIREMENTS, default=[], help="run these algorithms again")
    parser.add_argument("--jobs", type=int, default=1, help="parallel runs, one thread each")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "known_answer", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for known_answer.csv and known_answer.md")
    chosen = parser.parse_args()
    if chosen.seeds < 1 or chosen.jobs < 1:
        parser.error("--seeds and --jobs must be at least 1")

    path = chosen.out / "known_answer.csv"
    rows = {name: row for name, row in finished(path).items() if row["algorithm"] not in chosen.again}
    chosen_cases = [case for case in cases(chosen.only, chosen.problems) if case.action_setup in chosen.spaces]
    planned = [(case, seed) for seed in range(chosen.seeds) for case in chosen_cases]
    unfinished = remaining(planned, rows)
    print(f"{len(planned) - len(unfinished)} of {len(planned)} runs are finished", flush=True)
    failed = 0
    with ProcessPoolExecutor(chosen.jobs, multiprocessing.get_context("spawn")) as pool:
        futures = {pool.submit(measure, case, seed, chosen.runs): (case, seed) for case, seed in unfinished}
        for ended in as_completed(futures):
            case, seed = futures[ended]
            error = ended.exception()
            row = rows[key(case, seed)] = ended.result() if error is None else failure(case, seed, error)
            write(path, rows)
            result = None if error else result_of(case, row)
            failed += result is None
            outcome = (
                f"share {result.share:.3f}, costs {row['costs']}, reached {result.reached}" if result else row["error"]
            )
            print(f"{case.algorithm}, {case.action_setup}, {case.problem}, seed {seed}: {outcome}", flush=True)
    write_atomic(chosen.out / "known_answer.md", page(rows, chosen.seeds))
    return f"{failed} runs failed" if failed else None


if __name__ == "__main__":
    sys.exit(main())
