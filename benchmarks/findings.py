"""What do the committed results say? The tables of `docs/findings.md`, which `write_figures.py` puts there."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from thalweg.bench.beyond import LIMIT, kept, limits, pairs, train_level, trained_policies, training_regret
from thalweg.bench.encoder_tables import CASE, SIZE_COLUMNS
from thalweg.bench.episodes import Episode
from thalweg.bench.files import read_csv
from thalweg.bench.inference import mean_of, share
from thalweg.bench.reading import read_results
from thalweg.bench.statistics import TrainingLog, grouped, regret
from thalweg.bench.tables import markdown, paper_table, seeds_text

HERE = Path(__file__).resolve().parent
STUDY, OPEN, ENCODERS = HERE / "paper", HERE / "open", HERE / "encoders"
FIRST = "PPO"
"""The policy that others are compared with in pairs."""
NOT_YET, BLIND = "not flown yet", "sees nothing"
CONDITIONS = {"sampled": "", "deterministic": "deterministic", "unseen rivers": "unseen", "every look": "all_at_once"}
"""Columns of the table of conditions, and what the results call them."""
REAL = "real"
ENCODER_COLUMNS = (*CASE, "train_mse", "held_out_mse", "iou_mask", "iou_colours", "iou_ceiling")
ENTROPY_COLUMNS = ("first", "second", "paper")


def study() -> str:
    """The paper's table: every policy on every level, published figures below ours."""
    return markdown(*paper_table(read_results(STUDY)))


def keeping() -> str:
    """Whether each policy keeps the limit."""
    return markdown(*limits(read_results(STUDY)).grid)


def beside_first() -> str:
    """Each other policy against `FIRST`, start by start."""
    results = read_results(STUDY)
    header, rows = pairs(results).grid
    return markdown(header, [row for row in rows if row[0] == FIRST])


def training() -> str:
    """When the cost of training was paid."""
    results = read_results(STUDY)
    rows = []
    for name in trained_policies(results):
        logs = [log for log in results.training if log.algorithm == name]
        if logs:
            paid = [float(np.mean(costs)) for costs in zip(*map(_by_quarter, logs), strict=True)]
            early = float(np.mean([_early(log) for log in logs]))
            rows.append([name, *(f"{cost:.2f}" for cost in paid), f"{early:.0%}"])
    quarters = (f"{ordinal} quarter" for ordinal in ("first", "second", "third", "last"))
    return markdown(["cost of an episode", *quarters, "regret in the first quarter"], rows)


def _by_quarter(log: TrainingLog) -> list[float]:
    """Mean cost of the episodes that ended in each quarter of the steps."""
    costs, quarter = log.tight + log.loose, 4 * (log.step - 1) // log.last_step
    return [float(costs[quarter == number].mean()) for number in range(4)]


def _early(log: TrainingLog) -> float:
    """The share of the regret that episodes of the first quarter of the steps make up."""
    first = log.step <= log.last_step / 4
    part = replace(log, step=log.step[first], tight=log.tight[first], loose=log.loose[first])
    return regret(part, LIMIT) * first.sum() / (regret(log, LIMIT) * len(first))


def elsewhere() -> str:
    """The mean return of each policy under some conditions, on the level of training and on real rivers."""
    results = read_results(STUDY)
    level = train_level(results)
    every = {"": results.episodes, **results.beyond}
    real = grouped(results.beyond.get(REAL, []))
    rivers = list(dict.fromkeys(river for _, river in real))
    seen = {condition["name"] for condition in results.suite["conditions"] if not condition["blind"]}
    rows = []
    for policy in results.policies:
        if (policy, level) not in grouped(results.episodes):
            continue
        blind = policy in results.suite["baselines"]
        days = [
            BLIND if blind and name in seen else _return(grouped(every.get(name, [])).get((policy, level)))
            for name in CONDITIONS.values()
        ]
        rows.append([policy, *days, *(_return(real.get((policy, river))) for river in rivers)])
    return markdown(["return", *CONDITIONS, *(f"the {river}" for river in rivers)], rows)


def _return(rows: Sequence[Episode] | None) -> str:
    return str(mean_of(rows, "return_")) if rows else NOT_YET


def left_open() -> str:
    """What the paper left open: each way of doing it, on the level of training."""
    results = read_results(OPEN)
    level, flown = train_level(results), grouped(results.episodes)
    rows = []
    for name in trained_policies(results):
        own = flown.get((name, level))
        if own is None:
            continue
        cost, worse = mean_of(own, "cost"), training_regret(results, name)
        success = share(own, lambda row: row.success)
        seeds = seeds_text(results, name, len({row.seed for row in own}))
        paid = "unknown" if worse is None else f"{worse:.2f}"
        rows.append([name, seeds, str(mean_of(own, "return_")), str(cost), kept(cost), success.as_percent(), paid])
    return markdown(["policy", "seeds", "return", "cost", "limit met", "success", "regret in training"], rows)


def sizes() -> str:
    """Errors of encoders by size, and how well they keep the river."""
    rows = read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS)
    return markdown(_heads(ENCODER_COLUMNS), [[row[name] for name in ENCODER_COLUMNS] for row in rows])


def probes() -> str:
    """What a linear regression reads from the codes."""
    columns = (*CASE, *(name for name in SIZE_COLUMNS if name.startswith("read_")))
    rows = read_csv(ENCODERS / "sizes.csv", SIZE_COLUMNS)
    return markdown(_heads(columns), [[row[name] for name in columns] for row in rows])


def entropies() -> str:
    """Relative entropy of the codes of different inputs."""
    rows = read_csv(ENCODERS / "entropy.csv", ENTROPY_COLUMNS)
    return markdown(_heads(list(rows[0])), [list(row.values()) for row in rows])


def _heads(columns: Sequence[str]) -> list[str]:
    return [name.removeprefix("read_").replace("_", " ") for name in columns]
