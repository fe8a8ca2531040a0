"""The trained policies, the training level, the numbers of seeds and what critics saw, as tables and figures show
them."""

from collections.abc import Callable, Sequence

import numpy as np

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.table import Table, is_published
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import regret
from thalweg.bench.suite.record import arms_of
from thalweg.train.observations import SEEN_BY_CRITICS

CRITICS_SEE = "critics see"
"""Heading of what critics see in training."""
COST_LIMIT = 0.1
"""Mean cost of an episode that every policy is judged by, whatever limit it was trained with."""


def trained_policies(results: Results) -> list[str]:
    """Return the names of the policies that were trained in these results, in the order of the suite."""
    return [
        name
        for arm in arms_of(results.suite)
        for name in (arm["name"], *(old for old, policy in results.outdated.items() if policy.policy == arm["name"]))
        if name in results.policies
    ]


def train_level(results: Results) -> str:
    """Return the training level of the suite, also for arms with a level of their own; the first level if unknown."""
    level = results.suite.get("train_level", "")
    return level if level in results.levels else results.levels[0]


def seeds_text(results: Results, algorithm: str, seeds: int) -> str:
    """Return the number of seeds of an algorithm, or `2 of 3` where some are missing."""
    planned = results.planned_seeds(algorithm)
    return str(seeds) if seeds >= planned else f"{seeds} of {planned}"


def evaluated_seeds(results: Results, policy: str, episodes: Sequence[Episode]) -> str:
    """Return how many of a policy's seeds flew these episodes, as `seeds_text`."""
    return seeds_text(results, policy, len({row.seed for row in episodes}))


def training_regret(results: Results, policy: str) -> float | None:
    """Return the mean over seeds of the training cost above `COST_LIMIT`, per episode of the last stage; None without
    a training log that has an episode."""
    per_seed = [regret(log, COST_LIMIT) for log in results.training if log.algorithm == policy and len(log.step)]
    return float(np.mean(per_seed)) if per_seed else None


def limit_met(cost: Estimate, limit: float = COST_LIMIT) -> str:
    """Return in words whether a mean cost is within a limit, as far as its interval shows."""
    if np.isnan(cost.low):
        return "below, unsure" if cost.value <= limit else "above, unsure"
    if cost.high <= limit:
        return "yes"
    return "no" if cost.low > limit else "unsure"


def with_critics(table: Callable[[Results], Table]) -> Callable[[Results], Table]:
    """Return a function that computes a table of policies, named in its column `policy`, with a last column
    `critics see`.

    Results without a trained policy have no such column. Critics of the published policies see what these do.
    """

    def with_column(results: Results) -> Table:
        found = table(results)
        if found.text.empty or not arms_of(results.suite):
            return found
        text, figures = found.text.copy(), found.figures.copy()
        text[CRITICS_SEE] = [
            SEEN_BY_CRITICS[False] if is_published(name) else results.critics_see(name) for name in text["policy"]
        ]
        published = figures["source"].map(is_published) if "source" in figures else [False] * len(figures)
        figures[CRITICS_SEE] = [
            SEEN_BY_CRITICS[False] if other else results.critics_see(name)
            for name, other in zip(figures["policy"], published, strict=True)
        ]
        return Table(text, figures)

    return with_column
