"""Flights of a policy on many rivers: several rivers together, the figures of their episodes, and tables that grow."""

import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
from scipy import stats
from tables import append

from thalweg.bench.evaluate.baselines import Policy, RecurrentPolicy
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import Label, evaluate, observation_function
from thalweg.bench.results.inference import CONFIDENCE, Estimate, clip, t_interval, widen, wilson_interval
from thalweg.core.parent_process import end_with_parent
from thalweg.encoder import Encoder
from thalweg.env.task.reward_cost import FULL_COURSE_REWARD

TOGETHER = 16
"""Rivers with one start each that are flown together; each takes some 50 MB."""
RESULTS = ("return", "return_error", "violations", "cost", "reasons")
"""Columns of `figures_of`. `return_error` is the standard error of the mean return."""


def fly(
    policy: Policy | RecurrentPolicy,
    courses: Iterable[Course],
    label: Label,
    config: EvaluationConfig,
    encoder: Encoder | None = None,
) -> list[Episode]:
    """Return the episodes of a policy on courses, in their order; only policies of codes need the `encoder`."""
    found = []
    for course in joined(courses):
        found += evaluate(policy, course, label, config, observe=observation_function(policy, course, encoder))
    return found


def joined(courses: Iterable[Course]) -> Iterator[Course]:
    """Yield up to `TOGETHER` consecutive courses with one start each as one, and the others as they are."""
    waiting: list[Course] = []
    for course in courses:
        single = len(course.starts) == 1
        if waiting and (not single or len(waiting) == TOGETHER):
            yield Course.joined(waiting)
            waiting = []
        if single:
            waiting.append(course)
        else:
            yield course
    if waiting:
        yield Course.joined(waiting)


def figures_of(episodes: Sequence[Episode]) -> dict[str, str]:
    """Return `RESULTS` of episodes. Violations are episodes that end in a tight or loose cost."""
    returns = np.array([episode.return_ for episode in episodes])
    reasons = [episode.reason for episode in episodes]
    counts = {reason: reasons.count(reason) for reason in sorted(set(reasons))}
    return {
        "return": f"{returns.mean():.3f}",
        "return_error": f"{returns.std(ddof=1) / np.sqrt(len(returns)):.3f}",
        "violations": f"{np.mean([episode.cost > 0 for episode in episodes]):.4f}",
        "cost": f"{np.mean([episode.cost for episode in episodes]):.4f}",
        "reasons": " ".join(f"{reason}={count}" for reason, count in counts.items()),
    }


def mean_return(rows: Sequence[Mapping[str, str]]) -> Estimate:
    """Return the mean return over seeds, with an interval where there are enough of them.

    It is at least as wide as that of as many independent flights: equal means of seeds are no evidence of certainty.
    """
    per_seed = np.array([float(row["return"]) for row in rows])
    found = widen(t_interval(float(per_seed.mean()), per_seed), _of_independent_flights(rows))
    return clip(found, 0.0, FULL_COURSE_REWARD)


def _of_independent_flights(rows: Sequence[Mapping[str, str]]) -> Estimate:
    """Return the mean return with the interval that it has if all flights are independent: Student's t, or Wilson's
    where all returned the same."""
    mean, error, count = (
        np.array([float(row[name]) for row in rows]) for name in ("return", "return_error", "episodes")
    )
    flights, overall = count.sum(), np.average(mean, weights=count)
    squares = (count * (count - 1) * error**2 + count * (mean - overall) ** 2).sum()
    if squares > 0.0:
        reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, flights - 1) * np.sqrt(squares / (flights - 1) / flights))
        return Estimate(overall, overall - reach, overall + reach)
    ends = wilson_interval(overall / FULL_COURSE_REWARD, int(flights))
    return Estimate(overall, *(FULL_COURSE_REWARD * end for end in ends))


def fly_cells(
    cells: Mapping[str, Callable[[], Mapping[str, str]]], jobs: int, table: Path, columns: Sequence[str]
) -> list[str]:
    """Fly cells, `jobs` at a time, and append the row of each to the table as it ends.

    `cells`: by their names, functions that return a row. Returns a line for each cell that failed.
    """
    failures = []
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        flown = {pool.submit(cell): name for name, cell in cells.items()}
        for ended in as_completed(flown):
            if (error := ended.exception()) is not None:
                failures.append(f"{flown[ended]} failed: {type(error).__name__}: {error}")
                continue
            row = ended.result()
            append(table, columns, row)
            print(*(f"{name} {row[name]}" for name in columns), flush=True)
    return failures
