"""Voyages of the boat's pilot from one random start on each of 300 rivers of each level that boats have.

    python benchmarks/boat_pilot.py                       # resumes; rivers with a row of today's are not run again
    python benchmarks/boat_pilot.py --levels Easy --seeds 3000:3010 --out trial.csv
    python benchmarks/boat_pilot.py --write               # the table of docs/boats.md

boat_pilot.csv has a row for each river: its return, of 10, the costs by kind, the length, the reason of the end, and
the versions that these depend on; rows of other versions are run again. The pilot knows the map. It shows that each of
these rivers can be run at no cost, from wherever an episode begins.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from gymnasium.vector import AutoresetMode
from page_sections import replace_section
from tables import of_versions, put, rows_of

from thalweg import BOAT_IDS
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.seeds import parse_seeds
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.rivers.sounded_river import load_or_sound
from thalweg.world import level_named

PAGE = Path(__file__).resolve().parent.parent / "docs" / "boats.md"
TABLE = Path(__file__).resolve().with_suffix(".csv")
VERSIONS = {"world": str(versions.WORLD), "rules": str(versions.RULES), "vehicles": str(versions.VEHICLES)}
"""What a row depends on, by its columns."""
COLUMNS = ("level", "seed", "return", "tight", "loose", "shallow", "length", "reason", *VERSIONS)
SEEDS = "3000:3300"
"""Seeds of the rivers of each level."""
PLANNED = len(parse_seeds(SEEDS))
"""Their number."""
TOGETHER = 25
"""Rivers that are run at a time, after which the table is written."""


def voyages(level: str, seeds: Sequence[int]) -> Iterator[dict[str, str]]:
    """Yield the rows of rivers: the pilot's episode from the first start of each, whose generator has the river's
    seed."""
    worlds = [load_or_sound(level_named(level), seed) for seed in seeds]
    config = EnvConfig(vehicle="asv", observation="none")
    env = RiverVectorEnv(worlds, len(worlds), config, autoreset_mode=AutoresetMode.NEXT_STEP)
    env.reset(seed=list(seeds))
    returns, costs = np.zeros(env.num_envs), np.zeros((env.num_envs, 3))
    lengths, reasons = np.zeros(env.num_envs, int), np.full(env.num_envs, DoneReason.RUNNING)
    while (running := reasons < 0).any():
        _, reward, _, _, info = env.step(env.pilot_actions())
        returns[running] += reward[running]
        costs[running] += info["costs"][running]
        lengths[running] += 1
        reasons[running] = info["done_reason"][running]
    for row, seed in enumerate(seeds):
        values = level, seed, f"{returns[row]:.4f}", *(f"{cost:.4f}" for cost in costs[row])
        told = *values, lengths[row], DoneReason(reasons[row]).label
        yield dict(zip(COLUMNS, map(str, (*told, *VERSIONS.values())), strict=True))


def place_of(row: Mapping[str, str]) -> tuple[int, int]:
    """Return the place of a row in the table: by level and river."""
    return list(BOAT_IDS).index(row["level"]), int(row["seed"])


def page_section(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the page, a line for each level: rivers, the least return, rivers without any cost, and the
    greatest length."""
    lines = []
    for level in BOAT_IDS if rows else ():
        own = [row for row in rows if row["level"] == level]
        free = sum(all(float(row[kind]) == 0.0 for kind in ("tight", "loose", "shallow")) for row in own)
        if not own:
            lines.append([level, f"0 of {PLANNED}", *["not measured"] * 3])
            continue
        least = min(float(row["return"]) for row in own)
        longest = max(int(row["length"]) for row in own)
        count = str(len(own)) if len(own) >= PLANNED else f"{len(own)} of {PLANNED}"
        lines.append([level, count, f"{least:.2f}", str(free), str(longest)])
    if not lines:
        return "Nothing was measured with today's versions.\n"
    header = ["level", "rivers", "least return", "rivers at no cost", "longest, in steps"]
    return f"{markdown(frame(header, lines))}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", nargs="+", choices=tuple(BOAT_IDS), default=list(BOAT_IDS))
    parser.add_argument(
        "--seeds", nargs="+", default=[SEEDS], help=f"seeds of the rivers of each level, by default {SEEDS}"
    )
    parser.add_argument("--out", type=Path, default=TABLE, help="the table, to which missing rivers are added")
    parser.add_argument("--write", action="store_true", help="run nothing, but write the table of the page")
    given = parser.parse_args()
    if given.write:
        section = page_section(of_versions(rows_of(given.out, COLUMNS), VERSIONS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), "pilot", section))
        return
    try:
        seeds = parse_seeds(given.seeds, "--seeds", ValueError)
    except ValueError as error:
        parser.error(str(error))
    for level in given.levels:
        rows = of_versions(rows_of(given.out, COLUMNS), VERSIONS)
        known = {int(row["seed"]) for row in rows if row["level"] == level}
        missing = [seed for seed in seeds if seed not in known]
        for begin in range(0, len(missing), TOGETHER):
            run = voyages(level, missing[begin : begin + TOGETHER])
            rows = put(given.out, COLUMNS, run, ("level", "seed"), place_of)
            print(page_section(of_versions(rows, VERSIONS)), flush=True)


if __name__ == "__main__":
    main()
