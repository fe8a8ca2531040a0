"""The ranking of the trained policies on the training level, with what stands beside them for comparison."""

from dataclasses import dataclass, replace

import numpy as np

from thalweg.bench.packaged import PACKAGED
from thalweg.bench.report.policies import COST_LIMIT, limit_met, train_level, trained_policies
from thalweg.bench.report.price_tables import limit_of
from thalweg.bench.results.inference import CONFIDENCE, MIN_SEEDS, Estimate, mean_estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import bounds_of, task_of
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD
from thalweg.env.tasks import PAPER_TASK

IN_WORDS = {
    PACKAGED: "comes with Thalweg",
    "pilot": "a script that knows the map",
    "steady": "a script that knows the map",
    "random": "acts at random",
    "hover": "never moves",
    "forward": "always flies forward",
}
"""What policies are that were not trained in the results, by name; all others are functions."""
OTHER = "not trained here"
FIGURES = ("return_", "cost")
"""Fields of episodes whose means are shown."""


@dataclass(frozen=True)
class Ranked:
    """A policy that flew the training level."""

    policy: str
    place: int
    """From 1; 0 for one that was not trained in these results."""
    returns: Estimate
    """Mean return of an episode."""
    cost: Estimate
    """Mean cost of an episode."""
    completed: float
    """Share of flights that flew the whole course."""
    limit: float | None
    """Most mean cost of an episode that the policy may have; None where it has no limit."""
    about: str = ""
    """What it is, of one that was not trained."""

    @property
    def name(self) -> str:
        """The policy without the versions that it was made with where these are not the current ones."""
        return self.policy.partition(" (")[0]

    @property
    def words(self) -> str:
        """What stands below the name: what it is, and such versions."""
        return ", ".join(filter(None, (self.about, self.policy.partition(" (")[2].removesuffix(")"))))

    @property
    def within(self) -> bool:
        """Whether the mean cost is within the limit; not so without one."""
        return self.limit is not None and self.cost.value <= self.limit

    @property
    def limit_met(self) -> str:
        """Whether the limit is met, in words, as far as the interval of the cost shows."""
        return "no limit" if self.limit is None else limit_met(self.cost, self.limit)

    @property
    def bar(self) -> dict[str, float]:
        """Percentages of the greatest return: `end` of the bar, and `low` and `high` of the interval, the bar's end
        where there is none."""
        ends = (value for value in (self.returns.low, self.returns.high))
        low, high = (self.returns.value if np.isnan(end) else end for end in ends)
        named = {"end": self.returns.value, "low": low, "high": high}
        return {name: round(float(np.clip(value / FULL_COURSE_REWARD, 0, 1)) * 100, 1) for name, value in named.items()}


@dataclass(frozen=True)
class Ranking:
    """The policies of some results on their training level, the best first."""

    level: str
    trained: tuple[Ranked, ...]
    others: tuple[Ranked, ...]
    """Those that were not trained here, the greatest return first."""
    limit: float | None
    """The limit that all of the trained policies have; None where they differ."""
    paired: bool = False
    """Whether trained policies are compared in pairs, as `comparison_tables.pairwise_table` does current ones."""
    missing: tuple[str, ...] = ()
    """Policies without flights on the level, and why they have none, such as `P3O failed`."""

    @property
    def headline(self) -> str:
        """What the ranking shows, in a sentence or two; empty where no trained policy flew the level."""
        if not self.trained:
            return ""
        best, within = self.trained[0], sum(row.within for row in self.trained)
        of = f" ranks first of {len(self.trained)} trained policies" if len(self.trained) > 1 else ""
        limit = "" if best.limit is None else f" (limit {best.limit:g})"
        sentence = (
            f"{best.policy}{of} on {self.level}{': it' if of else ''} returns {best.returns.value:.2f} of"
            f" {FULL_COURSE_REWARD:g} and costs {best.cost.value:.2f} a flight on average{limit}, and"
            f" {best.completed:.0%} of its flights complete the course."
        )
        if self.limit is not None and of:
            sentence += (
                f" {within or 'None'} of the {len(self.trained)} {'is' if within < 2 else 'are'} within the limit."
            )
        return sentence

    @property
    def note(self) -> str:
        """How to read the ranking."""
        same = "Policies whose lines overlap may be equally good" + (
            ": see the section In pairs." if self.paired else "."
        )
        return (
            "Policies whose mean cost is within the limit come first, and among these the greater mean return. Bars are"
            f" mean returns over the flights of all seeds, lines on them {CONFIDENCE:.0%} confidence intervals over"
            f" training seeds where there are {MIN_SEEDS} or more. {same} A limit is met (yes or no) only if the whole"
            " interval of the cost says so."
            + (f" Without flights on {self.level}: {', '.join(self.missing)}." if self.missing else "")
        )


def ranking(results: Results) -> Ranking:
    """Return the ranking: policies whose mean cost is within their limit come before the others, and within each
    group a greater mean return comes first.

    The limit is `COST_LIMIT` on the paper's task, and that of the policy's training on tasks where a limit has a price.
    """
    level, groups = train_level(results), group_episodes(results.episodes)
    trained = trained_policies(results)
    paper = task_of(results.suite) == PAPER_TASK
    rows, missing = [], []
    for name in results.policies:
        if (episodes := groups.get((name, level))) is None:
            missing.append(f"{name} {results.gap(name)}")
            continue
        limit = (COST_LIMIT if paper else limit_of(results, name)) if name in trained else None
        returns, cost = (mean_estimate(episodes, each, bounds_of(results.suite, each, episodes)) for each in FIGURES)
        completed = float(np.mean([row.success for row in episodes]))
        about = "" if name in trained else IN_WORDS.get(name.partition(" (")[0], OTHER)
        rows.append(Ranked(name, 0, returns, cost, completed, limit, about))
    ranked = sorted((row for row in rows if not row.about), key=_rank)
    limits = {row.limit for row in ranked}
    return Ranking(
        level,
        tuple(replace(row, place=place) for place, row in enumerate(ranked, start=1)),
        tuple(sorted((row for row in rows if row.about), key=_by_return)),
        limits.pop() if len(limits) == 1 else None,
        sum(row.policy not in results.outdated for row in ranked) > 1,
        tuple(missing),
    )


def _rank(row: Ranked) -> tuple[bool, float]:
    return not row.within, _by_return(row)


def _by_return(row: Ranked) -> float:
    return -row.returns.value
