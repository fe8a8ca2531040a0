"""The findings at the top of `docs/findings.md`: each a sentence, its numbers with intervals, and a picture.

All of them follow from the results in this folder alone, so that they change with what is there. One whose results are
not there yet is left out. Which numbers a sentence holds does not depend on how they turn
out.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import any_river
import numpy as np
from any_river_aims import MASKED
from findings import GEOMETRY, STUDY, results_of
from headline import Headline
from river_flights import mean_return
from scipy import stats
from study_flights import (
    FLIES,
    PLANNER_FLIES,
    algorithms,
    by_seed_change,
    critics_in_words,
    difference,
    flown,
    is_whole,
    least_return,
    listed,
    of_same_versions,
    reference,
    returned,
    share,
)
from tables import rows_of
from task_findings import read_studies
from task_outcomes import LIMITLESS

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.fronts.fronts import FIXED
from thalweg.bench.report.comparison_tables import return_change
from thalweg.bench.report.policies import COST_LIMIT, limit_met, train_level
from thalweg.bench.report.published import PUBLISHED
from thalweg.bench.results.inference import Estimate, mean_estimate
from thalweg.bench.results.results import Results
from thalweg.bench.suite.builtin import BESIDE, STUDIED
from thalweg.core.seeds import parse_seeds

HERE = Path(__file__).resolve().parent


def who_flies(results: Results) -> Headline:
    """Return which algorithms fly on the training level."""
    names, level = algorithms(results), train_level(results)
    found = {name: each for name in names if (each := returned(results, name)) is not None}
    flying = sorted(
        (name for name in names if found[name].value >= least_return(name)), key=lambda name: -found[name].value
    )
    theirs = {name: PUBLISHED[name, level].return_mean for name in STUDIED}
    fewer = [name for name in dict.fromkeys((*STUDIED, *BESIDE, *names)) if not is_whole(results, name)]
    sentence = (
        f"Of the {len(names)} algorithms flown, {len(flying)} {_verb(flying, 'learn')} to fly, that is, return at least"
        f" {FLIES:g} of 10 on {level}, or {PLANNER_FLIES:g} if they are planners:"
        f" {listed([f'{name} {found[name]}' for name in flying]) or 'none'}."
    ) + _who_flies_in_the_paper(theirs)
    if fewer:
        some, none = [name for name in fewer if name in names], [name for name in fewer if name not in names]
        sentence += f" Fewer than three seeds: {listed(some)}." if some else ""
        sentence += f" Not flown yet: {listed(none)}." if none else ""
    if len({results.critics_see(name) for name in names}) > 1:
        sentence += f" {critics_in_words(results, names)}"
    series = {
        "here": tuple(found[name] for name in names),
        "paper (another simulator)": tuple(Estimate(theirs[name]) if name in theirs else None for name in names),
    }
    return Headline(
        "who-flies", "Who learns to fly", sentence, tuple(names), series, f"mean return on {level}", line=FLIES
    )


def _who_flies_in_the_paper(theirs: Mapping[str, float]) -> str:
    """Return what a sentence says of the paper's returns by algorithm."""
    best = max(theirs, key=lambda name: theirs[name])
    there = sum(value >= least_return(name) for name, value in theirs.items())
    return (
        f" In the paper, in another simulator, {there or 'none'} of {len(theirs)} did; the most was"
        f" {theirs[best]:.2f} ({best})."
    )


def settings(results: Results) -> Headline | None:
    """Return what our settings add to the return of algorithms, beside those of the paper; None where no algorithm was
    flown with both."""
    pairs = [name for name in algorithms(results) if flown(results, f"{name}-paper")]
    if not pairs:
        return None
    level = train_level(results)
    gains = [f"{name} {difference(flown(results, name), flown(results, f'{name}-paper'))}" for name in pairs]
    sentence = (
        f"With our default settings in place of the study's, as far as these are known, the return on {level} is"
        f" greater by: {listed(gains)}."
    )
    series = {
        "our settings": tuple(returned(results, name) for name in pairs),
        "the study's": tuple(returned(results, f"{name}-paper") for name in pairs),
    }
    return Headline("settings", "Settings", sentence, tuple(pairs), series, f"mean return on {level}")


def eye(results: Results, other: Results | None) -> Headline | None:
    """Return what codes of geometry change, and how alike the orders of the algorithms are; None where they were not
    flown, or with other versions, whose rivers and starts are others."""
    if other is None or not of_same_versions(results, other):
        return None
    names = [name for name in algorithms(results) if flown(other, name)]
    if not names:
        return None
    whole = [name for name in names if is_whole(results, name) and is_whole(other, name)]
    series: dict[str, tuple[Estimate | None, ...]] = {
        words: tuple(returned(each, name) for name in names)
        for words, each in (("codes of the autoencoder", results), ("codes of geometry", other))
    }
    changes = [f"{name} {difference(flown(other, name), flown(results, name))}" for name in whole]
    sentence = (
        f"On codes of geometry in place of the autoencoder's, the return on {train_level(results)} is greater by:"
        f" {listed(changes) or 'no algorithm has three seeds of both'}."
    )
    if len(whole) > 2:
        values = [[mean_estimate(flown(each, name), "return_").value for name in whole] for each in (results, other)]
        alike = float(stats.spearmanr(values[0], values[1])[0])  # pyright: ignore[reportArgumentType]
        orders = f"both orders of these {len(whole)} algorithms"
        sentence += f" The rank correlation of {orders} is {alike:.2f} (no interval)."
    if fewer := [name for name in names if name not in whole]:
        sentence += f" Fewer than three seeds of both: {listed(fewer)}."
    return Headline(
        "eye", "The eye and the algorithm", sentence, tuple(names), series, f"mean return on {train_level(results)}",
        folders=(STUDY.name, GEOMETRY.name),
    )  # fmt: skip


def limit(results: Results) -> Headline | None:
    """Return whether the cost limit of the paper's task is met, and whether it lowers the cost; None where neither an
    algorithm with a limit nor the policy without one has all seeds."""
    base = reference(results)
    names = [name for name in algorithms(results) if name not in LIMITLESS and is_whole(results, name)]
    labels = tuple(name for name in (base, *names) if is_whole(results, name))
    if not labels:
        return None
    costs = {name: mean_estimate(flown(results, name), "cost") for name in labels}
    met = [name for name in names if limit_met(costs[name]) == "yes"]
    above = [name for name in names if limit_met(costs[name]) == "no"]
    sentence = (
        f"On {train_level(results)}, of the {len(names)} algorithms that have the cost limit of {COST_LIMIT:g} and"
        f" three seeds, {listed(met) or 'none'} certainly {_verb(met, 'meet')} it (with the whole confidence interval),"
        f" and {listed(above) or 'none'} certainly {_verb(above, 'exceed')} it."
        f" {_cost_without_limit(results, base, names)}"
        f" {critics_in_words(results, labels)}"
    )
    series = {"cost": tuple(costs.values())}
    return Headline(
        "limit", "The limit of the paper's task", sentence, labels, series, "mean cost of an episode", line=COST_LIMIT
    )


def _verb(names: Sequence[str], verb: str) -> str:
    """Return a verb in the number of its subjects; none at all are several."""
    return f"{verb}s" if len(names) == 1 else verb


def _cost_without_limit(results: Results, base: str, names: Sequence[str]) -> str:
    """Return a sentence on which policies with a limit cost less than the one without."""
    if not is_whole(results, base):
        return f"{base}, which has no limit, does not have three seeds, so that costs are not compared with its own."
    cost = flown(results, base)
    lower = [name for name in names if difference(flown(results, name), cost, "cost").high < 0]
    less = (
        f"{listed(lower)} {'costs' if len(lower) == 1 else 'cost'} significantly less"
        if lower
        else "none of them costs significantly less"
    )
    return f"{base}, which has no limit, costs {mean_estimate(cost, 'cost')}; {less}."


def price(folder: Path = HERE) -> Headline | None:
    """Return how often limits that have a price are held, and how far below the oracle; None where nothing was run."""
    studies = [study for study in read_studies(folder).values() if study.limited(FIXED)]
    every = [each for study in studies for each in study.limited(FIXED)]
    if not every:
        return None
    folders = tuple(study.suite["name"] for study in studies)
    held = [each for each in every if each.holds]
    names = [name for name in ALGORITHMS if any(each.algorithm == name for each in every)]
    tasks = list(dict.fromkeys(each.task for each in every))
    below = [each.regret.value for each in held]
    sentence = (
        f"In tasks where safety has a price ({listed(tasks)}), the mean cost is within the limit for {len(held)} of"
        f" {len(every)} pairs of an algorithm and a limit ({share(len(held), len(every))})."
    )
    if below:
        sentence += f" These return {np.median(below):.2f} points (the median) less than the oracle at the same cost."
    shares = [
        share(sum(each.holds for each in every if each.algorithm == name), sum(e.algorithm == name for e in every))
        for name in names
    ]
    return Headline(
        "price", "Limits that have a price", sentence, tuple(names), {"held": tuple(shares)},
        "share of limits that are held in the mean", folders=folders,
    )  # fmt: skip


@dataclass(frozen=True)
class Student:
    """Mean returns of imitated students on the training level of the study, without those that were not flown."""

    fixed: Estimate | None
    """On the level's one river, on which no student was trained."""
    unseen: Estimate | None
    varied: Estimate | None
    """On unseen rivers under varied looks."""
    steps: int = 0
    """Steps of training of each."""


def student(level: str, table: Path = any_river.TABLE) -> Student:
    """Return what students of image and mask return on a level, from the table of `any_river.py`."""
    rows = rows_of(table, any_river.COLUMNS)
    cells = [any_river.cells_of(rows, MASKED, kind, level) for kind in ("fixed", "unseen", "varied")]
    steps = max((int(row["steps"]) for found in cells for row in found), default=0)
    return Student(*(mean_return(found) if found else None for found in cells), steps=steps)


def elsewhere(results: Results, beside: Student | None = None) -> Headline | None:
    """Return what policies that fly lose on unseen rivers and under unseen looks, and what imitated students return
    there; None where no policy that flies was flown there."""
    names = [
        name
        for name in algorithms(results)
        if is_whole(results, name)
        and mean_estimate(flown(results, name), "return_").value >= least_return(name)
        and flown(results, name, "unseen")
    ]
    if not names:
        return None
    changes, looks = ([*_changes(results, names, condition)] for condition in ("unseen", "all_at_once"))
    sentence = (
        f"On unseen rivers of {train_level(results)} the return of algorithms that fly changes by: {listed(changes)}"
        + (f"; under every look at once, on the river of training, by: {listed(looks)}." if looks else ".")
        + _student_in_words(beside, train_level(results))
    )
    series = {
        words: tuple(returned(results, name, condition) for name in names)
        for words, condition in (
            ("fixed river", ""), ("unseen rivers", "unseen"), ("every look at once", "all_at_once"),
        )
    }  # fmt: skip
    if beside is not None and beside.unseen is not None:
        own = (beside.fixed, beside.unseen, None)
        nothing = (None,) * len(names)
        names = [*names, "imitated student"]
        series = {words: (*values, value) for (words, values), value in zip(series.items(), own, strict=True)}
        series["unseen rivers, varied looks"] = (*nothing, beside.varied)
    return Headline(
        "elsewhere", "Other rivers and looks", sentence, tuple(names), series, f"mean return on {train_level(results)}"
    )


def _student_in_words(beside: Student | None, level: str) -> str:
    """Return sentences on imitated students; empty where none was flown on unseen rivers."""
    if beside is None or beside.unseen is None:
        return ""
    found = [
        f"{value} {where}"
        for value, where in (
            (beside.fixed, f"on the fixed river of {level}, which is new to it"),
            (beside.unseen, "on unseen rivers"),
            (beside.varied, "there under varied looks"),
        )
        if value is not None
    ]
    return (
        " A [student](imitation.md) of today's versions, which learnt from a pilot with the map in"
        f" {beside.steps:,} steps on {len(parse_seeds(any_river.WORLD_SEEDS))} rivers of each level under varied looks,"
        f" and takes its most probable options, returns {listed(found)}."
    )


def _changes(results: Results, names: Sequence[str], condition: str) -> Iterator[str]:
    """Yield the change of the return of each policy under a condition: paired by start where the starts are the same,
    and by seed elsewhere."""
    for name in names:
        after, before = flown(results, name, condition), flown(results, name)
        if not after:
            continue
        change = return_change(after, before)
        yield f"{name} {change if isinstance(change, Estimate) else by_seed_change(after, before)}"


@cache
def headlines(folder: Path = HERE) -> tuple[Headline, ...]:
    """Return the findings that the results of a folder show."""
    study = results_of(folder / STUDY.name)
    geometry = results_of(folder / GEOMETRY.name) if (folder / GEOMETRY.name).is_dir() else None
    every: tuple[Callable[[], Headline | None], ...] = (
        lambda: who_flies(study),
        lambda: settings(study),
        lambda: eye(study, geometry),
        lambda: limit(study),
        lambda: price(folder),
        lambda: elsewhere(study, student(train_level(study), folder / any_river.TABLE.name)),
    )
    return tuple(found for make in every if (found := make()) is not None)
