"""Starts at which a policy fails, by the angle off the course and by the water that the first frame shows.

    python benchmarks/starts.py                       # the packaged policy
    python benchmarks/starts.py --policy runs/student --out trial.csv
    python benchmarks/starts.py --write               # the table of docs/packaged-policy.md

Every start is one that the rules allow, at random on rivers on which nothing is trained. A start fails if its flight
ends within `STEPS`. starts.csv names the policy by the hash of its file, and has a row for each level, range of angles,
and water in view: `ahead`, if more of it lies ahead along the course than behind, `behind` otherwise, and `none` if
less than `WATER_SHARE` of the frame shows water further along the course than `NEAR_M`.
"""

import argparse
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from gymnasium.vector import AutoresetMode
from page_sections import replace_section, wrap

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.cache import file_hash
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.render import Renderer
from thalweg.train import load_policy
from thalweg.train.run_in_folder import policy_file
from thalweg.world import LEVELS, World, load_or_build
from thalweg.world.record import River

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "packaged-policy.md"
TABLE = HERE / "starts.csv"
SECTION = "starts"
MADE_WITH = ("policy", "world", "render", "rules")
"""Columns of what flights depend on: a hash of the policy's file, and versions."""
COLUMNS = (*MADE_WITH, "level", "off_from", "off_to", "water", "starts", "failures")
RIVERS = range(4000, 4016)
"""Seeds of the rivers of each level."""
OFF_DEG = (0, 20, 45, 60, 70, 90)
"""Limits of the ranges of angles off the course, in degrees; starts of the default rules are within 80."""
VIEWS = ("ahead", "behind", "none")
"""Water in view."""
WATER_SHARE = 0.005
"""Least share of such water in a frame that shows some."""
NEAR_M = 5.0
"""Distance along the course within which water does not tell the way."""
EVERY = 4
"""Rows and columns of a frame of which one is looked at."""
STEPS = 30
"""Steps of each flight."""
TOGETHER = 64
"""Environments that fly together."""


def failures_at(path: Path, level: str, starts: int, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fly the first steps of a policy; returns for each start the angle off the course in degrees, which of `VIEWS` it
    has, and whether the flight ended within `steps`."""
    policy = load_policy(path)
    rivers = RiverList.of_levels([(level, tuple(RIVERS))], len(RIVERS))
    config = EnvConfig(observation="rgb+mask")
    env = RiverVectorEnv(rivers, TOGETHER, config, autoreset_mode=AutoresetMode.NEXT_STEP)
    view = WaterInView([load_or_build(level, seed) for seed in RIVERS])
    off, water, failed = [], [], []
    frames, _ = env.reset(seed=list(range(TOGETHER)))
    for batch in range(-(-starts // TOGETHER)):
        if batch:
            frames, _ = env.reset()
        off.append(np.degrees(np.abs(env.ideal_eye()[:, FEATURES.index("heading error")])))
        water.append(view.of(env.rivers.state()["river"], env.state.pose, env.state.travel))
        player, fresh, ended = policy.player(TOGETHER, deterministic=True), np.ones(TOGETHER, bool), False
        for _ in range(steps):
            frames, _, terminated, truncated, _ = env.step(player(frames, fresh))
            fresh = terminated | truncated
            ended = ended | fresh
        failed.append(ended)
    env.close()
    return tuple(np.concatenate(parts)[:starts] for parts in (off, water, failed))  # pyright: ignore[reportReturnType]


class WaterInView:
    """Which way along the course the water lies that a camera sees."""

    def __init__(self, worlds: Sequence[World]) -> None:
        self.rivers = [world.river for world in worlds]
        self.renderer = Renderer(worlds)

    def of(self, river: np.ndarray, pose: np.ndarray, travel: np.ndarray) -> np.ndarray:
        """Return which of `VIEWS` each camera has [N], from its river [N], its pose [N, 4] and its direction of travel
        along the course [N], 1 or -1."""
        seen = self.renderer.render_layers(pose, world_index=river, layers=("mask", "depth_m"))
        shares = np.zeros((len(pose), 2))
        for row, (x, y) in enumerate(zip(*self._ground(pose, seen.depth_m), strict=True)):
            water = seen.mask[row, ::EVERY, ::EVERY]
            metres = ahead_m(self.rivers[river[row]], pose[row, :2], np.stack([x[water], y[water]], axis=-1))
            metres = metres * travel[row]
            shares[row] = [(metres > NEAR_M).sum() / water.size, (metres < -NEAR_M).sum() / water.size]
        some = shares.sum(axis=1) >= WATER_SHARE
        return np.where(some, np.where(shares[:, 0] > shares[:, 1], VIEWS[0], VIEWS[1]), VIEWS[2])

    def _ground(self, pose: np.ndarray, depth_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of what is seen in one of `EVERY` rows and columns, [N, H, W] each."""
        camera = self.renderer.camera
        rows, columns = (np.arange(0, size, EVERY) + 0.5 - size / 2 for size in depth_m.shape[1:])
        up, right = -camera.pixel * rows[:, None], camera.pixel * columns[None, :]
        pitch, (x, y, _, yaw) = np.radians(camera.pitch_deg), pose.T[:, :, None, None]
        level = np.cos(pitch) + np.sin(pitch) * up
        depth = depth_m[:, ::EVERY, ::EVERY]
        return (
            x + depth * (np.cos(yaw) * level + np.sin(yaw) * right),
            y + depth * (np.sin(yaw) * level - np.cos(yaw) * right),
        )


def ahead_m(river: River, here: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how far points [K, 2] lie up the course from a point [2], in metres along it [K]: on a loop the shorter
    way, so that they are negative behind."""
    samples = river.position_m
    nearest = np.array([np.square(samples - point).sum(axis=1).argmin() for point in (here, *points)])
    arcs = river.arc_m[nearest]
    metres = arcs[1:] - arcs[0]
    return (metres + river.length_m / 2) % river.length_m - river.length_m / 2 if river.closed else metres


def made_with(path: Path) -> dict[str, str]:
    """Return `MADE_WITH` of flights of a policy today."""
    values = file_hash(policy_file(path)), versions.WORLD, versions.RENDER, versions.RULES
    return dict(zip(MADE_WITH, map(str, values), strict=True))


def rows_of(
    level: str, off: np.ndarray, water: np.ndarray, failed: np.ndarray, made: Mapping[str, str]
) -> list[dict[str, str]]:
    """Return the rows of a level; off, water and failed [N] are those of `failures_at`, made that of `made_with`."""
    rows = []
    for low, high in pairwise(OFF_DEG):
        for view in VIEWS:
            chosen = (low <= off) & (off < high) & (water == view)
            values = level, low, high, view, chosen.sum(), (chosen & failed).sum()
            rows.append({**made, **dict(zip(COLUMNS[len(MADE_WITH) :], map(str, values), strict=True))})
    return rows


def page_section(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the page: failures among starts by the water that they show."""

    def share(chosen: list[dict[str, str]]) -> str:
        starts, failures = (sum(int(row[name]) for row in chosen) for name in ("starts", "failures"))
        return f"{failures / starts:.1%} of {starts}" if starts else ""

    lines = []
    for level in dict.fromkeys(row["level"] for row in rows):
        own = [row for row in rows if row["level"] == level]
        ranges = dict.fromkeys((row["off_from"], row["off_to"]) for row in own)
        for low, high in ranges:
            there = [row for row in own if (row["off_from"], row["off_to"]) == (low, high)]
            shown = [[row for row in there if row["water"] == view] for view in VIEWS]
            lines.append([level, f"{low}° to {high}°", *map(share, shown)])
        lines.append([level, "all", *(share([row for row in own if row["water"] == view]) for view in VIEWS)])
    header = [
        "level",
        "off the course",
        "water ahead",
        "most of it behind",
        "hardly any water",
    ]
    note = (
        "Each cell: the share of starts that fail, of how many; a start fails if its flight ends within"
        f" {STEPS} steps. Random starts on {len(RIVERS)} rivers of each level, by where most of the visible water lies"
        " along the course."
        f" Water within {NEAR_M:g} m along it does not count, as it tells no way; `hardly any water` is less than"
        f" {100 * WATER_SHARE:g} % of the frame."
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
        rows = read_csv(given.out, COLUMNS) if given.out.is_file() else []
        today = made_with(given.policy)
        current = [row for row in rows if {name: row[name] for name in MADE_WITH} == today]
        section = page_section(current) if current else "Nothing was measured with today's policy and versions.\n"
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, section))
        return
    rows = []
    for level in given.levels:
        rows += rows_of(level, *failures_at(given.policy, level, given.starts, STEPS), made_with(given.policy))
        print(page_section(rows), flush=True)
    write_atomic(given.out, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in rows)))


if __name__ == "__main__":
    main()
