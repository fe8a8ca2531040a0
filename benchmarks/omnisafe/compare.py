"""Comparison with OmniSafe: the same algorithms with the same settings on the same toy, in turns on this machine.

    python -m benchmarks.omnisafe.compare speed
    python -m benchmarks.omnisafe.compare curves

run from the root of the repository. `speed` writes speed.json, `curves` writes curves.csv and curves.png, and
`write.py` puts the figures into the page. With `--algorithms`, the rows of all other algorithms are kept. Finished runs
for the curves are cached in results/omnisafe/, so an interrupted comparison continues with the next run. `contests.py`
has the settings. The first call creates a virtual environment for OmniSafe. CI does not run the comparison, since the
curves take hours.
"""

import argparse
import hashlib
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.omnisafe import plot
from benchmarks.omnisafe.contests import ACTION_REPEAT, CONTESTS, Contest, Work, merged
from benchmarks.omnisafe.environment import python_with_omnisafe
from benchmarks.peer_venv import SetupError, last_lines
from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.core.atomic_io import write_atomic
from thalweg.core.machine import machine_info, package_versions
from thalweg.core.parent_process import ending_with_parent
from thalweg.core.versions import ALGORITHMS, TRAINING

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PEER, OURS = SIDES = "OmniSafe", "Thalweg"
HALF = "Thalweg, bfloat16"
"""Thalweg's planners with products in bfloat16; only their speed is measured."""
SPEED, CURVES, FIGURE = HERE / "speed.json", HERE / "curves.csv", HERE / "curves.png"
RUNS = ROOT / "results" / "omnisafe"
TOY = 1
"""Version of the toy and of both runners (`side.py`, `ours.py`), raised by hand when their behaviour changes."""
BINS = 25
"""Points of a curve: means over the episodes that ended in each of as many intervals of equal length."""
COLUMNS = ("algorithm", "side", "version", "seed", "step", "return", "cost", "episodes")
"""`version` is that of Thalweg's algorithm; OmniSafe's rows have none."""


def request_for(contest: Contest, work: Work, side: str, seed: int, threads: int | None = None) -> dict[str, Any]:
    """Return the request for `side.py` or `ours.py`; `threads` are by default those of the contest."""
    threads = threads or contest.threads[PEER if side == PEER else OURS]
    if side == PEER:
        settings = merged(work.peer, {"seed": seed, "train_cfgs": {"torch_threads": threads}})
        return {"algorithm": contest.algorithm, "settings": settings, "stamp_every": work.stamp_every}
    return {
        "algorithm": contest.algorithm,
        "preset": "paper",
        "config": dict(work.ours) | ({"precision": "bfloat16"} if side == HALF else {}),
        "steps": work.steps,
        "stamp_every": work.stamp_every,
        "seed": seed,
        "envs": contest.envs,
        "threads": threads,
    }


def run_side(python: Path, side: str, order: dict[str, Any]) -> dict[str, Any]:
    """Run one side in a process of its own; returns its answer, or raises `RuntimeError` with its last output."""
    ours = [sys.executable, "-m", "benchmarks.omnisafe.ours"]
    command = ending_with_parent([str(python), "-E", "-s", str(HERE / "side.py")] if side == PEER else ours)
    done = subprocess.run(command, input=json.dumps(order), capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode:
        raise RuntimeError(f"{side}'s {order['algorithm']} failed:\n{last_lines(done.stderr)}")
    return json.loads(done.stdout)


def rates(contest: Contest, work: Work, answer: dict[str, Any]) -> tuple[float, float | None]:
    """Return units per second of the clock and of processor time.

    Steps are counted from the end of the random ones, and their time includes learning. Decisions of planners are
    counted over the time that they alone take, for which no processor time is known.
    """
    if contest.unit == "decisions":
        count, seconds = decided(work, answer)
        return count / seconds, None
    first = next(stamp for stamp in answer["stamps"] if stamp[0] >= work.start)
    steps, wall, processor = (end - begin for begin, end in zip(first, answer["stamps"][-1], strict=True))
    return steps / wall, steps / processor


def decided(work: Work, answer: dict[str, Any]) -> tuple[float, float]:
    """Return the number of a planner's decisions and their seconds: OmniSafe times each one, Thalweg each update."""
    if "decisions" in answer:
        return len(answer["decisions"]), sum(answer["decisions"])
    before = max([steps for steps, _ in answer["acting"] if steps <= work.start], default=0)
    last = answer["acting"][-1][0]
    return (last - before) / ACTION_REPEAT, sum(seconds for steps, seconds in answer["acting"] if steps > before)


def sides_of(contest: Contest) -> tuple[str, ...]:
    """Return the sides that are measured; planners of Thalweg are measured in both precisions."""
    return (*SIDES, HALF) if contest.unit == "decisions" else SIDES


def in_turns(
    contests: Sequence[Contest], turn: int, sides: Callable[[Contest], tuple[str, ...]]
) -> list[tuple[Contest, str]]:
    """Return the measurements of a turn; every second turn is reversed, so that no position has an advantage."""
    order = [(contest, side) for contest in contests for side in sides(contest)]
    return order[::-1] if turn % 2 else order


def lines_of_others(out: Path, contests: Sequence[Contest], here: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the lines of algorithms that are not measured now, if machine and versions are the same."""
    found = json.loads(out.read_text()) if out.exists() else {}
    if any(found.get(name) != here[name] for name in ("machine", "versions")):
        return []
    now = {contest.algorithm for contest in contests}
    return [line for line in found["lines"] if line["algorithm"] not in now]


def measure_speed(python: Path, contests: Sequence[Contest], repeats: int, out: Path) -> None:
    """Write the rates and the work of all sides after each turn; lines of other algorithms are kept."""
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    before = {"machine": machine_info(), "load_before": os.getloadavg()[0], "versions": package_versions()}
    unchanged = lines_of_others(out, contests, before)
    for turn in range(repeats):
        for contest, side in in_turns(contests, turn, sides_of):
            answer = run_side(python, side, request_for(contest, contest.works.speed, side, turn))
            line = lines.setdefault(
                (contest.algorithm, side),
                {"algorithm": contest.algorithm, "side": side, "unit": contest.unit, "rates": [], "by_processor": []},
            )
            wall, processor = rates(contest, contest.works.speed, answer)
            line["rates"].append(wall)
            if processor is not None:
                line["by_processor"].append(processor)
            line |= {
                "threads": contest.threads[PEER if side == PEER else OURS],
                "steps": answer["stamps"][-1][0],
                "gradient_steps": answer["gradient_steps"],
                "environment_s": answer["environment_s"],
            }
            if side == PEER:
                before["peer"] = answer["versions"]
            else:
                line["version"] = ALGORITHMS[contest.algorithm]
            done = f"{side}'s {contest.algorithm}, {wall:.3g} {contest.unit} a second"
            print(f"{turn + 1} of {repeats}: {done}", flush=True)
        write_atomic(out, json.dumps(before | {"lines": [*unchanged, *lines.values()]}, indent=2) + "\n")


def run_versions(side: str, algorithm: str) -> dict[str, int]:
    """Return the versions that a run depends on: the toy and, for Thalweg, the algorithm and training."""
    ours = {} if side == PEER else {"algorithm": ALGORITHMS[algorithm], "training": TRAINING}
    return {"toy": TOY} | ours


def cached_answer(python: Path, contest: Contest, side: str, seed: int) -> dict[str, Any]:
    """Return the answer of a run for the curves, which is reused while its request and versions are the same."""
    order = request_for(contest, contest.works.curves, side, seed, threads=1)  # other work may run at the same time
    identity = json.dumps([order, run_versions(side, contest.algorithm)], sort_keys=True)
    key = hashlib.sha256(identity.encode()).hexdigest()[:12]
    file = RUNS / f"{contest.algorithm}-{side}-{seed}-{key}.json"
    if not file.exists():
        print(f"{side}'s {contest.algorithm}, seed {seed}", flush=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, json.dumps(run_side(python, side, order)))
    return json.loads(file.read_text())


def binned(episodes: Sequence[Sequence[float]], steps: int, bins: int = BINS) -> list[tuple[int, float, float, int]]:
    """Return (last step, mean return, mean cost, episodes) of each interval in which an episode ended."""
    found = []
    for index in range(bins):
        begin, end = steps * index // bins, steps * (index + 1) // bins
        there = [episode for episode in episodes if begin < episode[0] <= end]
        if there:
            means = (statistics.fmean(episode[column] for episode in there) for column in (1, 2))
            found.append((end, *means, len(there)))
    return found


def draw_curves(python: Path, contests: Sequence[Contest], seeds: int) -> None:
    """Train both sides, and write the table and the figure; rows of other algorithms are kept."""
    chosen = {contest.algorithm for contest in contests}
    rows: list[dict[str, Any]] = list(read_csv(CURVES, COLUMNS)) if CURVES.exists() else []
    table = [row for row in rows if row["algorithm"] not in chosen]
    for seed in range(seeds):
        for contest, side in in_turns(contests, seed, lambda _: SIDES):
            answer = cached_answer(python, contest, side, seed)
            for step, return_, cost, count in binned(answer["episodes"], contest.works.curves.steps):
                version = ALGORITHMS[contest.algorithm] if side == OURS else ""
                row = {"algorithm": contest.algorithm, "side": side, "version": version, "seed": seed, "step": step}
                table.append(row | {"return": f"{return_:.4f}", "cost": f"{cost:.4f}", "episodes": count})
    names = [contest.algorithm for contest in CONTESTS]
    position = {name: index for index, name in enumerate(names)}
    table.sort(
        key=lambda row: (position[row["algorithm"]], SIDES.index(row["side"]), int(row["seed"]), int(row["step"]))
    )
    write_atomic(CURVES, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in table)))
    plot.draw(CURVES, FIGURE)


def main() -> int:
    parser = argparse.ArgumentParser(description="Compare Thalweg with OmniSafe on a toy problem.")
    parser.add_argument("what", choices=("speed", "curves"), help="what to measure")
    parser.add_argument(
        "--algorithms", nargs="+", choices=[contest.algorithm for contest in CONTESTS], help="default: all"
    )
    parser.add_argument("--repeats", type=int, default=3, help="repetitions of each speed measurement")
    parser.add_argument("--seeds", type=int, default=3, help="number of training seeds for the curves")
    parser.add_argument("--python", help="Python 3.11 for OmniSafe; default: the one on the path")
    given = parser.parse_args()
    if min(given.repeats, given.seeds) < 1:
        parser.error("at least one repetition and one seed")
    chosen = [c for c in CONTESTS if not given.algorithms or c.algorithm in given.algorithms]
    try:
        python = python_with_omnisafe(given.python)
    except SetupError as error:
        print(error, file=sys.stderr)
        return 1
    if given.what == "speed":
        measure_speed(python, chosen, given.repeats, SPEED)
    else:
        draw_curves(python, chosen, given.seeds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
