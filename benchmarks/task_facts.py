"""Sentences of `docs/task-findings.md` that follow from the results alone, so that they change with what is there."""

import math
import statistics
from collections.abc import Callable
from itertools import pairwise

from findings import share_at_bound
from page_sections import wrap
from task_outcomes import LIMITLESS, Outcome, Studies, held, mean_text, oracle_text
from task_risk import tail_fact
from task_training import training_fact

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.fronts.fronts import FIXED, UNSEEN
from thalweg.bench.report.policies import limit_met


def facts(studies: Studies) -> str:
    """Return the findings that follow from the results alone, a line for each."""
    run = {task: study for task, study in studies.items() if study.limited(FIXED)}
    if not run:
        return "Nothing has been run yet.\n"
    every: tuple[Callable[[Studies], str], ...] = (
        *(_who_holds, _price, _without_limit, _rising, _elsewhere, _nobody),
        *(_at_bound, tail_fact, training_fact),
    )
    return "".join(wrap(f"{number}. {fact(run)}") for number, fact in enumerate(every, start=1))


def _who_holds(studies: Studies) -> str:
    limited = [each for study in studies.values() for each in study.limited(FIXED)]
    names = dict.fromkeys([*ALGORITHMS, *(each.algorithm for each in limited)])
    groups = {name: [each for each in limited if each.algorithm == name] for name in names}
    counts = [(sum(each.holds for each in own), len(own), name) for name, own in groups.items() if own]
    told = ", ".join(
        f"{name} {count} of {number}" for count, number, name in sorted(counts, key=lambda c: -c[0] / c[1])
    )
    sure = sum(limit_met(each.cost, each.limit) == "yes" for each in limited)
    return (
        f"**Who holds the limit.** {sum(each.holds for each in limited)} of {len(limited)} mean costs are within the"
        f" limit, {sure} of them with the whole interval: {told}."
    )


def _price(studies: Studies) -> str:
    holders = [each for study in studies.values() for each in study.limited(FIXED) if each.holds]
    if not holders:
        return "**At what price.** Nobody holds a limit."
    holders.sort(key=lambda each: each.regret.value)
    middle = statistics.median(each.regret.value for each in holders)
    text = (
        f"**At what price.** Who holds the limit returns {holders[0].regret.value:.2f} ({_named(holders[0])}) to"
        f" {holders[-1].regret.value:.2f} points ({_named(holders[-1])}) less than the oracle at the same cost, with a"
        f" median of {middle:.2f}."
    )
    above = [each for each in holders if each.regret.value < 0]
    tasks = ", ".join(dict.fromkeys(each.task for each in above))
    return f"{text} {len(above)} of them return more than the oracle, on {tasks}." if above else text


def _without_limit(studies: Studies) -> str:
    told = [
        f"{each.cost.value / each.limit:.1f} times the middle limit of {task} and returns {each.return_.value:.2f},"
        f" {abs(each.regret.value):.2f} {'below' if each.regret.value >= 0 else 'above'} the oracle"
        for task, study in studies.items()
        for each in study.at(FIXED, study.middle_limit)
        if each.algorithm in LIMITLESS
    ]
    return f"**Without a limit** PPO costs {'; '.join(told) or 'what has not been measured yet'}."


def _rising(studies: Studies) -> str:
    rises: dict[str, list[bool]] = {"return": [], "cost": []}
    for study in studies.values():
        for algorithm in study.algorithms:
            found = [study.outcome(FIXED, algorithm, limit) for limit in study.limits]
            own = [each for each in found if each is not None and algorithm not in LIMITLESS]
            if len(own) == len(study.limits) > 2:
                rises["return"].append(all(a.return_.value < b.return_.value for a, b in pairwise(own)))
                rises["cost"].append(all(a.cost.value < b.cost.value for a, b in pairwise(own)))
    number = len(rises["cost"])
    if not number:
        return "**Whether a greater limit is used** is not known yet: nobody was run at all three limits of a task."
    return (
        f"**Whether a greater limit is used.** Of {number} algorithm{'s' * (number > 1)} with policies at all three"
        f" limits of a task, each task counted, the return rises from limit to limit in {sum(rises['return'])}, the"
        f" cost in {sum(rises['cost'])}."
    )


def _elsewhere(studies: Studies) -> str:
    holders = [(study, each) for study in studies.values() for each in study.limited(FIXED) if each.holds]
    flown = [there for study, each in holders if (there := study.outcome(UNSEEN, each.algorithm, each.limit))]
    every = [each for study in studies.values() for each in study.limited(UNSEEN)]
    return (
        f"**On unseen rivers** {sum(each.holds for each in flown)} of the {len(flown)} that hold the limit on the fixed"
        f" river hold it too. Of all {len(every)}, {sum(each.holds for each in every)} hold it there."
    )


def _nobody(studies: Studies) -> str:
    nobody, best = [], []
    for task, study in studies.items():
        for limit in study.limits:
            holders = held(study, FIXED, limit)
            if holders:
                first = max(holders, key=lambda each: each.return_.value)
                most = oracle_text(study, FIXED, limit)
                best.append(f"{mean_text(first.return_.value)} of {most} ({_named(first)})")
            elif study.limited(FIXED, limit):
                nobody.append(f"{task} at {limit:g}")
    text = f"**What nobody solves.** Limits that nobody holds: {', '.join(nobody) or 'none'}."
    which = "At the others" if nobody else "At each limit"
    return f"{text} {which} the best that hold it return {', '.join(best)} of what the oracle does." if best else text


def _at_bound(studies: Studies) -> str:
    shares: dict[bool, list[float]] = {True: [], False: []}
    names: dict[str, None] = {}
    for study in studies.values():
        for each in study.limited(FIXED):
            known = [share for run in study.runs_of(each) if not math.isnan(share := share_at_bound(run))]
            shares[each.holds] += known
            names |= dict.fromkeys([each.algorithm] if known else [])
    told = [
        f"in {statistics.mean(found):.0%} of the updates of runs whose policies {words} it ({len(found)})"
        for holds, words in ((False, "do not hold"), (True, "hold"))
        if (found := shares[holds])
    ]
    if not told:
        return "**Bounds of multipliers.** No run with a multiplier is there."
    return (
        "**Bounds of multipliers.** The multiplier, which prices cost where a limit is not held, stood at its upper"
        f" bound {', and '.join(told)}; these are {', '.join(names)}."
    )


def line_of(outcome: Outcome) -> str:
    """Return mean return and cost of an outcome in words."""
    above = "" if outcome.holds else ", above the limit"
    return f"{mean_text(outcome.return_.value)} at a cost of {mean_text(outcome.cost.value)}{above}"


def _named(outcome: Outcome) -> str:
    return f"{outcome.algorithm}, {outcome.task} at {outcome.limit:g}"
