"""Readers of results for findings: flights of policies, their returns, differences and shares, and versions."""

from collections.abc import Sequence

import numpy as np

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.policies import train_level
from thalweg.bench.results.comparison import difference_between_starts, matched_scores, mean_difference
from thalweg.bench.results.inference import Estimate, Proportion, mean_estimate, score_matrix, wilson_interval
from thalweg.bench.results.reading import versions_today
from thalweg.bench.results.results import Results
from thalweg.bench.results.run_versions import Versions, added_versions, changed_versions
from thalweg.bench.results.statistics import group_episodes
from thalweg.bench.suite.builtin import STUDIED, SYMMETRIC
from thalweg.bench.suite.record import arms_of
from thalweg.train.observations import SEEN_BY_CRITICS

FLIES, PLANNER_FLIES = 8.0, 6.0
"""Mean return on the training level from which an algorithm counts as flying, and a planner."""
PLANNERS = ("SafeLOOP", "CCEPETS")
WITHOUT_LIMIT = "PPO"
"""The algorithm of the study without a limit."""

Episodes = Sequence[Episode]


def flown(results: Results, policy: str, condition: str = "") -> Episodes:
    """Return a policy's flights on the training level; none where it did not fly."""
    rows = results.condition_episodes.get(condition, []) if condition else results.episodes
    return group_episodes(rows).get((policy, train_level(results)), [])


def algorithms(results: Results) -> list[str]:
    """Return the algorithms that were flown with their default settings, those of the paper first."""
    return [name for name in dict.fromkeys((*STUDIED, *ALGORITHMS)) if flown(results, name)]


def reference(results: Results) -> str:
    """Return the policy without a limit that those with one are compared with: PPO whose critics see what theirs do.

    Where PPO's critics see more by default, it is that of the suite's arm in which they do not.
    """
    return WITHOUT_LIMIT if results.critics_see(WITHOUT_LIMIT) == SEEN_BY_CRITICS[False] else SYMMETRIC


def critics_in_words(results: Results, policies: Sequence[str]) -> str:
    """Return a sentence on what the critics of some policies saw in training."""
    saw: dict[str, list[str]] = {}
    for name in policies:
        saw.setdefault(results.critics_see(name), []).append(name)
    (usual, _), *others = sorted(saw.items(), key=lambda each: -len(each[1]))
    if not others:
        return f"In training, critics saw {usual}."
    told = [f"those of {listed(names)} saw {seen}" for seen, names in others]
    return f"In training, critics saw {usual}, but {listed(told)}."


def listed(parts: Sequence[str]) -> str:
    """Return parts as an enumeration."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def is_whole(results: Results, policy: str) -> bool:
    """Return whether every seed of a policy was flown, and there are enough of them for an interval."""
    rows = flown(results, policy)
    return bool(rows) and len({row.seed for row in rows}) >= max(3, results.planned_seeds(policy))


def least_return(algorithm: str) -> float:
    """Return the mean return from which an algorithm counts as flying."""
    return PLANNER_FLIES if algorithm in PLANNERS else FLIES


def returned(results: Results, policy: str, condition: str = "") -> Estimate | None:
    """Return a policy's mean return; None where it did not fly."""
    rows = flown(results, policy, condition)
    return mean_estimate(rows, "return_") if rows else None


def difference(first: Episodes, second: Episodes, of: str = "return_") -> Estimate:
    """Return how much greater a field is in the first flights than in the second, from the same starts."""
    return mean_difference(*matched_scores(first, second, of), of)


def share(count: int, number: int) -> Proportion:
    """Return a share with Wilson's interval."""
    return Proportion(count / number, *wilson_interval(count / number, number))


def by_seed_change(after: Episodes, before: Episodes) -> Estimate:
    """Return the change of the mean return of seeds between other starts, with an interval over them and over the
    starts of both; without one where a seed did not fly every start."""
    seeds = {row.seed for row in after} & {row.seed for row in before}
    both = [[row for row in rows if row.seed in seeds] for rows in (after, before)]
    try:
        return difference_between_starts(score_matrix(both[0]), score_matrix(both[1]), "return_")
    except ValueError:
        later, earlier = (float(np.mean([row.return_ for row in rows])) for rows in both)
        return Estimate(later - earlier)


def of_same_versions(one: Results, other: Results) -> bool:
    """Return whether the trained runs of two results were made with the same versions, as far as both depend on them:
    codes of an encoder depend on its version alone, so that two encoders may be compared."""
    first, second = (_versions_of_runs(each) for each in (one, other))
    return bool(first) == bool(second) and all(first[name] == second[name] for name in first.keys() & second.keys())


def _versions_of_runs(results: Results) -> dict[str, set[int | None]]:
    """Return the versions with which the trained runs of results were made, by what they are of."""
    found: dict[str, set[int | None]] = {}
    for run in (run for arm in arms_of(results.suite) for run in results.runs_of(arm["name"])):
        for name, version in results.versions.get(run, {}).items():
            found.setdefault(name, set()).add(version)
    return found


def earlier_versions(results: Results) -> list[str]:
    """Return the versions of the trained policies of results that differ from those of today, with these in brackets,
    and of policies without any such those that they were made before; none if none does."""
    found: dict[str, None] = {}
    for arm in arms_of(results.suite):
        for seed in arm["seeds"]:
            recorded = results.versions.get(f"{arm['name']}-{seed}", {})
            found |= dict.fromkeys(beside_todays(recorded, versions_today(results.suite, arm["name"], recorded)))
    return list(found)


def beside_todays(recorded: Versions, today: Versions) -> list[str]:
    """Return the versions `recorded` that differ from those of today, with these in brackets; if none does, the
    versions of today that are missing there; none without a record."""
    changed = changed_versions(recorded, today)
    if changed or not recorded:
        return [f"{name} {version} (today {today.get(name)})" for name, version in changed.items()]
    return [f"before {name} {version}" for name, version in added_versions(recorded, today).items()]
