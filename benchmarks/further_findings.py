"""Tables of `docs/findings.md` on the suites `protocols`, ways of training, and `geometry`, codes of geometry.

`write_figures.py` writes them there.
"""

from findings import GEOMETRY, PROTOCOLS, STUDY, results_of
from study_flights import difference, of_same_versions

from thalweg.bench.report.policies import evaluated_seeds, limit_met, train_level, trained_policies
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import mean_estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes

USUAL_WAY = "FOCOPS"
"""The arm of `protocols` that is trained as in `paper`."""
CONDITIONS = {"unseen rivers": "unseen", "every look": "all_at_once"}
"""Columns of the table of the codes of geometry, and the conditions' names in the results."""
MISSING, OTHER_VERSIONS = "missing", "other versions"
"""Cells without flights, and of results whose rivers and starts may be others."""


def ways_of_training() -> str:
    """Return the returns and costs of each way of training on each level, and how they differ from the usual way."""
    results = results_of(PROTOCOLS)
    return f"{_levels(results)}\n{_differences(results)}"


def codes_of_geometry() -> str:
    """Return the returns of each algorithm on the codes of geometry: on each level, on unseen rivers and under every
    look, beside that on the codes of the autoencoder on the training level."""
    results, coded = results_of(GEOMETRY), results_of(STUDY)
    level, flown = train_level(results), group_episodes(results.episodes)
    comparable, ours = of_same_versions(results, coded), group_episodes(coded.episodes)
    rows = []
    for name in trained_policies(results):
        if (name, level) not in flown:
            continue
        cells = [_return(flown, name, each) for each in results.levels]
        for condition in CONDITIONS.values():
            cells.append(_return(group_episodes(results.condition_episodes.get(condition, [])), name, level))
        cost = mean_estimate(flown[name, level], "cost")
        seeds = evaluated_seeds(results, name, flown[name, level])
        other = _return(ours, name, level) if comparable else OTHER_VERSIONS
        rows.append([name, seeds, *cells, f"{cost}, {limit_met(cost)}", other])
    columns = ["policy, its return", "seeds", *results.levels, *CONDITIONS, f"cost on {level}, limit met"]
    return markdown(frame([*columns, f"autoencoder, {level}"], rows))


def _levels(results: Results) -> str:
    """Return the table of returns and costs of all policies on all levels."""
    flown, rows = group_episodes(results.episodes), []
    for name in trained_policies(results):
        known = [level for level in results.levels if (name, level) in flown]
        if not known:
            continue
        cells = []
        for level in results.levels:
            episodes = flown.get((name, level))
            cells += [str(mean_estimate(episodes, "return_")), str(mean_estimate(episodes, "cost"))] if episodes else [
                MISSING, MISSING,
            ]  # fmt: skip
        rows.append([name, evaluated_seeds(results, name, flown[name, known[0]]), *cells])
    columns = [f"{what}, {level}" for level in results.levels for what in ("return", "cost")]
    return markdown(frame(["policy", "seeds", *columns], rows))


def _differences(results: Results) -> str:
    """Return how much more each way of training returns than the usual one, start by start."""
    flown, rows = group_episodes(results.episodes), []
    for name in trained_policies(results):
        pairs = [(flown.get((name, level)), flown.get((USUAL_WAY, level))) for level in results.levels]
        if name != USUAL_WAY and any(all(pair) for pair in pairs):
            rows.append([name, *(str(difference(own, usual)) if own and usual else MISSING for own, usual in pairs)])
    columns = (f"return on {level}, difference" for level in results.levels)
    return markdown(frame([f"policy, against {USUAL_WAY}", *columns], rows)) if rows else ""


def _return(flown: dict, name: str, level: str) -> str:
    """Return the mean return of a policy on a level."""
    rows = flown.get((name, level))
    return str(mean_estimate(rows, "return_")) if rows else MISSING
