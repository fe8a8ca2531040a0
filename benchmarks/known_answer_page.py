"""The table of the benchmark on problems with a known optimum, and the section of each algorithm's page."""

import statistics
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from known_answer_rows import HERE, SEEDS, Table, key, result_of, row_versions
from page_sections import replace_section, wrap

from tests.known_answer.harness import (
    ACTION_SETUPS,
    EXCESS,
    LEAST_EXCESS,
    REQUIREMENTS,
    SHARE,
    Case,
    Result,
    reference,
)
from tests.known_answer.problems import PROBLEMS
from thalweg.bench.report.table import frame, markdown
from thalweg.train.observations import SEEN_BY_CRITICS

PAGES, SECTION = HERE.parent / "docs" / "algorithms", "known answers"
"""Pages of the algorithms, and their section."""


def page(rows: Table, seeds: int) -> str:
    """Return the Markdown page, with a table for each problem."""
    introduction = (
        f"Return of the final policy as a share of the optimum, and its cost, means over up to {seeds} seeds. In"
        f" brackets: the number of seeds that reached {SHARE:.0%} with a cost at most {EXCESS:.0%} or {LEAST_EXCESS}"
        " above the limit, out of those that were run. **Bold**: at least one missed this, or failed. `box_literal` is"
        " shown for comparison only. The optimum of PPO has no limit, that of DDPG and TD3 is the best deterministic"
        " policy, and that of planners a perfect planner with their horizon. Critics see"
        f" {SEEN_BY_CRITICS[False]}, also those of algorithms whose critics see more on the river."
    )
    sections = ["# Policies compared with the optimum of small problems", introduction]
    for name, problem in PROBLEMS.items():
        limits = " and ".join(f"{limit:g}" for limit in problem.limits)
        table = markdown(_problem_table(rows, name, seeds)).rstrip()
        sections.append(f"## {name}: limit {limits}\n\n{table}")
    return "\n\n".join(sections) + "\n"


def _problem_table(rows: Table, problem: str, seeds: int) -> pd.DataFrame:
    """Return the table of a problem, with a row for each algorithm that is run on it."""
    lines = []
    for algorithm, requirement in REQUIREMENTS.items():
        if problem not in requirement.problems:
            continue
        at = {setup: Case(algorithm, setup, problem) for setup in requirement.action_setups}
        best = reference(next(iter(at.values())))
        found = [_entry(rows, at[setup], seeds) if setup in at else "" for setup in ACTION_SETUPS]
        lines.append([algorithm, f"{best.reward:.2f}, {_costs([best.costs.tolist()])}", *found])
    return frame(["algorithm", "optimum: return, cost", *ACTION_SETUPS], lines)


def _entry(rows: Table, case: Case, seeds: int) -> str:
    """Return the entry of a case: share and cost of its runs, and the number of them that reached the optimum."""
    runs = list(_runs_of(rows, case, seeds).values())
    results = [result_of(case, run) for run in runs if not run["error"]]
    if not results:
        return "**failed**" if runs else "not run"
    reached = sum(result.reached for result in results)
    text = f"{_outcome(results)} ({reached}/{len(runs)})"
    return text if reached == len(runs) or case.action_setup == "box_literal" else f"**{text}**"


def _costs(costs: Sequence[Sequence[float]]) -> str:
    """Return the mean of each kind of cost as text."""
    return " + ".join(f"{statistics.mean(kind):.3f}" for kind in zip(*costs, strict=True))


def section(rows: Table, algorithm: str, seeds: int = SEEDS) -> str:
    """Return the section of an algorithm's page: a line for each problem, in the native action space."""
    requirement = REQUIREMENTS[algorithm]
    lines = []
    for problem in requirement.problems:
        case = Case(algorithm, requirement.action_setups[0], problem)
        runs = _runs_of(rows, case, seeds)
        if not runs:
            continue
        results = {seed: result_of(case, run) for seed, run in runs.items() if not run["error"]}
        best = reference(case)
        limits = " and ".join(f"{limit:g}" for limit in PROBLEMS[problem].limits)
        missed = [f"seed {seed}: {_outcome([result], 1)}" for seed, result in results.items() if not result.reached]
        missed += [f"seed {seed} failed" for seed in runs if seed not in results]
        lines.append(
            [
                f"`{problem}`",
                "none" if requirement.against == "free" else limits,
                f"{best.reward:.2f}, {_costs([best.costs.tolist()])}",
                _outcome(list(results.values()), 1) if results else "failed",
                f"{len(runs) - len(missed)} of {len(runs)}",
                "; ".join(missed),
            ]
        )
    if not lines:
        return "No run of today's defaults yet.\n"
    introduction = wrap(
        f"Each row has the mean over its seeds, in the native action space. A seed reaches what is required with at"
        f" least {SHARE:.0%} of the return of the [optimum](README.md#known-answers) and, if there is a limit, a cost"
        f" at most {EXCESS:.0%} or {LEAST_EXCESS} above it. Seeds that miss it have their own figures. Critics see"
        f" {SEEN_BY_CRITICS[False]}."
    )
    header = ["problem", "limit", "optimum: return, cost", "share, cost", "reached", "missed"]
    return f"{introduction}\n{markdown(frame(header, lines))}"


def _runs_of(rows: Table, case: Case, seeds: int) -> dict[int, dict[str, str]]:
    """Return the rows of a case by their seeds, as far as they were run with today's versions."""
    found = {seed: rows[key(case, seed)] for seed in range(seeds) if key(case, seed) in rows}
    current = row_versions(case.algorithm)
    return {seed: row for seed, row in found.items() if current.items() <= row.items()}


def _outcome(results: Sequence[Result], decimals: int = 0) -> str:
    """Return the mean share of the optimum's return, and the mean cost of each kind, as text."""
    share = statistics.mean(result.share for result in results)
    return f"{share:.{decimals}%}, {_costs([result.score.costs.tolist() for result in results])}"


def written_pages(rows: Table, seeds: int = SEEDS) -> dict[Path, str]:
    """Return the pages of algorithms as they must be."""
    paths = {algorithm: PAGES / f"{algorithm.lower()}.md" for algorithm in REQUIREMENTS}
    return {
        path: replace_section(path.read_text(encoding="utf-8"), SECTION, section(rows, algorithm, seeds))
        for algorithm, path in paths.items()
    }
