"""Policies of results of the paper's task as rows of the leaderboard."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.leaderboard.policy_entry import PolicyEntry, arm_fields, flown_fields, flown_policies
from thalweg.bench.leaderboard.requirements import LEVEL, UNSEEN, Flights, counted
from thalweg.bench.report.policies import limit_met, training_regret
from thalweg.bench.results.inference import Estimate, mean_estimate
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.suite.record import arms_of, task_of
from thalweg.env.tasks import PAPER_TASK
from thalweg.world import LEVELS


@dataclass(frozen=True, kw_only=True)
class Entry(PolicyEntry):
    """A policy and its figures on the paper's task."""

    level: str
    """Training level."""
    cost: Estimate | None
    """Mean on `LEVEL`; None where the policy was not evaluated there."""
    returns: dict[str, Estimate]
    """Mean on each level, and on unseen rivers of `LEVEL`; an interquartile mean would hide up to a quarter of
    failures."""
    regret: float | None
    """Mean over seeds, in the last stage of training; None where it is not known."""

    @property
    def limit_met(self) -> str:
        """Whether the cost limit is met, in words."""
        return "unknown" if self.cost is None else limit_met(self.cost)

    @property
    def sort_key(self) -> tuple[int, float]:
        """Policies that surely meet the limit come first; then the greater return does."""
        group = {"yes": 0, "no": 2, "unknown": 3}.get(self.limit_met, 1)
        return group, -self.returns[LEVEL].value if LEVEL in self.returns else 0.0


def read_folder(folder: Path) -> Results:
    """Return the results of a folder; raises `ResultsError` for one without, and for one without a readable suite."""
    results = read_results(folder)
    if not results.suite:
        raise ResultsError(
            f"{folder}: {next((line for line in results.skipped if 'suite.json' in line), 'no suite.json')}"
        )
    return results


def entries(folder: Path) -> list[Entry]:
    """Return the policies of a results folder of the paper's task, as far as any run of them has started: trained
    ones, the packaged one, functions, and others of files. The list is empty for a folder of another task.

    Raises `ResultsError` for a folder that holds no results, or no readable suite.
    """
    results = read_folder(folder)
    return entries_of(results) if task_of(results.suite) == PAPER_TASK else []


def entries_of(results: Results) -> list[Entry]:
    """Return the policies of results of the paper's task, see `entries`."""
    found = []
    for arm in arms_of(results.suite):
        for name, usual, other in flown_names(results, arm["name"]):
            if usual or any(row.algorithm == name for row in results.runs):
                found.append(_entry(results, name, arm, usual, other))
    for policy in flown_policies(results):
        for name, usual, other in flown_names(results, policy["name"]):
            if usual:
                found.append(_flown_entry(results, name, policy, usual, other))
    return found


def flown_names(results: Results, policy: str) -> Iterator[tuple[str, Flights, Flights]]:
    """Yield the names under which a policy stands in results, its own and those with other versions, each with its
    flights on the levels and on unseen rivers of them."""
    evaluated, unseen = (counted(rows) for rows in (results.episodes, results.condition_episodes.get(UNSEEN.name, [])))
    outdated = [name for name, found in results.outdated.items() if found.policy == policy]
    for name in (policy, *outdated):
        usual, other = (
            {level: rows for level in LEVELS if (rows := each.get((name, level)))} for each in (evaluated, unseen)
        )
        yield name, usual, other


def _returns(usual: Flights, unseen: Flights) -> dict[str, Estimate]:
    """Return the mean return on each level, and on unseen rivers of `LEVEL`."""
    returns = {level: mean_estimate(rows, "return_") for level, rows in usual.items()}
    return returns | ({UNSEEN.name: mean_estimate(unseen[LEVEL], "return_")} if LEVEL in unseen else {})


def _flown_entry(results: Results, name: str, policy: dict[str, Any], usual: Flights, unseen: Flights) -> Entry:
    """Return the entry of a policy that was not trained here, see `flown_fields`."""
    return Entry(
        **flown_fields(results, name, policy, usual, unseen),
        level="not here",
        cost=mean_estimate(usual[LEVEL], "cost") if LEVEL in usual else None,
        returns=_returns(usual, unseen),
        regret=None,
    )


def _entry(results: Results, name: str, arm: dict[str, Any], usual: Flights, unseen: Flights) -> Entry:
    """Return the entry of an arm, see `arm_fields`."""
    return Entry(
        **arm_fields(results, name, arm, usual, unseen),
        level=arm.get("level") or results.suite.get("train_level", "unknown"),
        cost=mean_estimate(usual[LEVEL], "cost") if LEVEL in usual else None,
        returns=_returns(usual, unseen),
        regret=training_regret(results, name),
    )
