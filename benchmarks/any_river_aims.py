"""Aims that were set for the packaged policies, and the tables of what they and their twins of other seeds reach."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from page_sections import wrap

from thalweg.bench.evaluate.conditions import RIVERS
from thalweg.bench.report.table import frame, markdown

Cells = Callable[[str, str, str], Sequence[Mapping[str, str]]]
"""Rows of a policy's flights of a kind on a level or real river, one for each seed."""
LEVELS = ("Easy", "Medium", "Hard")
MASKED, BARE, TEACHER = "rgb+mask", "rgb", "teacher"
TEACHERS_SHARE = 0.97
"""Share of the teacher's return that is the aim on real rivers, where nobody returns 10."""
LEAD = 0.5
"""A policy of the image alone is to return at most so much less than that of image and mask."""


@dataclass(frozen=True)
class Aim:
    """What the policy of image and mask is to reach in flights of one kind on a level or real river."""

    kind: str
    level: str
    return_: float | None
    """Least mean return; None: `TEACHERS_SHARE` of the teacher's."""
    violations: float
    """Greatest share of flights that end in a violation."""

    def least_return(self, cells: Cells) -> float:
        """Return the least mean return; NaN if it is the teacher's, who has not flown."""
        return TEACHERS_SHARE * mean(cells(TEACHER, self.kind, self.level)) if self.return_ is None else self.return_


AIMS = (
    *(Aim("fixed", level, 9.8, 0.01) for level in LEVELS),
    *(Aim("unseen", level, *most) for level, most in zip(LEVELS, ((9.8, 0.01), (9.8, 0.01), (9.5, 0.03)), strict=True)),
    *(Aim("varied", level, *most) for level, most in zip(LEVELS, ((9.5, 0.03), (9.5, 0.03), (9.0, 0.06)), strict=True)),
    *(Aim("real", river, None, 0.03) for river in RIVERS),
)


def mean(rows: Sequence[Mapping[str, str]], column: str = "return") -> float:
    """Return the mean of a column; NaN without rows."""
    return float(np.mean([float(row[column]) for row in rows])) if rows else float("nan")


def packaged_aims(cells: Cells) -> str:
    """Return the table of the packaged policies, which are the students of seed 0: each aim, what is reached, and
    whether that meets it; and how many aims are met. Flights that both have not flown yet have no line."""
    lines = []
    for aim in AIMS:
        masked, bare = (_first(cells(policy, aim.kind, aim.level)) for policy in (MASKED, BARE))
        least = aim.least_return(cells)
        if np.isnan(least) or not (masked and bare):
            continue
        returned, bare_returned, violations = mean(masked), mean(bare), mean(masked, "violations")
        lines.append(
            [
                *(aim.kind, aim.level, f"{least:.2f}", _judged(f"{returned:.2f}", returned >= least)),
                *(f"{aim.violations:.0%}", _judged(f"{violations:.1%}", violations <= aim.violations)),
                *(f"{returned - LEAD:.2f}", _judged(f"{bare_returned:.2f}", bare_returned >= returned - LEAD)),
            ]
        )
    header = ["flights", "level or river", "return, at least", "`packaged`", "violations, at most", "of `packaged`"]
    table = markdown(frame([*header, "return of `packaged-rgb`, at least", "`packaged-rgb`"], lines))
    own = [text for line in lines for text in (line[3], line[5])]
    note = f"`packaged` meets {_met(own)} aims, and `packaged-rgb` {_met([line[7] for line in lines])}."
    return f"{table}\n{wrap(note)}"


def student_aims(cells: Cells) -> str:
    """Return the table of the students of image and mask: each aim, the mean over seeds, and how many of them meet it.
    Flights that they have not flown yet have no line."""
    lines = []
    for aim in AIMS:
        rows, least = cells(MASKED, aim.kind, aim.level), aim.least_return(cells)
        if np.isnan(least) or not rows:
            continue
        returns, violations = ([float(row[name]) for row in rows] for name in ("return", "violations"))
        high, safe = sum(each >= least for each in returns), sum(each <= aim.violations for each in violations)
        lines.append(
            [
                *(aim.kind, aim.level, f"{least:.2f}", f"{np.mean(returns):.2f}", f"{high} of {len(rows)}"),
                *(f"{aim.violations:.0%}", f"{np.mean(violations):.1%}", f"{safe} of {len(rows)}"),
            ]
        )
    header = ["flights", "level or river", "return, at least", "mean return", "return met by"]
    return markdown(frame([*header, "violations, at most", "mean violations", "violations met by"], lines))


def _first(rows: Sequence[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the row of seed 0, if there is one."""
    return [row for row in rows if row["seed"] == "0"]


def _judged(text: str, met: bool) -> str:
    """Return a figure with whether it meets its aim."""
    return f"{text}, {'met' if met else 'missed'}"


def _met(judged: Sequence[str]) -> str:
    """Return how many of some judged figures meet their aim, as text."""
    return f"{sum(text.endswith(', met') for text in judged)} of {len(judged)}"
