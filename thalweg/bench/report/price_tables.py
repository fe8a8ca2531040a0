"""Tables of tasks where a limit has a price: each policy beside the oracle, and the area that an algorithm's limits
cover.

The oracle's front is that of the training level's fixed river. Intervals of mean cost and mean return are those of
`mean_estimate`, that of a share is `proportion`'s, the others are over seeds; there is none for fewer than three.
"""

import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from thalweg.algos import AlgorithmError
from thalweg.algos.registry import installed_algorithm
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.fronts.fronts import FrontPoint, front_of, packaged_points
from thalweg.bench.report.policies import evaluated_seeds, limit_met, train_level, trained_policies
from thalweg.bench.report.table import Cell, Table, table_from_cells
from thalweg.bench.results.front import Front
from thalweg.bench.results.inference import Estimate, Proportion, clip, mean_estimate, proportion, t_interval
from thalweg.bench.results.results import Results
from thalweg.bench.results.risk import conditional_value_at_risk
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.record import arms_of, bounds_of, oracle_knows, stages_of, task_of
from thalweg.env.tasks import PAPER_TASK

PRICE_COLUMNS = (
    *("policy", "seeds", "limit", "cost", "limit met", "flights above", "worst tenth costs"),
    *("return", "below the oracle"),
)
AREA_COLUMNS = ("algorithm", "limits", "seeds", "share of the oracle's area")


def oracle_points(results: Results) -> list[FrontPoint]:
    """Return the oracle's points on the fixed river of the training level; none under rules that it does not know
    (`oracle_knows`), or where there is no front of today's tasks."""
    if not oracle_knows(results.suite):
        return []
    return packaged_points(task_of(results.suite), train_level(results))


def limit_of(results: Results, policy: str) -> float | None:
    """Return the cost limit of an episode that a policy was trained with; None for one without."""
    name = results.outdated[policy].policy if policy in results.outdated else policy
    arm = next((arm for arm in arms_of(results.suite) if arm["name"] == name), None)
    entry = None if arm is None else installed_algorithm(arm.get("algorithm", ""))
    if arm is None or entry is None:
        return None
    _, settings, preset = stages_of(arm)[-1]
    try:
        config = entry.configure(dict(settings), preset, results.suite.get("num_envs", 1))
    except AlgorithmError:  # settings of an earlier version
        return settings.get("cost_limit")
    return getattr(config, "cost_limit", None)


def by_seed(episodes: Sequence[Episode], figure: Callable[[Sequence[Episode]], float]) -> Estimate:
    """Return a figure of all episodes, with an interval over its values for each seed."""
    groups: dict[int, list[Episode]] = defaultdict(list)
    for row in episodes:
        groups[row.seed].append(row)
    return t_interval(figure(episodes), np.array([figure(rows) for rows in groups.values()]))


def costs_of(episodes: Sequence[Episode]) -> np.ndarray:
    """Return the costs [K] of episodes."""
    return np.array([row.cost for row in episodes])


def task_cost(episodes: Sequence[Episode]) -> Estimate:
    """Return the mean cost of episodes of a task whose costs have no greatest value."""
    return mean_estimate(episodes, "cost", (None, math.inf))


def task_return(results: Results, episodes: Sequence[Episode]) -> Estimate:
    """Return the mean return of episodes of the task of some results."""
    return mean_estimate(episodes, "return_", bounds_of(results.suite, "return_", episodes))


def share_above(episodes: Sequence[Episode], limit: float) -> Proportion:
    """Return the share of episodes that cost more than a limit."""
    return proportion(episodes, lambda row: row.cost > limit)


def worst_tenth(episodes: Sequence[Episode]) -> Estimate:
    """Return the mean cost of the worst tenth of episodes, with an interval over seeds."""
    return clip(by_seed(episodes, lambda rows: conditional_value_at_risk(costs_of(rows))), 0.0, math.inf)


def mean_cost(episodes: Sequence[Episode]) -> float:
    """Return the mean cost of episodes."""
    return float(costs_of(episodes).mean())


def mean_return(episodes: Sequence[Episode]) -> float:
    """Return the mean return of episodes."""
    return float(np.mean([row.return_ for row in episodes]))


def price_table(results: Results) -> Table:
    """Return each trained policy's cost, how it is distributed about its own limit, and its return, beside the
    oracle's at that cost, which is today's and so unknown for outdated runs; no row for the paper's task."""
    points = oracle_points(results)
    groups, level = group_episodes(results.episodes), train_level(results)
    rows: list[list[Cell]] = []
    if task_of(results.suite) == PAPER_TASK:
        return table_from_cells(PRICE_COLUMNS, rows)
    for name in trained_policies(results):
        episodes = groups.get((name, level))
        if episodes is None:
            rows.append([name, *[results.gap(name)] * (len(PRICE_COLUMNS) - 1)])
            continue
        front = front_of(points) if points and name not in results.outdated else None
        rows.append(_price_row(results, name, episodes, front))
    return table_from_cells(PRICE_COLUMNS, rows)


def _price_row(results: Results, name: str, episodes: Sequence[Episode], front: Front | None) -> list[Cell]:
    limit, cost = limit_of(results, name), task_cost(episodes)
    about_limit: list[Cell] = ["none", cost, "no limit", "no limit"]
    if limit is not None:
        about_limit = [limit, cost, limit_met(cost, limit), share_above(episodes, limit)]
    regret: Cell = "unknown"
    if front is not None:
        regret = by_seed(episodes, lambda rows: front.regret(mean_cost(rows), mean_return(rows)))
    seeds = evaluated_seeds(results, name, episodes)
    return [name, seeds, *about_limit, worst_tenth(episodes), task_return(results, episodes), regret]


@dataclass(frozen=True)
class CoveredArea:
    """The area of cost and return that the policies of one algorithm cover, which differ by their limits alone."""

    name: str
    """The algorithm, or the names of the arms where it has several such groups."""
    limits: int
    """Number of limits."""
    seeds: int
    """Number of seeds that were flown at all of them."""
    share: Estimate
    """Of the oracle's area."""


def covered_areas(results: Results) -> list[CoveredArea]:
    """Return for each algorithm that was trained with several limits, and otherwise alike, the area of cost and return
    that its policies cover; none where there is no front of the oracle."""
    points = oracle_points(results)
    found = []
    for name, policies in _with_several_limits(results) if points else ():
        front = front_of(points)
        reference = float(front.cost[-1])
        seeds = sorted(set.intersection(*({row.seed for row in rows} for rows in policies)))
        areas = [_area(policies, seed, reference) / front.hypervolume(reference) for seed in seeds]
        if areas:
            share = t_interval(float(np.mean(areas)), np.array(areas))
            found.append(CoveredArea(name, len(policies), len(seeds), share))
    return found


def area_table(results: Results) -> Table:
    """Return the area that each algorithm covers, see `covered_areas`, in shares of the oracle's."""
    rows = [[each.name, str(each.limits), str(each.seeds), each.share] for each in covered_areas(results)]
    return table_from_cells(AREA_COLUMNS, rows)


def _with_several_limits(results: Results) -> list[tuple[str, list[list[Episode]]]]:
    """Return the policies whose arms differ by their limits alone, of which there are two or more: the algorithm, or
    the names of the arms where it has several such groups, and the episodes of each policy."""
    groups, level = group_episodes(results.episodes), train_level(results)
    arms: dict[str, Any] = {arm["name"]: arm for arm in arms_of(results.suite)}
    alike: dict[str, dict[float, str]] = defaultdict(dict)
    for name in trained_policies(results):
        if name in arms and (name, level) in groups and (limit := limit_of(results, name)) is not None:
            alike[_but_for_the_limit(arms[name])][limit] = name
    several = [list(by_limit.values()) for by_limit in alike.values() if len(by_limit) > 1]
    count = Counter(arms[names[0]]["algorithm"] for names in several)
    titles = [arms[names[0]]["algorithm"] for names in several]
    return [
        (title if count[title] == 1 else ", ".join(names), [groups[name, level] for name in names])
        for title, names in zip(titles, several, strict=True)
    ]


def _but_for_the_limit(arm: dict[str, Any]) -> str:
    """Return all that an arm is but its name, its seeds and its limit."""
    _, settings, preset = stages_of(arm)[-1]
    others = {key: value for key, value in settings.items() if key != "cost_limit"}
    kept = {key: value for key, value in arm.items() if key not in ("name", "seeds", "settings", "preset")}
    return json.dumps([kept, others, preset], sort_keys=True)


def _area(policies: Sequence[Sequence[Episode]], seed: int, reference: float) -> float:
    """Return the hypervolume of the policies of one seed."""
    flights = [[row for row in rows if row.seed == seed] for rows in policies]
    front = Front.of(np.array([mean_cost(rows) for rows in flights]), np.array([mean_return(rows) for rows in flights]))
    return front.hypervolume(reference)
