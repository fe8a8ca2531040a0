"""Benchmark of every algorithm in every action space on problems with a known optimum, with five seeds.

    python benchmarks/known_answer.py --jobs 2

writes known_answer.csv, a row per run, and known_answer.md, a table per problem, into the folder of this script;
`--write` writes that table and the pages of the algorithms from the rows there are. Each row is written when its run
finishes, so that an interrupted benchmark resumes; an interrupted run resumes too, in the folder `--runs`. A run that
fails is a row with its error, and the next call runs it again. The requirements and settings of each algorithm are data
in `tests/known_answer/harness.py`: rows with other steps, settings (or defaults) or problems are dropped and run again.
Each row names the versions of the algorithm and of training (`thalweg/core/versions.py`) that produced it; `--again`
removes the rows and runs of an algorithm, as far as they are selected, and runs them again. Two commands may run at
once.
"""

import argparse
import multiprocessing
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

# The rows come first: they let the problems, which are part of the tests, be imported.
from known_answer_page import page, written_pages
from known_answer_rows import (
    COLUMNS,
    HERE,
    KEY,
    SEEDS,
    Table,
    finished,
    folder_name,
    key,
    planned_rows,
    result_of,
    row_versions,
)
from tables import Rows, change

from tests.known_answer.harness import ACTION_SETUPS, REQUIREMENTS, Case, cases, trained
from tests.known_answer.problems import PROBLEMS
from thalweg.core.atomic_io import write_atomic
from thalweg.core.parent_process import end_with_parent


def measure(case: Case, seed: int, runs: Path) -> dict[str, str]:
    """Train, or resume, and score a run; returns its row."""
    score = trained(case, seed, runs / folder_name(case, seed)).score
    return {
        **dict(zip(KEY, key(case, seed), strict=True)),
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


def remaining(planned: Sequence[tuple[Case, int]], rows: Table) -> list[tuple[Case, int]]:
    """Return the runs that have no row of today's versions yet, or that failed."""
    done = {
        name for name, row in rows.items() if not row["error"] and row_versions(row["algorithm"]).items() <= row.items()
    }
    return [(case, seed) for case, seed in planned if key(case, seed) not in done]


def put(path: Path, row: dict[str, str]) -> None:
    """Write a row into the table, in place of that of the same run; rows that no planned run matches are dropped."""
    own = {tuple(row[name] for name in KEY): row}
    change(path, COLUMNS, lambda rows: sorted_rows(planned_rows(rows) | own))


def forget(path: Path, again: Sequence[tuple[Case, int]], runs: Path) -> None:
    """Remove the rows and folders of runs, so that they are run again."""
    for case, seed in again:
        shutil.rmtree(runs / folder_name(case, seed), ignore_errors=True)
    names = {key(case, seed) for case, seed in again}

    def others(rows: Rows) -> Rows:
        return sorted_rows({name: row for name, row in planned_rows(rows).items() if name not in names})

    change(path, COLUMNS, others)


def sorted_rows(rows: Table) -> Rows:
    """Return the rows sorted by their keys."""
    return [rows[name] for name in sorted(rows)]


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
    parser.add_argument("--write", action="store_true", help="run nothing, but write known_answer.md and the pages")
    chosen = parser.parse_args()
    if chosen.seeds < 1 or chosen.jobs < 1:
        parser.error("--seeds and --jobs must be at least 1")

    if chosen.write and chosen.out != HERE:
        parser.error("--write is for the rows of this folder; leave --out out")

    path = chosen.out / "known_answer.csv"
    if chosen.write:
        rows = finished(path)
        write_atomic(chosen.out / "known_answer.md", page(rows, chosen.seeds))
        for target, text in written_pages(rows, chosen.seeds).items():
            write_atomic(target, text)
        return None
    chosen_cases = [case for case in cases(chosen.only, chosen.problems) if case.action_setup in chosen.spaces]
    planned = [(case, seed) for seed in range(chosen.seeds) for case in chosen_cases]
    if again := [(case, seed) for case, seed in planned if case.algorithm in chosen.again]:
        forget(path, again, chosen.runs)
    unfinished = remaining(planned, finished(path))
    print(f"{len(planned) - len(unfinished)} of {len(planned)} runs are finished", flush=True)
    failed = 0
    with ProcessPoolExecutor(chosen.jobs, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        futures = {pool.submit(measure, case, seed, chosen.runs): (case, seed) for case, seed in unfinished}
        for ended in as_completed(futures):
            case, seed = futures[ended]
            error = ended.exception()
            if isinstance(error, BrokenProcessPool):
                return f"a process was killed, perhaps for want of memory: {error}; the same command goes on"
            row = ended.result() if error is None else failure(case, seed, error)
            put(path, row)
            result = None if error else result_of(case, row)
            failed += result is None
            outcome = (
                f"share {result.share:.3f}, costs {row['costs']}, reached {result.reached}" if result else row["error"]
            )
            print(f"{case.algorithm}, {case.action_setup}, {case.problem}, seed {seed}: {outcome}", flush=True)
    write_atomic(chosen.out / "known_answer.md", page(finished(path), chosen.seeds))
    return f"{failed} runs failed" if failed else None


if __name__ == "__main__":
    sys.exit(main())
