"""Benchmark of the shield: the same flights without it and with it.

    python benchmarks/shield.py --episodes 100                                  # baselines
    python benchmarks/shield.py --policy student=runs/student --kinds fixed unseen varied
    python benchmarks/shield.py --write                                         # the tables of docs/shield.md

A row of shield.csv is appended as each cell is flown: one policy's flights of one kind on one level, without and with
the shield from the same starts. A cell that has a row is skipped. Kinds are `fixed`, `unseen` and `varied` of
any_river.py. `noise20` is the steady pilot with a random move in a fifth of its steps, `noise50` in half of them. A
veto is false if the rules would have permitted the move; those that look ahead may be right nevertheless. `helped` are
flights that end in a violation without the shield and in none with it, `harmed` the reverse.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from any_river import LEVELS, Cell
from page_sections import replace_section
from river_flights import RESULTS, figures_of, fly_cells, joined

from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.baselines import BASELINES, Policy, Sight
from thalweg.bench.evaluate.course import EvaluationConfig
from thalweg.bench.evaluate.episodes import REASON_TEXT, REASONS, Episode
from thalweg.bench.evaluate.evaluation import Label, evaluate, observation_function
from thalweg.bench.evaluate.shielded import FlightShield, Screening
from thalweg.bench.report.table import frame, markdown
from thalweg.cli.options import settings_from
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import parse_config
from thalweg.env import DoneReason
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.shield.config import ShieldConfig
from thalweg.env.shield.moves import VERDICTS
from thalweg.env.spaces import to_unit_actions
from thalweg.env.task.rules import State, empty_outcome, step_all
from thalweg.train import load_policy

HERE = Path(__file__).resolve().parent
TABLE = HERE / "shield.csv"
PAGE, SECTION = HERE.parent / "docs" / "shield.md", "figures"
VERSIONS = {
    "render": versions.RENDER,
    "world": versions.WORLD,
    "rules": versions.RULES,
    "evaluation": versions.EVALUATION,
    "shield": versions.SHIELD,
}
KEY = ("policy", "kind", "level", "episodes", "settings", *VERSIONS)
SIDES = ("without", "with")
VETOED = VERDICTS[1:]
COLUMNS = (
    *KEY,
    *(f"{name}_{side}" for name in RESULTS for side in SIDES),
    "helped",
    "harmed",
    "steps",
    *(f"{'false_' if false else ''}{name.replace(' ', '_')}" for name in VETOED for false in (False, True)),
    "ms_a_step",
)


class Noisy:
    """The steady pilot, some of whose moves are random."""

    sees: Sight = "steady"

    def __init__(self, share: float) -> None:
        self.share = share

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return actions int [N, 4]: `obs`, the pilot's, or random ones."""
        drawn = torch.rand(len(obs), generator=generator).numpy() < self.share
        moves = MOVE_OPTIONS[torch.randint(len(MOVE_OPTIONS), (len(obs),), generator=generator).numpy()]
        return np.where(drawn[:, None], moves, obs)


POLICIES: dict[str, Policy] = {
    "steady": BASELINES["steady"],
    "noise20": Noisy(0.2),
    "noise50": Noisy(0.5),
    "random": BASELINES["random"],
}


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


@dataclass(frozen=True)
class Pair:
    """Flights of one kind on one level by one policy, without and with the shield."""

    policy: str
    kind: str
    level: str
    episodes: int
    path: Path | None = None
    """Of the policy's file; None for one of `POLICIES`."""
    settings: tuple[str, ...] = ()
    """Settings of the shield that differ from its defaults."""

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        mine = self.policy, self.kind, self.level, str(self.episodes), " ".join(self.settings)
        return *mine, *map(str, VERSIONS.values())

    def fly(self) -> dict[str, str]:
        """Fly both sides; returns the row."""
        torch.set_num_threads(1)
        policy: Any = POLICIES[self.policy] if self.path is None else load_policy(self.path)
        config = EvaluationConfig(self.episodes, deterministic=True)
        label = Label(self.policy, 0, self.level)
        watch, flights, seconds = Watch(), {side: [] for side in SIDES}, 0.0
        settings = parse_config(ShieldConfig, settings_from(self.settings))
        for course in joined(Cell(self.policy, 0, 0, self.kind, self.level, self.episodes).courses()):
            observe = observation_function(policy, course, None, shielded=True)
            flights["without"] += evaluate(policy, course, label, config, observe=observe)
            watch.shield = FlightShield(settings, watch)
            flights["with"] += evaluate(policy, course, label, config, observe=observe, shield=watch.shield)
            seconds += watch.shield.seconds
        row = row_of(flights, watch) | {"ms_a_step": f"{1e3 * seconds / max(watch.steps, 1):.3f}"}
        return dict(zip(KEY, self.key, strict=True)) | row


def row_of(flights: dict[str, list[Episode]], watch: Watch) -> dict[str, str]:
    """Return the figures of flights by side."""
    figures = {side: figures_of(episodes) for side, episodes in flights.items()}
    row = {f"{name}_{side}": figures[side][name] for name in RESULTS for side in SIDES}
    pairs = [(a.cost > 0, b.cost > 0) for a, b in zip(flights["without"], flights["with"], strict=True)]
    row |= {"helped": str(pairs.count((True, False))), "harmed": str(pairs.count((False, True)))}
    row["steps"] = str(watch.steps)
    for name in VETOED:
        column = name.replace(" ", "_")
        row |= {column: str(watch.vetoes[name]), f"false_{column}": str(watch.false[name])}
    return row


def main() -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policies", nargs="*", choices=list(POLICIES), default=None)
    parser.add_argument("--policy", action="append", default=[], help="NAME=PATH of another policy")
    parser.add_argument("--kinds", nargs="+", choices=("fixed", "unseen", "varied"), default=["fixed", "unseen"])
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=["Medium", "Hard"])
    parser.add_argument("--episodes", type=int, default=100, help="starts, or rivers, of each cell")
    parser.add_argument("--settings", nargs="*", default=[], help="settings of the shield, such as lookahead=0")
    parser.add_argument("--jobs", type=int, default=1, help="cells that are flown at a time")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="fly nothing, but write the tables of the page")
    given = parser.parse_args()
    if given.episodes < 2 or given.jobs < 1:
        parser.error("--episodes must be at least 2, --jobs at least 1")
    rows = read_csv(given.out, COLUMNS) if given.out.is_file() else []
    if given.write:
        page = replace_section(PAGE.read_text(encoding="utf-8"), SECTION, page_tables(rows) + "\n")
        write_atomic(PAGE, page)
        return None
    named = [text.partition("=") for text in given.policy]
    names = given.policies if given.policies is not None else ([] if named else list(POLICIES))
    policies = [(name, None) for name in names] + [(name, Path(path)) for name, _, path in named]
    done = {tuple(row[name] for name in KEY) for row in rows}
    planned = [
        Pair(name, kind, level, given.episodes, path, tuple(given.settings))
        for name, path in policies
        for kind in given.kinds
        for level in given.levels
    ]
    pairs = [pair for pair in planned if pair.key not in done]
    print(f"{len(pairs)} of {len(planned)} cells are to be flown", flush=True)
    failures = fly_cells({" ".join(pair.key): pair.fly for pair in pairs}, given.jobs, given.out, COLUMNS)
    return "\n".join(failures) or None


def page_tables(rows: Sequence[dict[str, str]]) -> str:
    """Return the tables of the page: returns, violations and vetoes, and how flights end."""
    rows = [row for row in rows if all(row[name] == str(version) for name, version in VERSIONS.items())]
    names = [[row["policy"] + (f", {row['settings']}" if row["settings"] else ""), _river(row)] for row in rows]
    figures = [
        [
            row["episodes"],
            *(
                _change(row, name, digits)
                for name, digits in (("return", ".2f"), ("violations", ".0%"), ("cost", ".2f"))
            ),
            row["helped"],
            row["harmed"],
            f"{_vetoes(row) / int(row['steps']):.1%}",
            f"{_vetoes(row, 'false_') / max(_vetoes(row), 1):.0%}",
        ]
        for row in rows
    ]
    heading = ["flights", "return", "violations", "cost", "helped", "harmed", "vetoed", "of these permitted"]
    ends = [[f"{_ends(row, 'without', reason)} → {_ends(row, 'with', reason)}" for reason in REASONS] for row in rows]
    both = ((heading, figures), ([REASON_TEXT[reason] for reason in REASONS], ends))
    tables = [
        frame(["policy", "river", *columns], [name + line for name, line in zip(names, lines, strict=True)])
        for columns, lines in both
    ]
    return "\n\n".join(markdown(table).rstrip() for table in tables)


def _river(row: dict[str, str]) -> str:
    """Return the river of a row in words."""
    return f"{row['kind']}, {row['level']}"


def _change(row: dict[str, str], name: str, digits: str) -> str:
    """Return a figure without and with the shield."""
    return " → ".join(format(float(row[f"{name}_{side}"]), digits) for side in SIDES)


def _ends(row: dict[str, str], side: str, reason: str) -> int:
    """Return how many flights of a side end for a reason."""
    counts = dict(pair.split("=") for pair in row[f"reasons_{side}"].split())
    return int(counts.get(reason, 0))


def _vetoes(row: dict[str, str], prefix: str = "") -> int:
    """Return how many moves were vetoed, or of these, with `false_`, were permitted by the rules."""
    return sum(int(row[prefix + name.replace(" ", "_")]) for name in VETOED)


if __name__ == "__main__":
    sys.exit(main())
