"""The tables and the picture of `docs/task-findings.md`: who holds a limit that has a price, and at what price.

    python benchmarks/task_findings.py            # writes the tables and draws the picture
    python benchmarks/task_findings.py --check    # writes nothing; fails where the page is not up to date

The results are those of the suites `swimmers`, `nests`, `racingline` and `portage`, by the ideal eye, and of those with
`-frames` after these names, in folders of their names, as far as they are there: what has not been run is named as
missing. Figures are of the training level, on its fixed river and on
unseen ones, with the oracle's front of the same rivers beside them.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from findings import results_of
from page_sections import replace_section, wrap
from study_flights import earlier_versions
from task_facts import facts
from task_findings_picture import drawn_fronts
from task_outcomes import LIMITLESS, Outcome, Studies, Study, held, mean_text, oracle_text, spread, study_of
from task_risk import area_section, tail_section
from task_sight import sight_facts, sight_table
from task_training import drawn_training, training_section

from thalweg.bench.fronts.fronts import FIXED, UNSEEN
from thalweg.bench.report.policies import limit_met
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.priced import LIMITS, seeing_suite_of, suite_of
from thalweg.core.atomic_io import write_atomic
from thalweg.env.tasks import TaskName

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "task-findings.md"
PICTURE = HERE.parent / "docs" / "images" / "task-findings.png"
FRAMES_PICTURE = PICTURE.with_name("task-findings-frames.png")
TRAINING_PICTURE = PICTURE.with_name("task-training.png")
RIVERS = {FIXED: "the fixed river", UNSEEN: "unseen rivers"}
NOT_RUN = "No run of this suite is finished yet.\n"


def read_studies(folder: Path = HERE, suite_of: Callable[[TaskName], Suite] = suite_of) -> dict[str, Study]:
    """Return what was run of each task, from folders with the names of the suites; raises `ResultsError` for results
    that cannot be used."""
    found = {}
    for task in LIMITS:
        suite = suite_of(task)
        path = folder / suite.name
        found[task] = study_of(suite, results_of(path) if path.is_dir() else None)
    return found


def outcome_text(outcome: Outcome) -> str:
    """Return an outcome as a cell: bold if the cost's whole interval is within the limit, in italics if its mean is."""
    text = f"{spread(outcome.return_)} at {spread(outcome.cost)}; {outcome.above.value:.0%}; {outcome.regret.value:.2f}"
    if " of " in outcome.seeds:
        text += f"; {outcome.seeds} seeds"
    if outcome.algorithm in LIMITLESS or not outcome.holds:
        return text
    return f"**{text}**" if limit_met(outcome.cost, outcome.limit) == "yes" else f"*{text}*"


def task_table(study: Study, rivers: str) -> str:
    """Return the table of a task on one kind of rivers: a row for each algorithm, a column for each limit."""
    rows = [["oracle", *(oracle_text(study, rivers, limit) for limit in study.limits)]]
    for algorithm in study.algorithms:
        name = f"{algorithm}, without a limit" if algorithm in LIMITLESS else algorithm
        rows.append([name, *(_cell(study, rivers, algorithm, limit) for limit in study.limits)])
    return markdown(frame(["algorithm", *(f"limit {limit:g}" for limit in study.limits)], rows))


def _cell(study: Study, rivers: str, algorithm: str, limit: float) -> str:
    """Return the cell of an algorithm at a limit, which names what is missing."""
    outcome = study.outcome(rivers, algorithm, limit)
    return study.gap(algorithm, limit) if outcome is None else outcome_text(outcome)


def task_section(study: Study) -> str:
    """Return the tables of a task on both kinds of rivers."""
    if not study.outcomes:
        return NOT_RUN
    tables = (f"On {words}:\n\n{task_table(study, rivers)}" for rivers, words in RIVERS.items())
    return "\n".join(tables)


def holders_table(studies: Studies) -> str:
    """Return who holds each limit on the fixed river, by falling return, in a row for each task and limit."""
    rows = []
    for task, study in studies.items():
        for limit in study.limits if study.outcomes else ():
            holders = sorted(held(study, FIXED, limit), key=lambda each: -each.return_.value)
            others = [each for each in study.limited(FIXED, limit) if not each.holds]
            costs = ", ".join(f"{each.algorithm} ({mean_text(each.cost.value)})" for each in others)
            names = ", ".join(map(_holder, holders))
            rows.append([task, f"{limit:g}", oracle_text(study, FIXED, limit), names or "nobody", costs or "nobody"])
    columns = ["task", "limit", "oracle's return", "holds it (return)", "does not hold it (cost)"]
    return markdown(frame(columns, rows)) if rows else "Nothing has been run yet.\n"


def _holder(outcome: Outcome) -> str:
    text = f"{outcome.algorithm} ({mean_text(outcome.return_.value)})"
    return f"**{text}**" if limit_met(outcome.cost, outcome.limit) == "yes" else text


def missing_section(studies: Studies) -> str:
    """Return which policies lack seeds, by task."""
    lines = [f"- {task}: {', '.join(_lacking(study)) or 'nothing'}" for task, study in studies.items()]
    return "".join(map(_indented, lines))


def _indented(line: str) -> str:
    return wrap(line).replace("\n", "\n  ").rstrip(" ")


def _lacking(study: Study) -> Iterable[str]:
    """Return the algorithms of which seeds are missing, with how many there are."""
    if not study.outcomes:
        return ["everything"]
    found = ((name, study.seeds_done(name), study.seeds_planned(name)) for name in study.algorithms)
    return [f"{name} ({done} of {planned} runs)" for name, done, planned in found if done < planned]


def versions_note(studies: Studies) -> str:
    """Return which results are of earlier versions than today's."""
    tasks: dict[str, list[str]] = {}
    for task, study in studies.items():
        if study.results is not None and (earlier := earlier_versions(study.results)):
            tasks.setdefault(", ".join(earlier), []).append(task)
    if not tasks:
        return "All results are of today's versions.\n"
    told = "; ".join(f"{', '.join(names)} ({earlier})" for earlier, names in tasks.items())
    return wrap(f"These results are of **earlier versions**: {told}.")


def frames_section(studies: Studies) -> str:
    """Return the tables of the tasks through frames, as far as anything was run."""
    tables = (f"### {task}\n\n{task_section(study)}" for task, study in studies.items() if study.outcomes)
    return "\n".join(tables) or "Nothing has been run yet.\n"


def frames_picture(studies: Studies) -> str:
    """Return the reference to the picture of policies that see frames, or that there is none."""
    if not any(study.outcomes for study in studies.values()):
        return "Nothing has been run yet.\n"
    words = "Mean return over mean cost through frames: the oracle's front, and each algorithm at its limits"
    return f"![{words}](images/{FRAMES_PICTURE.name})\n"


def written_page(page: str, studies: Studies, seeing: Studies) -> str:
    """Return the page with what the results have today, by the ideal eye and `seeing` frames."""
    sections: Sequence[tuple[str, str]] = [
        ("versions", versions_note(studies)),
        ("facts", facts(studies)),
        ("holders", holders_table(studies)),
        ("area", area_section(studies)),
        ("tail", tail_section(studies)),
        ("training", training_section(studies)),
        *((task, task_section(study)) for task, study in studies.items()),
        ("frames facts", sight_facts(studies, seeing)),
        ("frames holders", holders_table(seeing)),
        ("frames area", area_section(seeing)),
        ("frames tail", tail_section(seeing)),
        ("frames training", training_section(seeing)),
        ("eyes", sight_table(studies, seeing)),
        ("frames picture", frames_picture(seeing)),
        ("frames", frames_section(seeing)),
        ("missing", missing_section(studies)),
        ("missing frames", missing_section(seeing)),
    ]
    for name, text in sections:
        page = replace_section(page, name, text)
    return page


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; fail where the page is not up to date")
    parser.add_argument("--results", type=Path, default=HERE, help="folder with the results of the suites")
    given = parser.parse_args()
    studies, old = read_studies(given.results), PAGE.read_text(encoding="utf-8")
    seeing = read_studies(given.results, seeing_suite_of)
    new = written_page(old, studies, seeing)
    if given.check:
        return int(new != old)
    write_atomic(PAGE, new)
    write_atomic(PICTURE, drawn_fronts(studies))
    write_atomic(TRAINING_PICTURE, drawn_training(studies))
    if any(study.outcomes for study in seeing.values()):
        write_atomic(FRAMES_PICTURE, drawn_fronts(seeing))
    return 0


if __name__ == "__main__":
    sys.exit(main())
