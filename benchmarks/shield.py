"""Benchmark of the shield: the same flights without it and with it.

    python benchmarks/shield.py --jobs 2                                # flies all cells that have no row yet
    python benchmarks/shield.py --policies packaged --kinds unseen      # those of some policies, kinds and levels
    python benchmarks/shield.py --policy student=runs/student           # those of another policy
    python benchmarks/shield.py --write                                 # the tables of docs/shield.md

A row of shield.csv is appended as each cell is flown: one policy's flights of one kind on one level, without and with
the shield from the same starts. A cell that has a row is skipped. Policies are known by what made them, the column
`made_by`: the hash of a file, or the version of a pilot. A policy that has changed is flown again, and the page shows
no rows of what it was. Kinds are `fixed`, `unseen` and `varied` of any_river.py. `noise20` is the steady pilot with a
random move in a fifth of its steps, `noise50` in half of them. A veto is false if the rules would have permitted the
move; those that look ahead may be right nevertheless. `helped` are flights that end in a violation without the shield
and in none with it, `harmed` the reverse.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import torch
from any_river import Cell
from page_sections import replace_section
from river_flights import RESULTS, figures_of, fly_cells, joined
from shield_arms import ARMS, EPISODES, KEY, KINDS, LEVELS, NAMES, Pair, arm_of_file, chosen_arms, names_of, planned
from shield_page import SIDES, VETOED, page_tables
from tables import rows_of

from thalweg.bench.evaluate.course import EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import Label, evaluate, observation_function
from thalweg.bench.evaluate.shielded import FlightShield, Screening
from thalweg.cli.options import settings_from
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import parse_config
from thalweg.env import DoneReason
from thalweg.env.shield.config import ShieldConfig
from thalweg.env.shield.moves import VERDICTS
from thalweg.env.spaces import to_unit_actions
from thalweg.env.task.rules import State, empty_outcome, step_all

HERE = Path(__file__).resolve().parent
TABLE = HERE / "shield.csv"
PAGE, SECTION = HERE.parent / "docs" / "shield.md", "figures"
COLUMNS = (
    "policy",
    *KEY,
    *(f"{name}_{side}" for name in RESULTS for side in SIDES),
    "helped",
    "harmed",
    "steps",
    *(f"{'false_' if false else ''}{name.replace(' ', '_')}" for name in VETOED for false in (False, True)),
    "ms_a_step",
)


@dataclass
class Watch:
    """Counts what the shield does in the flights of a course."""

    steps: int = 0
    vetoes: Counter = field(default_factory=Counter)
    false: Counter = field(default_factory=Counter)
    shield: Any = None

    def __call__(self, screening: Screening) -> None:
        """Count a step's vetoes, and those of moves that the rules permit."""
        self.steps += len(screening.flying)
        vetoed = screening.verdicts > 0
        if not vetoed.any():
            return
        env = self.shield.env
        state, outcome = State(*(array.copy() for array in env.state)), empty_outcome(env.num_envs)
        actions = np.ones((env.num_envs, 4), np.int64)
        actions[screening.flying] = screening.proposed
        units = to_unit_actions("multidiscrete", actions, env.num_envs)
        step_all(np.ones(env.num_envs, bool), units, env.courses, env.limits, state, outcome)
        for flight, verdict in zip(screening.flying[vetoed], screening.verdicts[vetoed], strict=True):
            self.vetoes[VERDICTS[verdict]] += 1
            broken = DoneReason.COLLISION <= outcome.reason[flight] <= DoneReason.YAW_OVER_DEVIATION
            self.false[VERDICTS[verdict]] += not broken


def fly(pair: Pair) -> dict[str, str]:
    """Fly both sides of a cell; returns its row."""
    torch.set_num_threads(1)
    policy, name = pair.policy(), pair.arm.policy
    config, label = EvaluationConfig(pair.episodes, deterministic=True), Label(name, 0, pair.level)
    settings = parse_config(ShieldConfig, settings_from(pair.arm.settings))
    watch, flights, seconds = Watch(), {side: [] for side in SIDES}, 0.0
    for course in joined(Cell(name, 0, 0, pair.kind, pair.level, pair.episodes).courses()):
        observe = observation_function(policy, course, None, shielded=True)
        flights["without"] += evaluate(policy, course, label, config, observe=observe)
        watch.shield = FlightShield(settings, watch)
        flights["with"] += evaluate(policy, course, label, config, observe=observe, shield=watch.shield)
        seconds += watch.shield.seconds
    row = row_of(flights, watch) | {"ms_a_step": f"{1e3 * seconds / max(watch.steps, 1):.3f}"}
    return {"policy": name} | dict(zip(KEY, pair.key, strict=True)) | row


def row_of(flights: dict[str, list[Episode]], watch: Watch) -> dict[str, str]:
    """Return the figures of flights by side; raises `ValueError` unless both sides have the same starts in order."""
    without, shielded = (
        [(each.level, each.world_seed, each.episode, each.x, each.y, each.z, each.yaw) for each in flights[side]]
        for side in SIDES
    )
    if without != shielded:
        unequal = next(pair for pair in zip_longest(shielded, without) if pair[0] != pair[1])
        raise ValueError("a flight with the shield starts from {}, and without it from {}".format(*unequal))
    figures = {side: figures_of(episodes) for side, episodes in flights.items()}
    row = {f"{name}_{side}": figures[side][name] for name in RESULTS for side in SIDES}
    pairs = [(a.cost > 0, b.cost > 0) for a, b in zip(flights["without"], flights["with"], strict=True)]
    row |= {"helped": str(pairs.count((True, False))), "harmed": str(pairs.count((False, True)))}
    row["steps"] = str(watch.steps)
    for name in VETOED:
        column = name.replace(" ", "_")
        row |= {column: str(watch.vetoes[name]), f"false_{column}": str(watch.false[name])}
    return row


def main(arguments: Sequence[str] | None = None) -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policies", nargs="+", choices=NAMES, help="those of the table to fly; default: all")
    parser.add_argument(
        "--policy",
        action="append",
        default=[],
        metavar="NAME=PATH",
        help="another policy, flown instead unless --policies names some; with --write, the page has its rows too",
    )
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--episodes", type=int, default=EPISODES, help="starts, or rivers, of each cell")
    parser.add_argument("--settings", nargs="*", help="settings of the shield in place of the table's: lookahead=0")
    parser.add_argument("--jobs", type=int, default=1, help="cells that are flown at a time")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="fly nothing, but write the tables of the page")
    given = parser.parse_args(arguments)
    if given.episodes < 2 or given.jobs < 1:
        parser.error("--episodes must be at least 2, --jobs at least 1")
    try:
        others = [arm_of_file(text) for text in given.policy]
        arms = chosen_arms(given.policies, others, given.settings)
        pairs = planned(arms, given.kinds, given.levels, given.episodes)
        names = names_of((*ARMS, *others))
    except (ValueError, OSError) as error:
        parser.error(str(error))
    rows = rows_of(given.out, COLUMNS)
    if given.write:
        page = replace_section(PAGE.read_text(encoding="utf-8"), SECTION, page_tables(rows, names) + "\n")
        write_atomic(PAGE, page)
        return None
    if not pairs:
        parser.error("none of the policies is flown in the chosen kinds on the chosen levels")
    done = {tuple(row[name] for name in KEY) for row in rows}
    missing = {" ".join(pair.key): partial(fly, pair) for pair in pairs if pair.key not in done}
    print(f"{len(missing)} of {len(pairs)} cells are to be flown", flush=True)
    return "\n".join(fly_cells(missing, given.jobs, given.out, COLUMNS)) or None


if __name__ == "__main__":
    sys.exit(main())
