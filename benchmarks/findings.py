"""The tables of `docs/findings.md`, computed from the committed results; `write_figures.py` writes them there."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from page_sections import wrap
from study_flights import beside_todays, critics_in_words, earlier_versions, reference

from thalweg.bench.csv_files import ResultsError, read_csv
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.report.comparison_tables import limit_table, pairwise_table
from thalweg.bench.report.policies import (
    COST_LIMIT,
    CRITICS_SEE,
    evaluated_seeds,
    limit_met,
    seeds_text,
    train_level,
    trained_policies,
    training_regret,
)
from thalweg.bench.report.result_tables import paper_table
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import FIELD_RANGES, Estimate, clip, mean_estimate, proportion, t_interval
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import TrainingLog, group_episodes, regret
from thalweg.bench.studies.encoder_study import current_versions
from thalweg.bench.studies.encoder_tables import CASE, READ, SIZE_COLUMNS, table
from thalweg.bench.suite.record import arms_of, training_in_words
from thalweg.core.versions import PACKAGED_POLICY

HERE = Path(__file__).resolve().parent
STUDY, OPEN, ENCODERS = HERE / "paper", HERE / "open", HERE / "encoders"
PROTOCOLS, GEOMETRY = HERE / "protocols", HERE / "geometry"
WHAT = {
    "paper": "the paper's algorithms",
    "open": "the choices that the paper left open",
    "protocols": "ways of training",
    "geometry": "the same algorithms on the codes of geometry",
}
"""What was trained, by folder."""
NOT_EVALUATED, BLIND = "not flown yet", "no camera"
CONDITIONS = {"sampled": "", "deterministic": "deterministic", "unseen rivers": "unseen", "every look": "all_at_once"}
"""Columns of the table of conditions, and the conditions' names in the results."""
REAL = "real"
"""Condition on real rivers."""
ENCODER_COLUMNS = (*CASE, "train_mse", "held_out_mse", "iou_mask", "iou_colours", "iou_ceiling")
GEOMETRY_READ = (
    "encoder", "views", "left_bank", "right_bank", "heading_error", "height", "left_at_4_m", "left_at_11_m",
    "half_width_at_11_m", "bridge", "island",
)  # fmt: skip
"""Columns of geometry.csv that the page shows."""
GEOMETRY_OF_TASKS = (
    "encoder", "views", "left_bank", "right_bank", "heading_error", "height", "swimmer_in_view_distance",
    "swimmer_in_view_left", "in_a_reserve", "reserve_begins", "clearance", "station_in_view_distance", "over_land",
)  # fmt: skip
"""Columns of geometry_tasks.csv that the page shows."""
PAIR = ("first", "second", "paper")
"""Columns of entropy.csv that do not depend on the smoothing."""


def results_of_the_page() -> str:
    """Return what was trained and flown for the page, with which versions, and what critics saw."""
    every = {each.name: results_of(each) for each in (STUDY, OPEN, PROTOCOLS, GEOMETRY) if (each / "runs.csv").exists()}
    items = [
        f"- [`benchmarks/{name}`](../benchmarks/{name}): {WHAT[name]}, trained for {training_in_words(each.suite)}."
        f" Each policy is flown from the same {each.suite['episodes']} starts of each level with sampled actions."
        for name, each in every.items()
    ]
    older = {name: earlier_versions(each) for name, each in every.items()} | {"encoders": _versions_of_encoders()}
    sentences = [
        f"`{name}` is of **earlier versions**: {', '.join(found)}." if found else f"`{name}` is of today's versions."
        for name, found in older.items()
    ]
    critics = {critics_in_words(each, trained_policies(each)): name for name, each in every.items()}
    told = [words if len(critics) == 1 else f"`{name}`: {words}" for words, name in critics.items()]
    lines = [wrap(item, "  ").rstrip() for item in items]
    return "\n".join([*lines, "", wrap(" ".join(sentences)), wrap(" ".join([*_packaged(every[STUDY.name]), *told]))])


def _versions_of_encoders() -> list[str]:
    """Return the versions of the encoder study that differ from those of today, see `beside_todays`."""
    recorded, today = json.loads((ENCODERS / "study.json").read_text(encoding="utf-8"))["versions"], current_versions()
    return beside_todays(recorded, today)


def _packaged(results: Results) -> Iterator[str]:
    """Yield a sentence on which version of the packaged policy was flown, if any was."""
    if (flown := results.versions.get(f"{PACKAGED}-0", {}).get(PACKAGED)) is not None:
        yield (
            f"`packaged` is version {flown} of [the policy that comes with Thalweg](packaged-policy.md), and today's is"
            f" version {PACKAGED_POLICY} ([what they are](bench.md#how-policies-are-evaluated))."
        )


def returns_and_costs() -> str:
    """Return the paper's table: every policy on every level, published figures below ours."""
    return markdown(paper_table(results_of(STUDY)).text)


def limits() -> str:
    """Return whether each policy meets the cost limit."""
    text = limit_table(results_of(STUDY)).text
    return markdown(text.drop(columns=["minutes", "steps a second"]))


def pairs_without_limit() -> str:
    """Return the comparison of the policy without a limit with each other one, start by start."""
    results = results_of(STUDY)
    base, text = reference(results), pairwise_table(results).text
    own = text.loc[(text["policy"] == base) | (text["against"] == base)]
    pairs = zip(own["policy"], own["against"], strict=True)
    seen = [" / ".join({results.critics_see(name): None for name in pair}) for pair in pairs]
    return markdown(own.assign(**{CRITICS_SEE: seen}))


def pairs_of_open_choices() -> str:
    """Return the comparison of each algorithm's default with its variants, start by start."""
    results = results_of(OPEN)
    algorithms = {arm["name"]: arm["algorithm"] for arm in arms_of(results.suite)}
    text = pairwise_table(results).text
    return markdown(text.loc[text["policy"] == text["against"].map(algorithms.get)])


def training_costs() -> str:
    """Return the cost of training in each quarter of the steps."""
    results = results_of(STUDY)
    rows = []
    for name in trained_policies(results):
        logs = [log for log in results.training if log.algorithm == name]
        if logs:
            costs = [seed_mean(each) for each in zip(*map(cost_by_quarter, logs), strict=True)]
            at_bound = [share_at_bound(results.folder / "runs" / f"{name}-{log.seed}") for log in logs]
            seeds = seeds_text(results, name, len(logs))
            rows.append([name, seeds, *map(str, costs), _percent(map(early_regret, logs)), _percent(at_bound)])
    quarters = (f"cost, {ordinal} quarter" for ordinal in ("first", "second", "third", "last"))
    columns = ["policy", "seeds", *quarters, "share of regret in the first quarter", "multiplier at its bound"]
    return markdown(frame(columns, rows))


def seed_mean(costs: Sequence[float], most: float = FIELD_RANGES["cost"][1]) -> Estimate:
    """Return the mean cost of seeds with its interval, within 0 and `most`; seeds without one (NaN) are left out."""
    known = np.array([cost for cost in costs if not np.isnan(cost)])
    return clip(t_interval(float(known.mean()), known), 0.0, most) if len(known) else Estimate(np.nan)


def _percent(shares: Iterable[float]) -> str:
    """Return the mean of the seeds' shares in percent; seeds without one (NaN) are left out."""
    known = [share for share in shares if not np.isnan(share)]
    return f"{np.mean(known):.0%}" if known else "none"


def share_at_bound(run: Path) -> float:
    """Return the share of a training run's updates with the multiplier at its upper bound; NaN without a multiplier."""
    config = yaml.safe_load((run / "config.yaml").read_text(encoding="utf-8"))["run"]["config"]
    if "multiplier_max" not in config:
        return np.nan
    values = [float(row["multiplier"]) for row in read_csv(run / "metrics.csv", ("multiplier",))]
    return float(np.mean(np.array(values) >= config["multiplier_max"]))


def cost_by_quarter(log: TrainingLog) -> list[float]:
    """Return the mean cost of the episodes that ended in each quarter of the steps; NaN where none did.

    A block of episodes counts as often as it has episodes, in the quarter in which its last one ended.
    """
    costs, quarter = log.cost, _quarter(log)
    weights = log.episodes_of_rows
    return [
        float(np.average(costs[own], weights=weights[own])) if (own := quarter == number).any() else np.nan
        for number in range(4)
    ]


def early_regret(log: TrainingLog) -> float:
    """Return the share of the regret that comes from the first quarter of the steps; NaN without regret."""
    first, counts = _quarter(log) == 0, log.episodes_of_rows
    total = regret(log, COST_LIMIT) * float(counts.sum())
    if not total or not first.any():
        return 0.0 if total else np.nan
    return regret(_rows(log, first), COST_LIMIT) * float(counts[first].sum()) / total


def _rows(log: TrainingLog, kept: np.ndarray) -> TrainingLog:
    """Return a log with the rows for which `kept` [K] is true, episodes or blocks of them."""
    arrays = ("step", "return_", "tight", "loose", "total", "episodes", "violations")
    return replace(log, **{name: None if (own := getattr(log, name)) is None else own[kept] for name in arrays})


def _quarter(log: TrainingLog) -> np.ndarray:
    """Return the quarter of the steps in which each episode ended, 0 to 3."""
    return 4 * (log.step - 1) // log.last_step


def conditions() -> str:
    """Return the mean return of each policy under some conditions, on the training level and on real rivers."""
    results = results_of(STUDY)
    level = train_level(results)
    every = {"": results.episodes, **results.condition_episodes}
    real = group_episodes(results.condition_episodes.get(REAL, []))
    rivers = list(dict.fromkeys(river for _, river in real))
    seen = {condition["name"] for condition in results.suite.get("conditions", []) if not condition["blind"]}
    rows = []
    for policy in results.policies:
        if (policy, level) not in group_episodes(results.episodes):
            continue
        blind = policy in results.suite.get("baselines", [])
        days = [
            BLIND if blind and name in seen else _return(group_episodes(every.get(name, [])).get((policy, level)))
            for name in CONDITIONS.values()
        ]
        seeds = evaluated_seeds(results, policy, group_episodes(results.episodes)[policy, level])
        rows.append([policy, seeds, *days, *(_return(real.get((policy, river))) for river in rivers)])
    columns = ["policy, its return", "seeds", *CONDITIONS, *(f"the {river}" for river in rivers)]
    return markdown(frame(columns, rows))


def _return(rows: Sequence[Episode] | None) -> str:
    return str(mean_estimate(rows, "return_")) if rows else NOT_EVALUATED


def open_choices() -> str:
    """Return the results of each variant that the paper leaves open, on the training level."""
    results = results_of(OPEN)
    level, groups = train_level(results), group_episodes(results.episodes)
    rows = []
    for name in trained_policies(results):
        episodes = groups.get((name, level))
        if episodes is None:
            continue
        returns, cost = mean_estimate(episodes, "return_"), mean_estimate(episodes, "cost")
        success = proportion(episodes, lambda row: row.success)
        regret_ = training_regret(results, name)
        regret_text = "unknown" if regret_ is None else f"{regret_:.2f}"
        seeds = evaluated_seeds(results, name, episodes)
        rows.append([name, seeds, str(returns), str(cost), limit_met(cost), str(success), regret_text])
    return markdown(frame(["policy", "seeds", "return", "cost", "limit met", "success", "regret in training"], rows))


def sizes() -> str:
    """Return the errors of encoders by size, and how well they preserve the river."""
    return table(read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS), ENCODER_COLUMNS)


def probes() -> str:
    """Return what a linear regression predicts from the codes."""
    return table(read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS), (*CASE, *READ))


def geometry() -> str:
    """Return what a linear regression reads from the codes of the packaged encoders on rivers held out."""
    return table(read_csv(ENCODERS / "geometry.csv", GEOMETRY_READ), GEOMETRY_READ)


def geometry_of_tasks() -> str:
    """Return what a linear regression reads, along flights in each task, from the codes of the packaged encoder of
    geometry of the tasks and of the autoencoder."""
    rows = read_csv(ENCODERS / "geometry_tasks.csv", GEOMETRY_OF_TASKS)
    names = {"geometry": "geometry-tasks"}
    shown = [
        row | {"encoder": names.get(row["encoder"], row["encoder"])}
        for row in rows
        if row["views"].startswith("flights")
    ]
    return table(shown, GEOMETRY_OF_TASKS)


def entropies() -> str:
    """Return the relative entropy of the codes of different inputs."""
    rows = read_csv(ENCODERS / "entropy.csv", PAIR)
    return table(rows, list(rows[0]))


@cache
def results_of(folder: Path) -> Results:
    """Read a results folder once for all tables, as of the versions it was made with.

    Raises `ResultsError` where a file cannot be used.
    """
    results = read_results(folder, as_recorded=True)
    if results.skipped:
        raise ResultsError(f"{folder.name}: {'; '.join(results.skipped)}")
    return results
