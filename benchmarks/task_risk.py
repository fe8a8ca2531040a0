"""Tables and a sentence of `docs/task-findings.md` beyond mean costs: the area of cost and return that an algorithm's
limits cover, and the worst tenth of its flights, both on the fixed river.

Areas are those of reports (`thalweg.bench.report.price_tables`).
"""

import math
from collections.abc import Mapping

import numpy as np
from task_outcomes import LIMITLESS, Outcome, Studies, Study, mean_text, spread

from thalweg.bench.fronts.fronts import FIXED
from thalweg.bench.report.price_tables import CoveredArea, covered_areas
from thalweg.bench.report.table import frame, markdown

NOTHING = "Nothing has been run yet.\n"
NOT_PLANNED = "not planned"


def area_section(studies: Studies) -> str:
    """Return the share of the oracle's area that each algorithm covers, in a row for each, a column for each task."""
    found = {
        (task, each.name): _area_text(study, each)
        for task, study in studies.items()
        if study.results is not None
        for each in covered_areas(study.results)
    }
    if not found:
        return NOTHING
    names = dict.fromkeys([*algorithms_of(studies), *(name for _, name in found)])
    rows = [
        [name, *(found.get((task, name)) or _no_area(study, name) for task, study in studies.items())]
        for name in names
        if any(key[1] == name for key in found)
    ]
    return markdown(frame(["algorithm", *studies], rows))


def _area_text(study: Study, area: CoveredArea) -> str:
    """Return an area with its interval, and of how many limits it is where some are missing."""
    lacking = f" ({area.limits} of {len(study.limits)} limits)" if area.limits < len(study.limits) else ""
    return f"{spread(area.share)}{lacking}"


def _no_area(study: Study, name: str) -> str:
    """Return why an algorithm covers no area of a task."""
    planned = [limit for limit in study.limits if (name, limit) in study.arms]
    return NOT_PLANNED if not planned else "one limit" if len(planned) == 1 else "missing"


def tail_section(studies: Studies) -> str:
    """Return the mean cost of the worst tenth of flights on the fixed river at the middle limits, a row for each
    algorithm, a column for each task."""
    found = {
        (task, name): _tail_text(outcome)
        for task, study in studies.items()
        for name in study.algorithms
        if (outcome := study.outcome(FIXED, name, study.middle_limit)) is not None
    }
    return middle_table(studies, found)


def middle_table(studies: Studies, cells: Mapping[tuple[str, str], str]) -> str:
    """Return a table of cells by task and algorithm that stand beside the middle limits, a row for each algorithm that
    has any; others say why they are empty."""
    rows = []
    for name in algorithms_of(studies):
        if any((task, name) in cells for task in studies):
            label = f"{name}, without a limit" if name in LIMITLESS else name
            rows.append([label, *(cells.get((task, name)) or _gap(study, name) for task, study in studies.items())])
    columns = ["algorithm", *(f"{task}, limit {study.middle_limit:g}" for task, study in studies.items())]
    return markdown(frame(columns, rows)) if rows else NOTHING


def _gap(study: Study, name: str) -> str:
    """Return why an algorithm has nothing beside the middle limit of a task."""
    return study.gap(name, study.middle_limit) if study.name_of(name, study.middle_limit) else NOT_PLANNED


def algorithms_of(studies: Studies) -> list[str]:
    """Return the algorithms of all studies, in the order of the suites."""
    return list(dict.fromkeys(name for study in studies.values() for name in study.algorithms))


def _tail_text(outcome: Outcome) -> str:
    """Return the worst tenth of an outcome with its interval, in whose middle it does not lie."""
    tail, text = outcome.tail, mean_text(outcome.tail.value)
    return text if math.isnan(tail.low) else f"{text} [{mean_text(tail.low)}, {mean_text(tail.high)}]"


def tail_fact(studies: Studies) -> str:
    """Return how much the worst tenth of flights costs where the middle limit is held."""
    holders = [each for study in studies.values() for each in study.limited(FIXED, study.middle_limit) if each.holds]
    if not holders:
        return "**The worst tenth.** Nobody holds a middle limit."
    times = [each.tail.value / each.limit for each in holders]
    least, most = holders[int(np.argmin(times))], holders[int(np.argmax(times))]
    return (
        f"**The worst tenth.** Where the middle limit is held in the mean ({len(holders)} times), the worst tenth of"
        f" flights costs {min(times):.1f} ({least.algorithm}, {least.task}) to {max(times):.1f} times the limit"
        f" ({most.algorithm}, {most.task}), with a median of {np.median(times):.1f}."
    )
