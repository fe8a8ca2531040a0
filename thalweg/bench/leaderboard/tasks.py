"""Policies of results of tasks where safety has a price as rows of the leaderboard: each beside its own limit and the
oracle's front."""

import math
from dataclasses import dataclass, field
from typing import Any

from thalweg.bench.fronts.fronts import FIXED, UNSEEN, front_of, packaged_points
from thalweg.bench.leaderboard.entries import flown_names
from thalweg.bench.leaderboard.policy_entry import PolicyEntry, arm_fields, flown_fields, flown_policies
from thalweg.bench.leaderboard.requirements import LEVEL, Flights
from thalweg.bench.report.policies import limit_met
from thalweg.bench.report.price_tables import by_seed, limit_of, mean_cost, mean_return, task_cost, task_return
from thalweg.bench.results.front import Front
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.suite.record import arms_of, oracle_knows, task_of


@dataclass(frozen=True, kw_only=True)
class TaskEntry(PolicyEntry):
    """A policy of a task, on the level's fixed river (`FIXED`) and on unseen rivers of it (`UNSEEN`)."""

    task: str
    limit: float | None
    """Cost limit of an episode that it was trained with; None without one."""
    returns: dict[str, Estimate] = field(default_factory=dict)
    """Mean return by rivers, as far as they were flown; the same holds for the next two."""
    costs: dict[str, Estimate] = field(default_factory=dict)
    regrets: dict[str, Estimate] = field(default_factory=dict)
    """How much more the oracle returns at the same cost on the same rivers: the distance to its front; without those
    that have no front, and under rules that the oracle does not know."""

    @property
    def limit_met(self) -> str:
        """Whether its limit is met on the fixed river, in words."""
        if FIXED not in self.costs:
            return "unknown"
        return "no limit" if self.limit is None else limit_met(self.costs[FIXED], self.limit)

    @property
    def sort_key(self) -> tuple[float, bool, int, float]:
        """Smaller limits come first; then complete rows, those that surely meet the limit, those that do in the mean,
        and the greater return."""
        returned = self.returns[FIXED].value if FIXED in self.returns else 0.0
        limit = math.inf if self.limit is None else self.limit
        within = FIXED in self.costs and self.costs[FIXED].value <= limit
        group = 0 if self.limit_met == "yes" else 1 if within else 2
        return limit, bool(self.missing), group, -returned


def fronts_of(task: str) -> dict[str, Front]:
    """Return the oracle's fronts of a task on `LEVEL` by rivers, as far as there are any of today's tasks."""
    found = {rivers: packaged_points(task, LEVEL, rivers) for rivers in (FIXED, UNSEEN)}
    return {rivers: front_of(points) for rivers, points in found.items() if points}


def task_entries(results: Results) -> list[TaskEntry]:
    """Return the policies of results of a task, as far as any run of them has started: trained ones, the packaged one,
    functions, and others of files."""
    fronts, found = fronts_of(task_of(results.suite)) if oracle_knows(results.suite) else {}, []
    for arm in arms_of(results.suite):
        for name, usual, other in flown_names(results, arm["name"]):
            if usual or any(row.algorithm == name for row in results.runs):
                about = arm_fields(results, name, arm, usual, other)
                found.append(_entry(results, name, about, fronts, {FIXED: usual, UNSEEN: other}))
    for policy in flown_policies(results):
        for name, usual, other in flown_names(results, policy["name"]):
            if usual:
                about = flown_fields(results, name, policy, usual, other)
                found.append(_entry(results, name, about, fronts, {FIXED: usual, UNSEEN: other}))
    return found


def _entry(
    results: Results, name: str, about: dict[str, Any], fronts: dict[str, Front], flights: dict[str, Flights]
) -> TaskEntry:
    """Return the entry of a policy with its flights by rivers; `about`: the fields of `PolicyEntry`."""
    flown = {rivers: rows for rivers, levels in flights.items() if (rows := levels.get(LEVEL))}
    regrets = {
        rivers: by_seed(rows, lambda own, front=fronts[rivers]: front.regret(mean_cost(own), mean_return(own)))
        for rivers, rows in flown.items()
        if rivers in fronts and name not in results.outdated
    }
    return TaskEntry(
        **about,
        task=task_of(results.suite),
        limit=limit_of(results, name),
        returns={rivers: task_return(results, rows) for rivers, rows in flown.items()},
        costs={rivers: task_cost(rows) for rivers, rows in flown.items()},
        regrets=regrets,
    )
