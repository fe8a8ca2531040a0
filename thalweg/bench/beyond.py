"""What do the results say that the paper's table cannot? Tables of limits, of comparisons in pairs, and of conditions.

All figures are of episodes or of training logs in the results; intervals are over seeds, and there is none of fewer
than three.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from thalweg.bench.comparison import change, difference, improvement, shared_tables
from thalweg.bench.episodes import Episode
from thalweg.bench.inference import Estimate, over_seeds, share, table_of
from thalweg.bench.results import Results
from thalweg.bench.statistics import grouped, regret
from thalweg.bench.suites import arms_of

Table = tuple[list[str], list[list[str]]]
"""Header and rows."""
LIMIT = 0.1
"""Mean cost of an episode that everything is judged by, whatever limit it was given."""


def trained_policies(results: Results) -> list[str]:
    """The policies that were trained in these results, in their order."""
    return [arm["name"] for arm in arms_of(results.suite) if arm["name"] in results.policies]


def train_level(results: Results) -> str:
    """The level of training, or the first there is."""
    level = results.suite.get("train_level", "")
    return level if level in results.levels else results.levels[0]


def limits_table(results: Results) -> Table:
    """Whether each trained policy keeps the limit on the level of training: its cost when it is evaluated, and what its
    training cost."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ["policy", "seeds", "cost", "limit met", "violations", "regret in training", "minutes", "steps a second"]
    rows = []
    for name in trained_policies(results):
        own = flown.get((name, level))
        if own is None:
            rows.append([name, "0", *[results.gap(name)] * (len(header) - 2)])
            continue
        cost = _mean(own, "cost")
        logs = [log for log in results.training if log.algorithm == name]
        runs = [row for row in results.runs if row.algorithm == name and row.status == "finished"]
        worse = [regret(log, LIMIT) for log in logs]
        rows.append(
            [
                name,
                str(len({row.seed for row in own})),
                str(cost),
                kept(cost),
                share(own, lambda row: row.cost > 0).as_percent(),
                f"{np.mean(worse):.2f}" if worse else "unknown",
                f"{np.mean([row.wall_s for row in runs]) / 60:.1f}" if runs else "unknown",
                f"{np.mean([row.steps_per_s for row in runs]):.0f}" if runs else "unknown",
            ]
        )
    return header, rows


def kept(cost: Estimate, limit: float = LIMIT) -> str:
    """Whether a mean cost is within a limit, as far as its interval tells."""
    if np.isnan(cost.low):
        return "below, unsure" if cost.value <= limit else "above, unsure"
    if cost.high <= limit:
        return "yes"
    return "no" if cost.low > limit else "unsure"


def pairs_table(results: Results) -> Table:
    """Each trained policy against each other on the level of training, start by start."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ["policy", "against", "returns more", "return, difference", "cost, difference"]
    rows = []
    for one, other in combinations(trained_policies(results), 2):
        ours, theirs = flown.get((one, level)), flown.get((other, level))
        if ours is None or theirs is None:
            continue
        try:
            returns, costs = (shared_tables(ours, theirs, field) for field in ("return_", "cost"))
        except ValueError:
            rows.append([one, other, *["not the same starts"] * 3])
            continue
        rows.append(
            [one, other, improvement(*returns).as_percent(), str(difference(*returns)), str(difference(*costs))]
        )
    return header, rows


def conditions_table(results: Results) -> Table:
    """How each policy does under each condition on each river, and how much its return changes from the main one where
    starts are the same."""
    main = grouped(results.episodes)
    header = ["policy", "condition", "river", "seeds", "return", "cost", "success", "return, change"]
    rows = []
    for name, episodes in results.beyond.items():
        for (algorithm, level), own in grouped(episodes).items():
            rows.append(
                [
                    algorithm,
                    name,
                    level,
                    str(len({row.seed for row in own})),
                    str(_mean(own, "return_")),
                    str(_mean(own, "cost")),
                    share(own, lambda row: row.success).as_percent(),
                    changed(own, main.get((algorithm, level), [])),
                ]
            )
    order = {name: place for place, name in enumerate(results.policies)}
    return header, sorted(rows, key=lambda row: order[row[0]])


def changed(after: Sequence[Episode], before: Sequence[Episode]) -> str:
    """The mean change of the return from one condition to another; `other starts` where they are not the same."""
    try:
        return str(change(*shared_tables(after, before, "return_")))
    except ValueError:
        return "other starts"


def _mean(rows: Sequence[Episode], field: str) -> Estimate:
    """The mean over episodes; without an interval where a seed did not fly every start."""
    try:
        return over_seeds(table_of(rows, field), np.mean)
    except ValueError:
        return Estimate(float(np.mean([getattr(row, field) for row in rows])))
