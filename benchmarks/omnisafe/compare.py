"""Thalweg beside OmniSafe: the same algorithms with the same settings on the same toy, in turns on this machine.

    python -m benchmarks.omnisafe.compare speed
    python -m benchmarks.omnisafe.compare curves

from the root of the repository. `speed` writes speed.json, `curves` writes curves.csv and curves.png, and `write.py`
puts them into the page; with `--algorithms` the others' lines stay. Runs for the curves are kept in results/omnisafe/,
so that a killed one goes on where it was. `contests.py` says what is set. OmniSafe gets a virtual environment of its
own, made at the first call. It is no part of CI: all of `curves` takes hours.
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
from thalweg.core.versions import ALGORITHMS, TRAINING

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PEER, OURS = SIDES = "OmniSafe", "Thalweg"
HALF = "Thalweg, bfloat16"
"""Our planners once more, with products of half the bits; of speed only."""
SPEED, CURVES, FIGURE = HERE / "speed.json", HERE / "curves.csv", HERE / "curves.png"
KEPT = ROOT / "results" / "omnisafe"
TOY = 1
"""Version of the toy and of both runners (`side.py`, `ours.py`), raised by hand when their behaviour changes."""
BINS = 25
"""Points of a curve: means over the episodes that ended in so many equal stretches."""
COLUMNS = ("algorithm", "side", "seed", "step", "return", "cost", "episodes")


def order_of(contest: Contest, work: Work, side: str, seed: int, threads: int | None = None) -> dict[str, Any]:
    """What `side.py` or `ours.py` is to do; with the contest's threads if none are given."""
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


def carry_out(python: Path, side: str, order: dict[str, Any]) -> dict[str, Any]:
    """The answer of a side, which runs in a process of its own."""
    ours = [sys.executable, "-m", "benchmarks.omnisafe.ours"]
    command = [str(python), "-E", "-s", str(HERE / "side.py")] if side == PEER else ours
    done = subprocess.run(command, input=json.dumps(order), capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode:
        raise RuntimeError(f"{side}'s {order['algorithm']} failed:\n{last_lines(done.stderr)}")
    return json.loads(done.stdout)


def rates(contest: Contest, work: Work, answer: dict[str, Any]) -> tuple[float, float | None]:
    """Units a second, and a second of the processor, from the end of the random steps to the end of all, learning
    included; of decisions only those in the time that they alone took."""
    if contest.unit == "decisions":
        count, seconds = decided(work, answer)
        return count / seconds, None
    first = next(stamp for stamp in answer["stamps"] if stamp[0] >= work.start)
    steps, wall, processor = (end - begin for begin, end in zip(first, answer["stamps"][-1], strict=True))
    return steps / wall, steps / processor


def decided(work: Work, answer: dict[str, Any]) -> tuple[float, float]:
    """How many decisions a planner took, and the seconds of them: OmniSafe's each by itself, Thalweg's by update."""
    if "decisions" in answer:
        return len(answer["decisions"]), sum(answer["decisions"])
    before = max([steps for steps, _ in answer["acting"] if steps <= work.start], default=0)
    last = answer["acting"][-1][0]
    return (last - before) / ACTION_REPEAT, sum(seconds for steps, seconds in answer["acting"] if steps > before)


def sides_of(contest: Contest) -> tuple[str, ...]:
    """Who is measured: of planners we twice."""
    return (*SIDES, HALF) if contest.unit == "decisions" else SIDES


def in_turns(
    contests: Sequence[Contest], turn: int, sides: Callable[[Contest], tuple[str, ...]]
) -> list[tuple[Contest, str]]:
    """Who is measured when: each second turn backwards, so that no place is better."""
    order = [(contest, side) for contest in contests for side in sides(contest)]
    return order[::-1] if turn % 2 else order


def others(out: Path, contests: Sequence[Contest], here: dict[str, Any]) -> list[dict[str, Any]]:
    """Lines of algorithms that are not measured now, if they were on this machine with these versions."""
    found = json.loads(out.read_text()) if out.exists() else {}
    if any(found.get(name) != here[name] for name in ("machine", "versions")):
        return []
    now = {contest.algorithm for contest in contests}
    return [line for line in found["lines"] if line["algorithm"] not in now]


def measure_speed(python: Path, contests: Sequence[Contest], repeats: int, out: Path) -> None:
    """Write the rates of all sides, and how much each did, after each turn; those of other algorithms stay."""
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    before = {"machine": machine_info(), "load_before": os.getloadavg()[0], "versions": package_versions()}
    kept = others(out, contests, before)
    for turn in range(repeats):
        for contest, side in in_turns(contests, turn, sides_of):
            answer = carry_out(python, side, order_of(contest, contest.works.speed, side, turn))
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
            done = f"{side}'s {contest.algorithm}, {wall:.3g} {contest.unit} a second"
            print(f"{turn + 1} of {repeats}: {done}", flush=True)
        write_atomic(out, json.dumps(before | {"lines": [*kept, *lines.values()]}, indent=2) + "\n")


def run_versions(side: str, algorithm: str) -> dict[str, int]:
    """Versions that a run's numbers depend on: the toy, and on our side the algorithm and training."""
    ours = {} if side == PEER else {"algorithm": ALGORITHMS[algorithm], "training": TRAINING}
    return {"toy": TOY} | ours


def kept_answer(python: Path, contest: Contest, side: str, seed: int) -> dict[str, Any]:
    """The result of a run for the curves: computed once, and reused while its order and versions are the same."""
    order = order_of(contest, contest.works.curves, side, seed, threads=1)  # other work may go on beside it
    identity = json.dumps([order, run_versions(side, contest.algorithm)], sort_keys=True)
    key = hashlib.sha256(identity.encode()).hexdigest()[:12]
    file = KEPT / f"{contest.algorithm}-{side}-{seed}-{key}.json"
    if not file.exists():
        print(f"{side}'s {contest.algorithm}, seed {seed}", flush=True)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, json.dumps(carry_out(python, side, order)))
    return json.loads(file.read_text())


def binned(episodes: Sequence[Sequence[float]], steps: int, bins: int = BINS) -> list[tuple[int, float, float, int]]:
    """(last step, mean return, mean cost, episodes) of each stretch in which an episode ended."""
    found = []
    for place in range(bins):
        begin, end = steps * place // bins, steps * (place + 1) // bins
        there = [episode for episode in episodes if begin < episode[0] <= end]
        if there:
            means = (statistics.fmean(episode[column] for episode in there) for column in (1, 2))
            found.append((end, *means, len(there)))
    return found


def draw_curves(python: Path, contests: Sequence[Contest], seeds: int) -> None:
    """Train both sides, and write the table and the figure; the rows of other algorithms stay."""
    chosen = {contest.algorithm for contest in contests}
    rows: list[dict[str, Any]] = list(read_csv(CURVES, COLUMNS)) if CURVES.exists() else []
    table = [row for row in rows if row["algorithm"] not in chosen]
    for seed in range(seeds):
        for contest, side in in_turns(contests, seed, lambda _: SIDES):
            answer = kept_answer(python, contest, side, seed)
            for step, paid, cost, count in binned(answer["episodes"], contest.works.curves.steps):
                row = {"algorithm": contest.algorithm, "side": side, "seed": seed, "step": step}
                table.append(row | {"return": f"{paid:.4f}", "cost": f"{cost:.4f}", "episodes": count})
    names = [contest.algorithm for contest in CONTESTS]
    place = {name: number for number, name in enumerate(names)}
    table.sort(key=lambda row: (place[row["algorithm"]], SIDES.index(row["side"]), int(row["seed"]), int(row["step"])))
    write_atomic(CURVES, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in table)))
    plot.draw(CURVES, FIGURE)


def main() -> int:
    parser = argparse.ArgumentParser(description="Thalweg beside OmniSafe on a toy")
    parser.add_argument("what", choices=("speed", "curves"))
    parser.add_argument("--algorithms", nargs="+", choices=[contest.algorithm for contest in CONTESTS])
    parser.add_argument("--repeats", type=int, default=3, help="of the speed")
    parser.add_argument("--seeds", type=int, default=3, help="of the curves")
    parser.add_argument("--python", help="a Python 3.11 for OmniSafe; else the one on the path")
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
