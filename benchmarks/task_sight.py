"""Sentences and the table of `docs/task-findings.md` on what policies see: frames beside the ideal eye, convolutions of
their own beside codes, and the imitated policy to begin with."""

import statistics
from collections.abc import Iterator

from page_sections import wrap
from task_facts import facts, line_of
from task_outcomes import Outcome, Studies

from thalweg.bench.fronts.fronts import FIXED
from thalweg.bench.report.table import frame, markdown

Pair = tuple[Outcome, Outcome]
"""What an algorithm comes to at a limit by the ideal eye, and through frames."""
WAYS = {"cnn": "Convolutions of its own", "imitated": "From the imitated policy"}
"""What distinguishes policies from others of their algorithm, by the ending of their names."""


def sight_facts(studies: Studies, seeing: Studies) -> str:
    """Return the findings on policies that see frames: those of `task_facts`, and beside the ideal eye."""
    if not any(study.limited(FIXED) for study in seeing.values()):
        return "Nothing has been run yet.\n"
    usual = facts(seeing)
    number = usual.count("**") // 2
    told = [*filter(None, (_eye(studies, seeing), *(_way(seeing, ending) for ending in WAYS)))]
    return usual + "".join(wrap(f"{index}. {text}") for index, text in enumerate(told, start=number + 1))


def sight_table(studies: Studies, seeing: Studies) -> str:
    """Return each algorithm that was flown both by the ideal eye and through frames, a row for each limit."""
    rows = [
        [
            *(ideal.task, f"{ideal.limit:g}", ideal.algorithm, line_of(ideal), line_of(seen)),
            f"{seen.return_.value - ideal.return_.value:.2f}",
        ]
        for ideal, seen in pairs(studies, seeing)
    ]
    columns = ["task", "limit", "algorithm", "ideal eye", "frames", "return, difference"]
    return markdown(frame(columns, rows)) if rows else "Nothing has been run yet.\n"


def pairs(studies: Studies, seeing: Studies) -> Iterator[Pair]:
    """Yield what was flown with a limit by the ideal eye and through frames, on the fixed river."""
    for task, study in seeing.items():
        for seen in study.limited(FIXED):
            ideal = studies[task].outcome(FIXED, seen.algorithm, seen.limit)
            if ideal is not None:
                yield ideal, seen


def _eye(studies: Studies, seeing: Studies) -> str:
    """Return a sentence on how many limits are held by each eye, and what frames cost in return."""
    both = [*pairs(studies, seeing)]
    if not both:
        return ""
    held = [sum(each.holds for each in own) for own in zip(*both, strict=True)]
    changes = [seen.return_.value - ideal.return_.value for ideal, seen in both]
    regrets = [seen.regret.value for _, seen in both if seen.holds]
    number = f"{len(both)} pair{'s' * (len(both) > 1)}"
    text = (
        f"**The eye.** Of {number} of an algorithm and a limit, {held[0]} hold the limit by the ideal eye and {held[1]}"
        f" through frames. Through frames the return differs by {statistics.median(changes):.2f} points (the median)."
    )
    if regrets:
        less = statistics.median(regrets)
        than = "less" if less >= 0 else "more"
        text += f" Who holds it there returns {abs(less):.2f} points (the median) {than} than the oracle."
    return text


def _way(seeing: Studies, ending: str) -> str:
    """Return a sentence on policies whose names have an ending, beside those of their algorithm without it."""
    told = []
    for study in seeing.values():
        for own in study.limited(FIXED):
            base, _, found = own.algorithm.rpartition("-")
            if found != ending:
                continue
            usual = study.outcome(FIXED, base, own.limit)
            beside = "nothing to compare with" if usual is None else line_of(usual)
            told.append(f"{own.algorithm} ({own.task} at {own.limit:g}) returns {line_of(own)}, on codes {beside}")
    return f"**{WAYS[ending]}.** {'; '.join(told)}." if told else ""
