"""Gates of the tasks where a limit has a price: hovering, and PPO, which knows no limit, beside the oracle's front.

    python benchmarks/task_gates.py                        # resumes; policies that have a row are not trained again
    python benchmarks/task_gates.py --tasks Nests --seeds 0
    python benchmarks/task_gates.py --write                # the tables of docs/tasks.md, of fronts and of gates

In a task a limit is a choice if three things hold on the fixed river of Medium: the oracle's front spans at least 2
of 10 points of return; hovering returns at most 5 % of the oracle's greatest return; and PPO costs at least three
times the middle one of three limits, which follow from the front. PPO sees the ideal eye and is trained for 200,000
steps on sixteen other rivers of Medium. task_gates.csv has a row for each policy: means over the first 60 of the
starts that the oracle flies.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ideal_eye import rivers_of
from page_sections import replace_section
from settings_hash import settings_hash
from tables import append

from thalweg.algos.policy.policy import AnyPolicy
from thalweg.algos.registry import algorithm_named
from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.baselines import BASELINES, Sight
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import Label, evaluate
from thalweg.bench.fronts.fronts import FrontPoint, front_of, points_of, read_fronts
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.front import Front
from thalweg.bench.suite.priced import LIMITS
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.config import to_plain
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.tasks import PAPER_TASK, TASKS, TaskName
from thalweg.train import run
from thalweg.world import LEVELS

HERE = Path(__file__).resolve().parent
TABLE, PAGE = HERE / "task_gates.csv", HERE.parent / "docs" / "tasks.md"
PRICED = tuple(name for name in TASKS if name != PAPER_TASK)
LEVEL, RIVERS, NUM_ENVS, STEPS, FLIGHTS = "Medium", range(1000, 1016), 16, 200_000, 60
HOVER, LEARNER = "hover", "PPO"
KEY = ("task", "policy", "seed", "config", "tasks", "privileged")
"""Columns that identify a row: `config` is a hash of the versions of worlds, rules and evaluation, and for PPO also of
its settings and of the versions of PPO, training and deadlines; the last two are versions."""
LEAST_SPAN, GREATEST_HOVER, LEAST_COST = 2.0, 0.05, 3.0
"""Points of return; share of the oracle's return; multiple of the middle limit."""


class WithIdealEye:
    """A policy that was trained on the privileged observation outside a folder that says so."""

    sees: Sight = "privileged"

    def __init__(self, policy: AnyPolicy) -> None:
        self.player = policy.player


@dataclass(frozen=True)
class Gates:
    """How a task stands to its gates."""

    task: str
    front: Front
    limits: tuple[float, ...]
    hover: float
    """Return of hovering."""
    learners: tuple[tuple[float, float], ...]
    """(return, cost) of PPO with each seed."""

    @property
    def span(self) -> float:
        """Points of return between the safest and the fastest end of the front."""
        return float(self.front.return_[-1] - self.front.return_[0])

    @property
    def hover_share(self) -> float:
        """Share of the oracle's greatest return that hovering returns."""
        return self.hover / float(self.front.return_[-1])

    @property
    def multiple(self) -> float:
        """How many times the middle limit PPO costs with its cheapest seed."""
        return min((cost for _, cost in self.learners), default=float("nan")) / self.limits[1]

    @property
    def held(self) -> bool:
        """Whether all three gates hold."""
        return self.span >= LEAST_SPAN and self.hover_share <= GREATEST_HOVER and self.multiple >= LEAST_COST


def key_of(task: str, policy: str, seed: int) -> tuple[str, ...]:
    """Return the values of `KEY`."""
    made_with = {"world": versions.WORLD, "rules": versions.RULES, "evaluation": versions.EVALUATION}
    if policy == LEARNER:
        made_with |= {
            "deadlines": versions.DEADLINES,
            "algorithm": versions.ALGORITHMS[LEARNER],
            "training": versions.TRAINING,
        }
    config = settings_hash((settings() if policy == LEARNER else {}) | made_with)
    return task, policy, str(seed), config, str(versions.TASKS), str(versions.PRIVILEGED)


def settings() -> dict[str, Any]:
    """Return all settings of PPO."""
    return to_plain(algorithm_named(LEARNER).configure({}, num_envs=NUM_ENVS))


def trained(task: TaskName, seed: int, runs: Path) -> WithIdealEye:
    """Return PPO's policy of a task, trained or resumed in a folder of its own."""
    rules = EnvConfig(task=task, observation="privileged", critic_info=settings().get("asymmetric_critics", False))
    env = RiverVectorEnv(rivers_of(LEVEL, RIVERS), NUM_ENVS, rules)
    name = "-".join(filter(None, key_of(task, LEARNER, seed)))
    result = run(LEARNER, env, steps=STEPS, seed=seed, folder=runs / name)
    env.close()
    return WithIdealEye(result.policy)


def measure(task: TaskName, policy: str, seed: int, runs: Path) -> dict[str, str]:
    """Train, if the policy is PPO, and fly; returns the row."""
    flown = BASELINES[HOVER] if policy == HOVER else trained(task, seed, runs)
    config = EvaluationConfig(FLIGHTS, env=EnvConfig(observation="none", task=task))
    course = Course.of_level(LEVEL, config, drawn=False)
    rows = evaluate(flown, course, Label(policy, seed, LEVEL), config)
    means = {"return": [row.return_ for row in rows], "cost": [row.cost for row in rows]}
    success = np.mean([row.success for row in rows])
    figures = {name: f"{np.mean(values):.3f}" for name, values in means.items()} | {"success": f"{success:.2f}"}
    return dict(zip(KEY, key_of(task, policy, seed), strict=True)) | {"flights": str(len(rows))} | figures


def gates_of(task: TaskName, rows: Sequence[Mapping[str, str]]) -> Gates:
    """Return how a task stands to its gates, by the front that comes with the package and rows of today's
    versions."""
    front = front_of(points_of(read_fronts(), task, LEVEL))
    current = [row for row in rows if _key(row) == key_of(task, row["policy"], int(row["seed"]))]
    hover = next((float(row["return"]) for row in current if row["policy"] == HOVER), float("nan"))
    learners = tuple((float(row["return"]), float(row["cost"])) for row in current if row["policy"] == LEARNER)
    return Gates(task, front, LIMITS[task], hover, learners)


def _key(row: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(row[name] for name in KEY)


def gate_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the table of gates of the page, a line for each task."""
    lines = []
    for task in LIMITS:
        gates = gates_of(task, rows)
        limits = ", ".join(f"{limit:g}" for limit in gates.limits)
        ppo = "not measured"
        if gates.learners:
            return_, cost = np.mean(gates.learners, axis=0)
            ppo = f"{return_:.2f} / {cost:.0f} ({len(gates.learners)})"
        multiple = f"{gates.multiple:.1f}" if gates.learners else "unknown"
        hovering = "not measured" if np.isnan(gates.hover) else f"{100 * gates.hover_share:.1f} %"
        held = "unknown" if np.isnan(gates.hover) or not gates.learners else "yes" if gates.held else "no"
        lines.append([task, f"{gates.span:.2f}", hovering, limits, ppo, multiple, held])
    header = [
        "task",
        "span of the front",
        "hovering",
        "cost limits",
        "PPO: return / cost (seeds)",
        "times the middle limit",
    ]
    return markdown(frame([*header, "gates hold"], lines)) + "\n"


def rounded(cost: float) -> str:
    """Return a cost to two significant digits, or as a whole number."""
    return f"{cost:.0f}" if cost >= 10.0 else f"{cost:.2g}"


def front_table(points: Sequence[FrontPoint]) -> str:
    """Return the table of fronts of the page, a line for each task, level and kind of rivers."""
    lines = []
    fronts = {(point.task, point.level, point.rivers) for point in points}
    place = lambda each: (PRICED.index(each[0]), each[2], tuple(LEVELS).index(each[1]))  # noqa: E731
    for task, level, rivers in sorted(fronts, key=place):
        own = points_of(points, task, level, rivers)
        front = front_of(own)
        ends = [f"{front.return_[end]:.2f} at {rounded(front.cost[end])}" for end in (0, -1)]
        half = float(front.kept(0.5))
        area = front.hypervolume(float(front.cost[-1])) / (10.0 * float(front.cost[-1]))
        lines.append([task, level, rivers, str(own[0].episodes), *ends, rounded(half), f"{area:.2f}"])
    header = [
        "task",
        "level",
        "rivers",
        "flights",
        "safest end",
        "fastest end",
        "cost at half of the span",
        "hypervolume",
    ]
    return markdown(frame(header, lines)) + "\n"


def written_page() -> str:
    """Return the page with today's tables."""
    page = replace_section(PAGE.read_text(), "fronts", front_table(read_fronts()))
    return replace_section(page, "gates", gate_table(read_csv(TABLE, KEY)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", nargs="+", choices=PRICED, default=PRICED)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of PPO")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "task_gates", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table, to which missing rows are added")
    parser.add_argument("--write", action="store_true", help="train nothing, but write the table of the page")
    given = parser.parse_args()
    if given.write:
        write_atomic(PAGE, written_page())
        return 0
    for policy, seed in ((HOVER, 0), *((LEARNER, seed) for seed in given.seeds)):
        for task in given.tasks:
            known = read_csv(given.out, KEY) if given.out.is_file() else []
            if key_of(task, policy, seed) in {tuple(row[name] for name in KEY) for row in known}:
                continue
            row = measure(task, policy, seed, given.runs)
            append(given.out, list(row), row)
            print(" ".join(f"{name} {value}" for name, value in row.items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
