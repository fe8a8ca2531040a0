"""What do the committed results say? The tables of `docs/findings.md`, which `write_figures.py` puts there."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from thalweg.bench.csv_files import ResultsError, read_csv
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.report.extra_tables import (
    LIMIT,
    flown_seeds,
    kept,
    limits,
    pairs,
    train_level,
    trained_policies,
    training_regret,
)
from thalweg.bench.report.tables import markdown, paper_table, seeds_text
from thalweg.bench.results.inference import POSSIBLE, Estimate, clipped, mean_of, share, student
from thalweg.bench.results.reading import read_results
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import TrainingLog, grouped, regret
from thalweg.bench.studies.encoder_tables import CASE, READ, SIZE_COLUMNS, table
from thalweg.bench.suite.suites import arms_of

HERE = Path(__file__).resolve().parent
STUDY, OPEN, ENCODERS = HERE / "paper", HERE / "open", HERE / "encoders"
FIRST = "PPO"
"""The policy that others are compared with in pairs."""
NOT_YET, BLIND = "not flown yet", "sees nothing"
CONDITIONS = {"sampled": "", "deterministic": "deterministic", "unseen rivers": "unseen", "every look": "all_at_once"}
"""Columns of the table of conditions, and what the results call them."""
REAL = "real"
ENCODER_COLUMNS = (*CASE, "train_mse", "held_out_mse", "iou_mask", "iou_colours", "iou_ceiling")
PAIR = ("first", "second", "paper")
"""Columns of entropy.csv that do not depend on the smoothing."""


def study() -> str:
    """The paper's table: every policy on every level, published figures below ours."""
    return markdown(*paper_table(_results(STUDY)))


def keeping() -> str:
    """Whether each policy keeps the limit."""
    header, rows = limits(_results(STUDY)).grid
    return markdown(header[:-2], [row[:-2] for row in rows])  # without times


def beside_first() -> str:
    """Each other policy against `FIRST`, start by start."""
    header, rows = pairs(_results(STUDY)).grid
    return markdown(header, [row for row in rows if row[0] == FIRST])


def beside_usual() -> str:
    """What the paper left open: the usual way of each algorithm against its others, start by start."""
    results = _results(OPEN)
    algorithms = {arm["name"]: arm["algorithm"] for arm in arms_of(results.suite)}
    header, rows = pairs(results).grid
    return markdown(header, [row for row in rows if row[0] == algorithms[row[1]]])


def training() -> str:
    """When the cost of training was paid."""
    results = _results(STUDY)
    rows = []
    for name in trained_policies(results):
        logs = [log for log in results.training if log.algorithm == name]
        if logs:
            paid = [_over_seeds(each) for each in zip(*map(by_quarter, logs), strict=True)]
            bound = [at_bound(results.folder / "runs" / f"{name}-{log.seed}") for log in logs]
            seeds = seeds_text(results, name, len(logs))
            rows.append([name, seeds, *map(str, paid), _percent(map(early_regret, logs)), _percent(bound)])
    quarters = (f"cost, {ordinal} quarter" for ordinal in ("first", "second", "third", "last"))
    return markdown(["policy", "seeds", *quarters, "regret paid in the first quarter", "multiplier at its bound"], rows)


def _over_seeds(costs: Sequence[float]) -> Estimate:
    """The mean cost of seeds with its interval; seeds that have none (NaN) are left out."""
    known = np.array([cost for cost in costs if not np.isnan(cost)])
    return clipped(student(float(known.mean()), known), *POSSIBLE["cost"]) if len(known) else Estimate(np.nan)


def _percent(shares: Iterable[float]) -> str:
    """The mean of the seeds' shares that there are."""
    known = [share for share in shares if not np.isnan(share)]
    return f"{np.mean(known):.0%}" if known else "none"


def at_bound(run: Path) -> float:
    """The share of the updates of a training run in which the multiplier stood at its greatest; NaN if it has none."""
    config = yaml.safe_load((run / "config.yaml").read_text(encoding="utf-8"))["run"]["config"]
    if "multiplier_max" not in config:
        return np.nan
    values = [float(row["multiplier"]) for row in read_csv(run / "metrics.csv", ("multiplier",))]
    return float(np.mean(np.array(values) >= config["multiplier_max"]))


def by_quarter(log: TrainingLog) -> list[float]:
    """Mean cost of the episodes that ended in each quarter of the steps; NaN where none did."""
    costs, quarter = log.tight + log.loose, _quarter(log)
    return [float(costs[quarter == number].mean()) if (quarter == number).any() else np.nan for number in range(4)]


def early_regret(log: TrainingLog) -> float:
    """The share of the regret that episodes of the first quarter of the steps make up; NaN where there is none."""
    first = _quarter(log) == 0
    part = replace(log, step=log.step[first], tight=log.tight[first], loose=log.loose[first])
    whole = regret(log, LIMIT) * len(first)
    return regret(part, LIMIT) * float(first.sum()) / whole if whole else np.nan


def _quarter(log: TrainingLog) -> np.ndarray:
    """Of the steps, in which each episode ended: 0 to 3."""
    return 4 * (log.step - 1) // log.last_step


def elsewhere() -> str:
    """The mean return of each policy under some conditions, on the level of training and on real rivers."""
    results = _results(STUDY)
    level = train_level(results)
    every = {"": results.episodes, **results.beyond}
    real = grouped(results.beyond.get(REAL, []))
    rivers = list(dict.fromkeys(river for _, river in real))
    seen = {condition["name"] for condition in results.suite.get("conditions", []) if not condition["blind"]}
    rows = []
    for policy in results.policies:
        if (policy, level) not in grouped(results.episodes):
            continue
        blind = policy in results.suite.get("baselines", [])
        days = [
            BLIND if blind and name in seen else _return(grouped(every.get(name, [])).get((policy, level)))
            for name in CONDITIONS.values()
        ]
        seeds = flown_seeds(results, policy, grouped(results.episodes)[policy, level])
        rows.append([policy, seeds, *days, *(_return(real.get((policy, river))) for river in rivers)])
    return markdown(["policy, its return", "seeds", *CONDITIONS, *(f"the {river}" for river in rivers)], rows)


def _return(rows: Sequence[Episode] | None) -> str:
    return str(mean_of(rows, "return_")) if rows else NOT_YET


def left_open() -> str:
    """What the paper left open: each way of doing it, on the level of training."""
    results = _results(OPEN)
    level, flown = train_level(results), grouped(results.episodes)
    rows = []
    for name in trained_policies(results):
        own = flown.get((name, level))
        if own is None:
            continue
        cost, worse = mean_of(own, "cost"), training_regret(results, name)
        success = share(own, lambda row: row.success)
        seeds = flown_seeds(results, name, own)
        paid = "unknown" if worse is None else f"{worse:.2f}"
        rows.append([name, seeds, str(mean_of(own, "return_")), str(cost), kept(cost), success.as_percent(), paid])
    return markdown(["policy", "seeds", "return", "cost", "limit met", "success", "regret in training"], rows)


def sizes() -> str:
    """Errors of encoders by size, and how well they keep the river."""
    return table(read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS), ENCODER_COLUMNS)


def probes() -> str:
    """What a linear regression reads from the codes."""
    return table(read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS), (*CASE, *READ))


def entropies() -> str:
    """Relative entropy of the codes of different inputs."""
    rows = read_csv(ENCODERS / "entropy.csv", PAIR)
    return table(rows, list(rows[0]))


@cache
def _results(folder: Path) -> Results:
    """Read once for all tables; raises `ResultsError` where a file can't be used, which no table would say."""
    results = read_results(folder)
    if results.skipped:
        raise ResultsError(f"{folder.name}: {'; '.join(results.skipped)}")
    return results
