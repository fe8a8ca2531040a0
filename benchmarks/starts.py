"""Starts at which a policy fails, by the angle off the course and by whether the first frame shows water.

    python benchmarks/starts.py                       # the packaged policy
    python benchmarks/starts.py --policy runs/student --out trial.csv
    python benchmarks/starts.py --write               # the table of docs/packaged-policy.md

Every start is one that the rules allow, at random on rivers on which nothing is trained. A start fails if its flight
ends within `STEPS`. starts.csv has a row for each level, range of angles, and water in the first frame or not.
"""

import argparse
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from gymnasium.vector import AutoresetMode
from page_sections import replace_section, wrap

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import write_atomic
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.train import load_policy
from thalweg.world import LEVELS

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "packaged-policy.md"
TABLE = HERE / "starts.csv"
SECTION = "starts"
COLUMNS = ("level", "off_from", "off_to", "water", "starts", "failures")
RIVERS = range(4000, 4016)
"""Seeds of the rivers of each level."""
OFF_DEG = (0, 20, 45, 60, 70, 90)
"""Limits of the ranges of angles off the course, in degrees; starts of the default rules are within 80."""
WATER_SHARE = 0.005
"""Least share of water in a frame that shows some."""
STEPS = 30
"""Steps of each flight."""
TOGETHER = 64
"""Environments that fly together."""


def failures_at(path: Path, level: str, starts: int, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fly the first steps of a policy; returns for each start the angle off the course in degrees, the share of water
    in the first frame, and whether the flight ended within `steps`."""
    policy = load_policy(path)
    rivers = RiverList.of_levels([(level, tuple(RIVERS))], len(RIVERS))
    config = EnvConfig(observation="rgb+mask")
    env = RiverVectorEnv(rivers, TOGETHER, config, autoreset_mode=AutoresetMode.NEXT_STEP)
    off, water, failed = [], [], []
    frames, _ = env.reset(seed=list(range(TOGETHER)))
    for batch in range(-(-starts // TOGETHER)):
        if batch:
            frames, _ = env.reset()
        off.append(np.degrees(np.abs(env.ideal_eye()[:, FEATURES.index("heading error")])))
        water.append((frames[..., 3] > 127).mean((1, 2)))
        player, fresh, ended = policy.player(TOGETHER, deterministic=True), np.ones(TOGETHER, bool), False
        for _ in range(steps):
            frames, _, terminated, truncated, _ = env.step(player(frames, fresh))
            fresh = terminated | truncated
            ended = ended | fresh
        failed.append(ended)
    env.close()
    return tuple(np.concatenate(parts)[:starts] for parts in (off, water, failed))  # pyright: ignore[reportReturnType]


def rows_of(level: str, off: np.ndarray, water: np.ndarray, failed: np.ndarray) -> list[dict[str, str]]:
    """Return the rows of a level; off, water and failed [N] as of `failures_at`."""
    rows = []
    for low, high in pairwise(OFF_DEG):
        for shown in (True, False):
            chosen = (low <= off) & (off < high) & ((water >= WATER_SHARE) == shown)
            values = level, low, high, "yes" if shown else "no", chosen.sum(), (chosen & failed).sum()
            rows.append(dict(zip(COLUMNS, map(str, values), strict=True)))
    return rows


def page_section(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the page: failures among starts that show water and among those that show none."""

    def share(chosen: list[dict[str, str]]) -> str:
        starts, failures = (sum(int(row[name]) for row in chosen) for name in ("starts", "failures"))
        return f"{failures / starts:.1%} of {starts}" if starts else ""

    lines = []
    for level in dict.fromkeys(row["level"] for row in rows):
        own = [row for row in rows if row["level"] == level]
        ranges = dict.fromkeys((row["off_from"], row["off_to"]) for row in own)
        for low, high in ranges:
            there = [row for row in own if (row["off_from"], row["off_to"]) == (low, high)]
            shown = [[row for row in there if row["water"] == water] for water in ("yes", "no")]
            lines.append([level, f"{low}° to {high}°", *map(share, shown)])
        lines.append([level, "all", *(share([row for row in own if row["water"] == water]) for water in ("yes", "no"))])
    header = ["level", "off the course", "failed of those that show water", "failed of those that show none"]
    note = (
        f"Random starts on {len(RIVERS)} rivers of each level; a start fails if its flight ends within {STEPS} steps."
    )
    return f"{markdown(frame(header, lines))}\n{wrap(note)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=Path, default=PACKAGED_POLICY, help="folder of a run or policy file")
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=["Medium", "Hard"])
    parser.add_argument("--starts", type=int, default=1024, help="starts on each level")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table, which is written anew")
    parser.add_argument("--write", action="store_true", help="fly nothing, but write the table of the page")
    given = parser.parse_args()
    if given.starts < 1:
        parser.error("--starts must be at least 1")
    if given.write:
        section = page_section(read_csv(given.out, COLUMNS))
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, section))
        return
    rows = []
    for level in given.levels:
        rows += rows_of(level, *failures_at(given.policy, level, given.starts, STEPS))
        print(page_section(rows), flush=True)
    write_atomic(given.out, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in rows)))


if __name__ == "__main__":
    main()
