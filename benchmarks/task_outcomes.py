"""Outcomes of the runs of a task: the policy of each algorithm and limit beside the oracle's front of the same rivers.

Figures are those of reports, which show each policy beside its own limit on the fixed river
(`thalweg.bench.report.price_tables`). Here an algorithm without a limit stands beside all of them, and the flights of
unseen rivers beside the front of unseen rivers.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.fronts.fronts import FIXED, UNSEEN, front_of, packaged_points
from thalweg.bench.report.policies import evaluated_seeds
from thalweg.bench.report.price_tables import by_seed, mean_cost, mean_return, share_above, task_cost, worst_tenth
from thalweg.bench.results.front import Front
from thalweg.bench.results.inference import Estimate, mean_estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.priced import LIMITS
from thalweg.bench.suite.record import arms_of, bounds_of
from thalweg.core import versions

LEVEL = "Medium"
"""Level of training and of the limits."""
OF_TASKS: Mapping[str, tuple[float, ...]] = {**LIMITS}
"""Limits of each task by the ideal eye, from the tightest."""
LIMITLESS = tuple(name for name, entry in ALGORITHMS.items() if not hasattr(entry.configure({}), "cost_limit"))
"""Algorithms that know no limit."""
CONDITION = {FIXED: "", UNSEEN: "unseen"}
"""Conditions in the results, by rivers."""


@dataclass(frozen=True)
class Outcome:
    """A policy beside a limit and the oracle, on one kind of rivers."""

    task: str
    algorithm: str
    """Its algorithm, and what distinguishes it from others of the algorithm, such as `PPOLag-cnn`."""
    limit: float
    seeds: str
    """Number of seeds, or `2 of 3` where some are missing."""
    return_: Estimate
    cost: Estimate
    above: Estimate
    """Share of the flights that cost more than the limit."""
    regret: Estimate
    """How much more the oracle returns at the same cost."""
    tail: Estimate
    """Mean cost of the worst tenth of the flights."""

    @property
    def holds(self) -> bool:
        """Whether the mean cost is within the limit."""
        return self.cost.value <= self.limit


@dataclass(frozen=True)
class Study:
    """What was run of a task."""

    task: str
    suite: Mapping[str, Any]
    """Record of the suite: as it was run, or, where nothing was, as it is today."""
    limits: tuple[float, ...]
    fronts: Mapping[str, Front]
    """Of the oracle, by rivers."""
    arms: Mapping[tuple[str, float | None], str]
    """Names of the policies, by algorithm and limit; None where there is no limit."""
    results: Results | None
    """None where nothing was run."""
    outcomes: Mapping[tuple[str, str, float], Outcome]
    """By rivers, algorithm and limit, as far as they were flown."""

    @property
    def middle_limit(self) -> float:
        """The middle one of the task's limits by the ideal eye; that of its own limits where it has others."""
        every = OF_TASKS.get(self.task, self.limits)
        return every[1] if every[1:2] and every[1] in self.limits else self.limits[len(self.limits) // 2]

    def place(self, limit: float) -> int:
        """Return the place of a limit, from 0, the tightest, among those of the task, or its own if it has others."""
        every = OF_TASKS.get(self.task, self.limits)
        return every.index(limit) if limit in every else self.limits.index(limit)

    @property
    def algorithms(self) -> list[str]:
        """Algorithms of the suite, in its order."""
        return list(dict.fromkeys(algorithm for algorithm, _ in self.arms))

    def outcome(self, rivers: str, algorithm: str, limit: float) -> Outcome | None:
        """Return the outcome of an algorithm beside a limit; None where it is missing."""
        return self.outcomes.get((rivers, algorithm, limit))

    def at(self, rivers: str, limit: float) -> list[Outcome]:
        """Return the outcomes beside a limit, in the order of the suite."""
        return [each for (where, _, which), each in self.outcomes.items() if (where, which) == (rivers, limit)]

    def limited(self, rivers: str, limit: float | None = None) -> list[Outcome]:
        """Return the outcomes of policies that were trained with a limit, with any or with one."""
        return [
            each
            for (where, algorithm, which), each in self.outcomes.items()
            if where == rivers and algorithm not in LIMITLESS and limit in (None, which)
        ]

    def gap(self, algorithm: str, limit: float) -> str:
        """Return the reason why an algorithm has no outcome beside a limit, such as `missing`."""
        return "missing" if self.results is None else self.results.gap(self.name_of(algorithm, limit))

    def runs_of(self, outcome: Outcome) -> list[Path]:
        """Return the folders of the runs of an outcome, as far as their settings and metrics are there."""
        if self.results is None:
            return []
        name = self.name_of(outcome.algorithm, outcome.limit)
        folders = (self.results.folder / "runs" / row.run for row in self.results.runs if row.algorithm == name)
        return [path for path in folders if (path / "config.yaml").is_file() and (path / "metrics.csv").is_file()]

    def name_of(self, algorithm: str, limit: float) -> str:
        """Return the name of the policy of an algorithm beside a limit; empty where the suite has none."""
        return self.arms.get((algorithm, None)) or self.arms.get((algorithm, limit), "")

    def seeds_done(self, algorithm: str) -> int:
        """Return how many runs of an algorithm were flown, at all limits together."""
        if self.results is None:
            return 0
        names = self._names(algorithm)
        return len({(row.algorithm, row.seed) for row in self.results.episodes if row.algorithm in names})

    def seeds_planned(self, algorithm: str) -> int:
        """Return how many runs of an algorithm the suite asks for, at all limits together."""
        names = self._names(algorithm)
        return sum(len(arm["seeds"]) for arm in arms_of(self.suite) if arm["name"] in names)

    def _names(self, algorithm: str) -> set[str]:
        return {name for (which, _), name in self.arms.items() if which == algorithm}


Studies = Mapping[str, Study]
"""What was run of each task, by its name."""


def study_of(suite: Suite, results: Results | None) -> Study:
    """Return what the results of a suite of a task have, beside the oracle's fronts that come with the package.

    Raises `ResultsError` for results of other versions of the tasks than the front's, and where there is no front.
    """
    task, record = suite.task, suite.as_data() if results is None else results.suite
    fronts = {}
    for rivers in CONDITION:
        points = packaged_points(task, LEVEL, rivers)
        if not points:
            raise ResultsError(f"fronts.csv has no front of {task} on {rivers} rivers of {LEVEL} with today's tasks")
        fronts[rivers] = front_of(points)
    own = {arm["name"]: arm["settings"].get("cost_limit") for arm in arms_of(record)}
    arms = {(_without_limit(name, limit), limit): name for name, limit in own.items()}
    limits = tuple(sorted({limit for limit in own.values() if limit is not None}))
    outcomes = {}
    if results is not None:
        _check_tasks(task, results)
        outcomes = dict(_outcomes(task, results, arms, limits, fronts))
    return Study(task, record, limits, fronts, arms, results, outcomes)


def _without_limit(name: str, limit: float | None) -> str:
    """Return the name of a policy without its limit."""
    return name if limit is None else name.removesuffix(f"-{limit:g}")


def _outcomes(
    task: str,
    results: Results,
    arms: Mapping[tuple[str, float | None], str],
    limits: Sequence[float],
    fronts: Mapping[str, Front],
) -> Iterator[tuple[tuple[str, str, float], Outcome]]:
    """Yield the outcome of each policy on both kinds of rivers, as far as it was flown, with its key in `Study`."""
    for rivers, condition in CONDITION.items():
        flown = group_episodes(results.condition_episodes.get(condition, []) if condition else results.episodes)
        for (algorithm, own), name in arms.items():
            episodes = flown.get((name, LEVEL))
            for limit in limits if own is None else (own,):
                if episodes:
                    key = task, algorithm, limit, evaluated_seeds(results, name, episodes)
                    yield (rivers, algorithm, limit), outcome_of(key, episodes, fronts[rivers])


def _check_tasks(task: str, results: Results) -> None:
    """Raise `ResultsError` if runs were made with other tasks than today's."""
    found = {run: recorded.get("tasks") for run, recorded in results.versions.items()}
    other = [f"{run} has {version}" for run, version in found.items() if version != versions.TASKS]
    if other:
        raise ResultsError(
            f"{results.folder.name}: runs need tasks {versions.TASKS} of the front of {task}, but {other[0]}"
        )


def outcome_of(key: tuple[str, str, float, str], episodes: Sequence[Episode], front: Front) -> Outcome:
    """Return the outcome of a policy's episodes; `key` is task, algorithm, limit and seeds."""
    limit = key[2]
    return Outcome(
        *key,
        mean_estimate(episodes, "return_", bounds_of({"task": key[0]}, "return_", episodes)),
        task_cost(episodes),
        share_above(episodes, limit),
        by_seed(episodes, lambda rows: front.regret(mean_cost(rows), mean_return(rows))),
        worst_tenth(episodes),
    )


def held(study: Study, rivers: str, limit: float) -> list[Outcome]:
    """Return the outcomes of policies that were trained with a limit and hold it."""
    return [each for each in study.limited(rivers, limit) if each.holds]


def mean_text(value: float) -> str:
    """Return a mean with as many decimal places as its size needs."""
    return f"{value:.2f}" if abs(value) < 10 else f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"


def spread(estimate: Estimate) -> str:
    """Return a mean and how far its interval reaches, on the side where no bound cuts it; without one the mean."""
    text = mean_text(estimate.value)
    reach = max(estimate.high - estimate.value, estimate.value - estimate.low)
    return text if math.isnan(reach) else f"{text} ± {mean_text(reach)}"


def oracle_text(study: Study, rivers: str, limit: float) -> str:
    """Return the greatest return of the oracle within a limit, which may be below its safest point."""
    front = study.fronts[rivers]
    if limit < front.cost[0]:
        return f"unattainable; {front.return_[0]:.2f} at {mean_text(front.cost[0])}"
    return f"{float(front.greatest_return(limit)):.2f}"
