"""Returns of both pilots, which do not know of them, under wind and inertia on the fixed river of Medium.

python benchmarks/weather.py --write   # also the table of docs/weather.md
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from page_sections import replace_section
from tables import of_versions

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.physics.wind import Wind
from thalweg.env.pilot.in_rivers import PILOTS
from thalweg.world import load_or_build

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "weather.md"
TABLE = HERE / "weather.csv"
VERSIONS = {
    "steady": versions.STEADY,
    "rules": versions.RULES,
    "forces": versions.FORCES,
    "world": versions.WORLD,
}
"""Versions that the flights depend on, by their columns."""
COLUMNS = ("dynamics", "wind_m_per_s", "pilot", "episodes", *VERSIONS, "return", "successes")
SPEEDS = (0.0, 2.0, 4.0, 6.0)


def flown(config: EnvConfig, pilot: str, episodes: int) -> tuple[float, int]:
    """Return the mean return of a pilot's first episodes with seeds 0, 1 and so on, and how many of them succeed."""
    env = RiverVectorEnv([load_or_build("Medium")], episodes, config, autoreset_mode=AutoresetMode.NEXT_STEP)
    env.reset(seed=0)
    running, returns, successes = np.ones(episodes, bool), np.zeros(episodes), 0
    while running.any():
        _, rewards, terminated, truncated, info = env.step(env.pilot_actions(pilot))
        returns[running] += rewards[running]
        ended = running & (terminated | truncated)
        successes += int((info["done_reason"][ended] == 6).sum())
        running &= ~ended
    return float(returns.mean()), successes


def measured(episodes: int) -> list[tuple[Any, ...]]:
    """Return a row for both kinds of dynamics, each mean speed, and each pilot."""
    rows = []
    for dynamics, action in (("kinematic", "multidiscrete"), ("inertial", "continuous")):
        for speed in SPEEDS:
            wind = Wind(speed_m_per_s=(speed, speed)) if speed else None
            config = EnvConfig(observation="none").with_options(dynamics=dynamics, action=action, wind=wind)
            for pilot in PILOTS["uav"]:
                mean, successes = flown(config, pilot, episodes)
                rows.append((dynamics, speed, pilot, episodes, *VERSIONS.values(), f"{mean:.3f}", successes))
                print(rows[-1], flush=True)
    return rows


def table(rows: list[dict[str, str]]) -> str:
    """Return the table of the page, of rows of today's versions alone."""
    names = "dynamics", "mean wind", "pilot", "return", "successes"
    lines = [
        (row["dynamics"], f"{float(row['wind_m_per_s']):.0f} m/s", row["pilot"], f"{float(row['return']):.2f}",
         f"{row['successes']} of {row['episodes']}")
        for row in of_versions(rows, VERSIONS)
    ]  # fmt: skip
    return markdown(frame(names, lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=32)
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    given = parser.parse_args()
    write_atomic(TABLE, csv_text(COLUMNS, measured(given.episodes)))
    if given.write:
        write_atomic(PAGE, replace_section(PAGE.read_text(), "weather", table(read_csv(TABLE, COLUMNS))))


if __name__ == "__main__":
    main()
