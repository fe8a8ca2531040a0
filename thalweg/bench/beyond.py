"""What do the results say that the paper's table cannot? Tables of limits, of comparisons in pairs, and of conditions.

All figures are of episodes or of training logs in the results; intervals are over seeds, and there is none of fewer
than three.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from thalweg.bench.comparison import change, difference, improvement, shared_tables
from thalweg.bench.episodes import Episode
from thalweg.bench.files import csv_text
from thalweg.bench.inference import Estimate, mean_of, share, span
from thalweg.bench.results import Results
from thalweg.bench.statistics import grouped, regret
from thalweg.bench.suites import arms_of
from thalweg.bench.tables import Grid, with_ends


@dataclass(frozen=True)
class Sheet:
    """A table before it is text: cells are words, numbers or estimates."""

    header: tuple[str, ...]
    rows: list[list[str | float | Estimate]]

    @property
    def grid(self) -> Grid:
        """As people read it."""
        return list(self.header), [[_words(cell) for cell in row] for row in self.rows]

    @property
    def csv(self) -> str:
        """At full precision; what is an estimate anywhere has three columns, its ends empty where there are none."""
        columns = zip(*self.rows, strict=True) if self.rows else [()] * len(self.header)
        estimated = [any(isinstance(cell, Estimate) for cell in column) for column in columns]
        names = [
            name if not three else f"{name}{end}"
            for name, three in zip(self.header, estimated, strict=True)
            for end in (("", ", low", ", high") if three else ("",))
        ]
        rows = [
            [number for cell, three in zip(row, estimated, strict=True) for number in _numbers(cell, three)]
            for row in self.rows
        ]
        return csv_text(names, rows)


class Share(Estimate):
    """An estimate that people read in percent."""

    def __str__(self) -> str:
        return self.as_percent()


def _words(cell: str | float | Estimate) -> str:
    return f"{cell:.2f}" if isinstance(cell, float) else str(cell)


def _numbers(cell: str | float | Estimate, three: bool) -> list[object]:
    if isinstance(cell, Estimate):
        return with_ends(cell)
    return [cell, "", ""] if three else [cell]


def _share(found: Estimate) -> Share:
    return Share(found.value, found.low, found.high)


LIMIT = 0.1
"""Mean cost of an episode that everything is judged by, whatever limit it was given."""


def trained_policies(results: Results) -> list[str]:
    """The policies that were trained in these results, in their order."""
    return [arm["name"] for arm in arms_of(results.suite) if arm["name"] in results.policies]


def train_level(results: Results) -> str:
    """The level of training, or the first there is."""
    level = results.suite.get("train_level", "")
    return level if level in results.levels else results.levels[0]


def limits(results: Results) -> Sheet:
    """Whether each trained policy keeps the limit on the level of training: its cost when it is evaluated, and what its
    training cost."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ("policy", "seeds", "cost", "limit met", "violations", "regret in training", "minutes", "steps a second")
    rows: list[list[str | float | Estimate]] = []
    for name in trained_policies(results):
        own = flown.get((name, level))
        if own is None:
            rows.append([name, "0", *[results.gap(name)] * (len(header) - 2)])
            continue
        cost = mean_of(own, "cost")
        runs = [row for row in results.runs if row.algorithm == name and row.status == "finished"]
        worse = training_regret(results, name)
        rows.append(
            [
                name,
                str(len({row.seed for row in own})),
                cost,
                kept(cost),
                _share(share(own, lambda row: row.cost > 0)),
                "unknown" if worse is None else worse,
                float(np.mean([row.wall_s for row in runs]) / 60) if runs else "unknown",
                float(np.mean([row.steps_per_s for row in runs])) if runs else "unknown",
            ]
        )
    return Sheet(header, rows)


def training_regret(results: Results, policy: str) -> float | None:
    """The mean over seeds of what training cost beyond the limit, an episode; None where there is no log of it."""
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
    """Each trained policy against each other on the level of training, start by start."""
    level, flown = train_level(results), grouped(results.episodes)
    header = ("policy", "against", "returns more", "return, difference", "cost, difference")
    rows: list[list[str | float | Estimate]] = []
    for one, other in combinations(trained_policies(results), 2):
        ours, theirs = flown.get((one, level)), flown.get((other, level))
        if ours is None or theirs is None:
            continue
        try:
            both = {field: shared_tables(ours, theirs, field) for field in ("return_", "cost")}
        except ValueError:
            rows.append([one, other, *["not the same starts"] * 3])
            continue
        apart = (difference(*tables, span(field)) for field, tables in both.items())
        rows.append([one, other, _share(improvement(*both["return_"])), *apart])
    return Sheet(header, rows)


def conditions(results: Results) -> Sheet:
    """How each policy does under each condition on each river, and how much its return changes from the main one where
    starts are the same."""
    main = grouped(results.episodes)
    header = ("policy", "condition", "level", "seeds", "return", "cost", "success", "return, change")
    rows: list[list[str | float | Estimate]] = []
    for name, episodes in results.beyond.items():
        for (algorithm, level), own in grouped(episodes).items():
            rows.append(
                [
                    algorithm,
                    name,
                    level,
                    str(len({row.seed for row in own})),
                    mean_of(own, "return_"),
                    mean_of(own, "cost"),
                    _share(share(own, lambda row: row.success)),
                    changed(own, main.get((algorithm, level), [])),
                ]
            )
    order = {name: place for place, name in enumerate(results.policies)}
    return Sheet(header, sorted(rows, key=lambda row: order[str(row[0])]))


def changed(after: Sequence[Episode], before: Sequence[Episode]) -> Estimate | str:
    """The mean change of the return from one condition to another; `other starts` where they are not the same."""
    try:
        return change(*shared_tables(after, before, "return_"), span("return_"))
    except ValueError:
        return "other starts"
