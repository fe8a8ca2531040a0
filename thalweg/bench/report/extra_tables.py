"""What do the results say that the paper's table cannot? Tables of limits, of comparisons in pairs, and of conditions.

All figures are of episodes or of training logs in the results; intervals are over seeds, and there is none of fewer
than three.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.table import Cell, Sheet, as_share
from thalweg.bench.report.tables import seeds_text
from thalweg.bench.results.comparison import change, difference, improvement, shared_tables
from thalweg.bench.results.inference import Estimate, mean_of, share
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import grouped, regret
from thalweg.bench.suite.suites import arms_of

LIMIT = 0.1
"""Mean cost of an episode that everything is judged by, whatever limit it was given."""


def trained_policies(results: Results) -> list[str]:
    """The policies that were trained in these results, in their order."""
    return [arm["name"] for arm in arms_of(results.suite) if arm["name"] in results.policies]


def train_level(results: Results) -> str:
    """The level that the suite trains on, also for arms that have one of their own; or the first there is."""
    level = results.suite.get("train_level", "")
    return level if level in results.levels else results.levels[0]


def limits(results: Results) -> Sheet:
    """Whether each trained policy keeps the limit on the suite's level: its cost when it is evaluated, and what its
    training cost."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ("policy", "seeds", "cost", "limit met", "violations", "regret in training", "minutes", "steps a second")
    rows: list[list[Cell]] = []
    for name in trained_policies(results):
        own = flown.get((name, level))
        if own is None:
            rows.append([name, seeds_text(results, name, 0), *[results.gap(name)] * (len(header) - 2)])
            continue
        cost = mean_of(own, "cost")
        runs = [row for row in results.runs if row.algorithm == name and row.status == "finished"]
        worse = training_regret(results, name)
        rows.append(
            [
                name,
                flown_seeds(results, name, own),
                cost,
                kept(cost),
                as_share(share(own, lambda row: row.cost > 0)),
                "unknown" if worse is None else worse,
                float(np.mean([row.wall_s for row in runs]) / 60) if runs else "unknown",
                float(np.mean([row.steps_per_s for row in runs])) if runs else "unknown",
            ]
        )
    return Sheet(header, rows)


def flown_seeds(results: Results, policy: str, episodes: Sequence[Episode]) -> str:
    """How many of a policy's seeds flew these episodes, of how many where some are lacking."""
    return seeds_text(results, policy, len({row.seed for row in episodes}))


def training_regret(results: Results, policy: str) -> float | None:
    """The mean over seeds of what training cost beyond the limit, an episode, in its last stage; None where there is no
    log of it."""
    found = [regret(log, LIMIT) for log in results.training if log.algorithm == policy]
    return float(np.mean(found)) if found else None


def kept(cost: Estimate, limit: float = LIMIT) -> str:
    """Whether a mean cost is within a limit, as far as its interval tells."""
    if np.isnan(cost.low):
        return "below, unsure" if cost.value <= limit else "above, unsure"
    if cost.high <= limit:
        return "yes"
    return "no" if cost.low > limit else "unsure"


def pairs(results: Results) -> Sheet:
    """Each trained policy against each other on the suite's level, start by start."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ("policy", "against", "seeds", "returns more", "return, difference", "cost, difference")
    rows: list[list[Cell]] = []
    for one, other in combinations(trained_policies(results), 2):
        ours, theirs = flown.get((one, level)), flown.get((other, level))
        if ours is None or theirs is None:
            continue
        try:
            both = {field: shared_tables(ours, theirs, field) for field in ("return_", "cost")}
        except ValueError:
            rows.append([one, other, *["not the same starts"] * (len(header) - 2)])
            continue
        seeds = f"{flown_seeds(results, one, ours)} and {flown_seeds(results, other, theirs)}"
        apart = (difference(*tables, field) for field, tables in both.items())
        rows.append([one, other, seeds, as_share(improvement(*both["return_"])), *apart])
    return Sheet(header, rows)


def conditions(results: Results) -> Sheet:
    """How each policy does under each condition on each river, and how much its return changes from the main one where
    starts are the same."""
    main = grouped(results.episodes)
    header = ("policy", "condition", "level", "seeds", "return", "cost", "success", "return, change")
    rows: list[list[Cell]] = []
    for name, episodes in results.beyond.items():
        for (algorithm, level), own in grouped(episodes).items():
            rows.append(
                [
                    algorithm,
                    name,
                    level,
                    flown_seeds(results, algorithm, own),
                    mean_of(own, "return_"),
                    mean_of(own, "cost"),
                    as_share(share(own, lambda row: row.success)),
                    changed(own, main.get((algorithm, level), [])),
                ]
            )
    order = {name: place for place, name in enumerate(results.policies)}
    return Sheet(header, sorted(rows, key=lambda row: order[str(row[0])]))


def changed(after: Sequence[Episode], before: Sequence[Episode]) -> Estimate | str:
    """The mean change of the return from one condition to another, of the seeds that flew under both; `other starts`
    where they are not the same, `other seeds` where there are none."""
    both = {row.seed for row in after} & {row.seed for row in before}
    if not both:
        return "other seeds" if before else "other starts"
    ours, theirs = ([row for row in rows if row.seed in both] for rows in (after, before))
    try:
        return change(*shared_tables(ours, theirs, "return_"), "return_")
    except ValueError:
        return "other starts"
