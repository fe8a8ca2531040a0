"""Trials of learners that see the river with an ideal eye: settings compared without frames.

    python benchmarks/ideal_eye.py                                   # all trials of TRIALS that have no row yet
    python benchmarks/ideal_eye.py --only TD3Lag --seeds 0 1 2
    python benchmarks/ideal_eye.py --algorithm TD3Lag --set multiplier_max=0.5 --steps 100000
    python benchmarks/ideal_eye.py --algorithm PPO --set entropy=0.01 --choose --steps 200000
    python benchmarks/ideal_eye.py --write                           # the table of trials of each algorithm's page

Each trial is an algorithm with some settings, trained on several rivers of a level with
`EnvConfig(observation="privileged")`. A row of ideal_eye.csv is appended as a run finishes; a run that has a row is
skipped, and one that was interrupted resumes in the folder `--runs`. Columns `medium`, `unseen_medium` and
`unseen_hard` are means of 60 sampled flights, whatever level was trained on: on the fixed river of Medium, on 20 other
rivers of Medium, and on 20 of Hard. No trial trains on those. The seconds depend on what else the machine does.

Settings are chosen by trials on rivers and with seeds of their own (`--choose`), which the rows of reported defaults
do not share.
"""

import argparse
import hashlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import torch
from page_sections import replace_section
from settings_hash import settings_hash
from tables import append, last_of_each, rows_of

from thalweg.algos.policy.policy import AnyPolicy
from thalweg.algos.registry import ALGORITHMS, algorithm_named
from thalweg.bench.csv_files import read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.cli.options import settings_from
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import to_plain
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.train import run
from thalweg.train.observations import SEEN_BY_CRITICS
from thalweg.world import World, level_named

HERE = Path(__file__).resolve().parent
TABLE = HERE / "ideal_eye.csv"
RIVERS, UNSEEN, SEEDS = range(1000, 1016), range(2000, 2020), (0, 1, 2)
"""Seeds of the rivers of training, of the unseen ones, and of runs."""
CHOOSING_RIVERS, CHOOSING_UNSEEN, CHOOSING_SEEDS = range(4000, 4016), range(5000, 5020), (10, 11, 12)
"""The same where settings are chosen."""
NUM_ENVS, FLIGHTS, EVALUATION_SEED = 16, 60, 77
RULES = EnvConfig(observation="privileged")
VERSION_COLUMNS = ("privileged", "version", "training", "world", "rules")
"""Versions that a trial depends on; `version` is that of its algorithm."""
KEY = ("algorithm", "changes", "level", "rivers", "steps", "seed", "config", *VERSION_COLUMNS)
"""Columns that identify a trial. `config` is a hash, see `Trial.config`, so that other defaults make another trial."""
BEFORE = f"before deadlines {versions.DEADLINES}"
"""Mark of trials whose critics of costs estimated what would come after the last step that counts."""

PLACES = ("medium", "unseen_medium", "unseen_hard")
"""Where policies are flown; columns are named by them."""
PAGES, SECTION = HERE.parent / "docs" / "algorithms", "ideal eye"
"""Pages of the algorithms, and the section that `--write` writes in them."""

Settings = Mapping[str, Any]
ON_POLICY_STEPS, OFF_POLICY_STEPS = 200_000, 100_000
TRIALS: tuple[tuple[str, Settings, int], ...] = (
    *((name, {}, ON_POLICY_STEPS) for name in ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "CPO", "CUP")),
    ("TD3Lag", {}, OFF_POLICY_STEPS),
    ("SACLag", {}, OFF_POLICY_STEPS),
    ("DDPGLag", {}, OFF_POLICY_STEPS),
    ("SafeLOOP", {}, OFF_POLICY_STEPS),
    ("CCEPETS", {}, OFF_POLICY_STEPS),
)
"""Algorithm, settings that differ from the defaults, and steps of each trial."""


@dataclass(frozen=True)
class Trial:
    """A run to be measured."""

    algorithm: str
    settings: Settings
    steps: int
    seed: int
    level: str = "Medium"
    rivers: Sequence[int] = field(default_factory=lambda: RIVERS)

    @property
    def unseen(self) -> Sequence[int]:
        """Seeds of the rivers that it is not trained on."""
        return CHOOSING_UNSEEN if self.rivers == CHOOSING_RIVERS else UNSEEN

    @property
    def resolved(self) -> dict[str, Any]:
        """All settings."""
        return to_plain(algorithm_named(self.algorithm).configure(self.settings, num_envs=NUM_ENVS))

    @property
    def config(self) -> str:
        """Hash of all settings, and of the version of deadlines where critics of costs are told more than the policy
        sees."""
        told = self.resolved.get("asymmetric_critics", False) and "cost_limit" in self.resolved
        return settings_hash(self.resolved | ({"deadlines": versions.DEADLINES} if told else {}))

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        first, last = self.rivers[0], self.rivers[-1]
        rivers = str(first) if first == last else f"{first}:{last + 1}"
        changes = settings_text(self.settings)
        trained = self.level, rivers, str(self.steps), str(self.seed)
        return self.algorithm, changes, *trained, self.config, *versions_of(self.algorithm)


def versions_of(algorithm: str) -> tuple[str, ...]:
    """Return today's values of `VERSION_COLUMNS`."""
    found = versions.PRIVILEGED, versions.ALGORITHMS[algorithm], versions.TRAINING, versions.WORLD, versions.RULES
    return tuple(map(str, found))


def settings_text(settings: Settings) -> str:
    """Return the changed settings as one line of text, sorted, with spaces between them only."""
    return " ".join(f"{name}={settings[name]}".replace(" ", "") for name in sorted(settings)) or "none"


def rivers_of(level: str, seeds: Sequence[int]) -> list[World]:
    """Return rivers of a level without land, which nobody sees here."""
    return [load_or_plan(level_named(level), seed) for seed in seeds]


def fly(policy: AnyPolicy, worlds: Sequence[World], flights: int = FLIGHTS) -> tuple[float, float, float]:
    """Return mean return, cost and share of successes of one sampled flight per environment.

    Flight i is on river i % len(worlds); starts and samples are the same for every policy.
    """
    env = RiverVectorEnv(worlds, flights, RULES)
    obs, _ = env.reset(seed=EVALUATION_SEED)
    player = policy.player(flights, generator=torch.Generator().manual_seed(EVALUATION_SEED))
    fresh, flying = np.ones(flights, dtype=bool), np.ones(flights, dtype=bool)
    totals = np.zeros((flights, 2))
    reasons = np.full(flights, -1)
    while flying.any():
        obs, rewards, terminated, truncated, info = env.step(player(obs, fresh))
        totals[flying] += np.stack([rewards, info["cost"]], 1)[flying]
        fresh = terminated | truncated
        reasons[flying & fresh] = info["done_reason"][flying & fresh]
        flying &= ~fresh
    env.close()
    success = np.array([env.done_reasons[reason] == "Success" for reason in reasons.tolist()])
    return float(totals[:, 0].mean()), float(totals[:, 1].mean()), float(success.mean())


def scores(policy: AnyPolicy, unseen: Sequence[int] = UNSEEN) -> dict[str, str]:
    """Return the columns of a policy's flights."""
    fixed = rivers_of("Medium", [level_named("Medium").default_seed])
    places = (fixed, rivers_of("Medium", unseen), rivers_of("Hard", unseen))
    row: dict[str, str] = {}
    for place, worlds in zip(PLACES, places, strict=True):
        returned, cost, success = fly(policy, worlds)
        row |= {
            f"{place}_return": f"{returned:.2f}",
            f"{place}_cost": f"{cost:.3f}",
            f"{place}_success": f"{success:.2f}",
        }
    return row


def measure(trial: Trial, runs: Path) -> dict[str, str]:
    """Train, or resume, and fly; returns the row."""
    name = hashlib.sha256(repr(trial.key).encode()).hexdigest()[:10]
    rules = RULES.with_options(critic_info=trial.resolved.get("asymmetric_critics", False))
    env = RiverVectorEnv(rivers_of(trial.level, trial.rivers), NUM_ENVS, rules)
    folder = runs / f"{trial.algorithm}-{trial.seed}-{name}"
    result = run(trial.algorithm, env, steps=trial.steps, seed=trial.seed, folder=folder, config=trial.settings)
    env.close()
    identity = dict(zip(KEY, trial.key, strict=True))
    return identity | scores(result.policy, trial.unseen) | {"seconds": f"{result.seconds:.0f}"}


def finished(table: Path) -> set[tuple[str, ...]]:
    """Return the keys of the trials that have a row."""
    return {tuple(row[name] for name in KEY) for row in rows_of(table, KEY)}


def trial_of(row: Mapping[str, str]) -> Trial:
    """Return the trial of a row, with today's defaults beside its changes."""
    changes = () if row["changes"] == "none" else row["changes"].split(" ")
    return Trial(row["algorithm"], settings_from(changes), int(row["steps"]), int(row["seed"]))


def is_current(row: Mapping[str, str]) -> bool:
    """Return whether a row's trial has today's defaults beside its changes, and today's versions."""
    return row["config"] == trial_of(row).config and _has_versions(row)


def is_before_deadlines(row: Mapping[str, str]) -> bool:
    """Return whether a row lacks today's version of deadlines, on which its trial depends, and nothing else."""
    plain = settings_hash(trial_of(row).resolved)
    return not is_current(row) and row["config"] == plain and _has_versions(row)


def _has_versions(row: Mapping[str, str]) -> bool:
    return tuple(row[name] for name in VERSION_COLUMNS) == versions_of(row["algorithm"])


def shown_rows(rows: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the rows of today, and those from before deadlines for which there are none, in their order; of those of
    the same trial, which two commands may have run, the last."""
    rows = last_of_each(rows, KEY)
    same = itemgetter("algorithm", "changes", "level", "rivers", "steps", "seed")
    today = {same(row) for row in rows if is_current(row)}
    return [row for row in rows if is_current(row) or (same(row) not in today and is_before_deadlines(row))]


def means(rows: Sequence[Mapping[str, str]], place: str) -> str:
    """Return the means of return / cost in a place over rows that differ by their seeds."""
    return " / ".join(f"{np.mean([float(row[f'{place}_{what}']) for row in rows]):.2f}" for what in ("return", "cost"))


def trial_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the Markdown table of trials, a line for all seeds of a trial."""
    groups: dict[tuple[str, ...], list[Mapping[str, str]]] = {}
    for row in rows:
        older = BEFORE if is_before_deadlines(row) else ""
        groups.setdefault((row["changes"], row["level"], row["rivers"], row["steps"], older), []).append(row)
    lines = []
    for (changes, level, rivers, steps, older), seeds in groups.items():
        settings = " ".join(f"`{change}`" if "=" in change else change for change in changes.split(" "))
        settings += f" ({older})" if older else ""
        trained = f"{level} {rivers}, {int(steps):,}"
        lines.append([settings, trained, str(len(seeds)), *(means(seeds, place) for place in PLACES)])
    return markdown(
        frame(["changed settings", "rivers, steps", "seeds", "Medium", "unseen Medium", "unseen Hard"], lines)
    )


def page_section(rows: Sequence[Mapping[str, str]], algorithm: str) -> str:
    """Return the section of an algorithm's page: the defaults on the reported rivers, then what was tried on others."""
    chosen = f"{CHOOSING_RIVERS[0]}:{CHOOSING_RIVERS[-1] + 1}"
    of_algorithm = [row for row in rows if row["algorithm"] == algorithm]
    reported = [row for row in of_algorithm if row["rivers"] != chosen and row["changes"] == "none"]
    tried = [row for row in of_algorithm if row["rivers"] == chosen]
    told = to_plain(algorithm_named(algorithm).configure({})).get("asymmetric_critics", False)
    parts = [
        (f"The defaults, whose critics see {SEEN_BY_CRITICS[told]}:", reported),
        ("Settings that were tried, on other rivers with other seeds:", tried),
    ]
    tables = [f"{title}\n\n{trial_table(table)}" for title, table in parts if table]
    return "\n\n".join(tables) or "No trial of today's versions yet.\n"


def written_pages() -> dict[Path, str]:
    """Return the pages of algorithms that show their trials, as they must be."""
    rows = shown_rows(read_csv(TABLE, KEY))
    found = {}
    for algorithm in ALGORITHMS:
        path = PAGES / f"{algorithm.lower()}.md"
        text = path.read_text()
        if f"<!-- {SECTION} -->" in text:
            found[path] = replace_section(text, SECTION, page_section(rows, algorithm))
    return found


def rivers_named(text: str) -> Sequence[int]:
    """Return the seeds of `FIRST:END`, END excluded, or of a single seed."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def trials_of(chosen: argparse.Namespace) -> list[Trial]:
    """Return the trials that the command line asks for."""
    if chosen.algorithm:
        table = [(algorithm_named(chosen.algorithm).name, settings_from(chosen.set), chosen.steps or OFF_POLICY_STEPS)]
    else:
        table = [row for row in TRIALS if not chosen.only or row[0] in chosen.only]
    rivers = chosen.rivers or (CHOOSING_RIVERS if chosen.choose else RIVERS)
    return [
        Trial(algorithm, settings, steps, seed, chosen.level, rivers)
        for seed in chosen.seeds or (CHOOSING_SEEDS if chosen.choose else SEEDS)
        for algorithm, settings, steps in table
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], choices=ALGORITHMS, help="algorithms to run; default: all")
    parser.add_argument("--algorithm", help="one trial of this algorithm instead of the table's")
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="settings of that trial")
    parser.add_argument("--steps", type=int, help=f"steps of that trial, by default {OFF_POLICY_STEPS:,}")
    parser.add_argument("--level", default="Medium", help="level of the rivers of training")
    parser.add_argument(
        "--rivers", type=rivers_named, metavar="FIRST:END", help="seeds of those rivers instead of the usual ones"
    )
    parser.add_argument("--seeds", type=int, nargs="+", help="seeds of the runs instead of the usual three")
    parser.add_argument("--choose", action="store_true", help="rivers and seeds for choosing settings")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "ideal_eye", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="train nothing, but write the tables of the pages")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if a page is out of date")
    chosen = parser.parse_args()
    if not chosen.algorithm and (chosen.set or chosen.steps):
        parser.error("--set and --steps are of one trial: name its algorithm by --algorithm")
    if chosen.algorithm and chosen.only:
        parser.error("--only is for the table's trials; leave it out beside --algorithm")
    if (chosen.write or chosen.check) and chosen.out != TABLE:
        parser.error("--write and --check are for the table of this folder; leave --out out")
    if chosen.write or chosen.check:
        outdated = {path: text for path, text in written_pages().items() if text != path.read_text()}
        for path, text in outdated.items() if chosen.write else ():
            write_atomic(path, text)
        return int(chosen.check and bool(outdated))
    for trial in trials_of(chosen):
        if trial.key in finished(chosen.out):
            continue
        row = measure(trial, chosen.runs)
        append(chosen.out, list(row), row)
        print(" ".join(f"{name} {value}" for name, value in row.items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
