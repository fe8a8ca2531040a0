"""The cost of training in the four tasks, for `docs/task-findings.md`: a table, a sentence and a picture.

Costs are those of finished episodes on the rivers of training, of runs that were trained to their end, at the middle
limits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from findings import cost_by_quarter, seed_mean
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from task_findings_picture import SHADE, style_of, with_palette
from task_outcomes import LIMITLESS, Studies, Study, spread
from task_risk import algorithms_of, middle_table

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.report.figures import GRID, STYLE, png
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.statistics import TrainingLog, mean_and_std, running_mean

PER = 1000
"""Steps that the cost of all training is told for."""


@dataclass(frozen=True)
class TrainingCost:
    """What the training of an algorithm costs, beside the middle limit of a task."""

    task: str
    algorithm: str
    limit: float
    per_steps: Estimate
    """Cost of `PER` steps, over all of training."""
    late: Estimate
    """Mean cost of an episode in the last quarter of the steps."""


def costs_of_training(studies: Studies) -> list[TrainingCost]:
    """Return what each algorithm's training costs beside the middle limit of each task, as far as it was run."""
    return [
        TrainingCost(
            study.task,
            algorithm,
            study.middle_limit,
            seed_mean([PER * float((log.cost * log.episodes_of_rows).sum()) / log.last_step for log in logs], np.inf),
            seed_mean([cost_by_quarter(log)[-1] for log in logs], np.inf),
        )
        for study in studies.values()
        for algorithm, logs in _logs_of(study).items()
    ]


def _logs_of(study: Study) -> dict[str, list[TrainingLog]]:
    """Return the logs of the trainings beside the middle limit of a task that reached their end, by algorithm."""
    if study.results is None:
        return {}
    ended = {(row.algorithm, row.seed) for row in study.results.runs if row.status == "finished"}
    every = [log for log in study.results.training if len(log.step) and (log.algorithm, log.seed) in ended]
    names = {algorithm: study.name_of(algorithm, study.middle_limit) for algorithm in study.algorithms}
    logs = {algorithm: [log for log in every if log.algorithm == name] for algorithm, name in names.items()}
    return {algorithm: own for algorithm, own in logs.items() if own}


def training_section(studies: Studies) -> str:
    """Return what `PER` steps of training cost, and an episode of its last quarter, at the middle limits: a row for
    each algorithm, a column for each task."""
    found = {
        (each.task, each.algorithm): f"{spread(each.per_steps)}; {spread(each.late)}"
        for each in costs_of_training(studies)
    }
    return middle_table(studies, found)


def training_fact(studies: Studies) -> str:
    """Return whether episodes keep to the middle limits late in training, and what all of it costs beside training
    without a limit."""
    every = costs_of_training(studies)
    limited = [each for each in every if each.algorithm not in LIMITLESS]
    if not limited:
        return "**What learning costs** is not known yet."
    late = {_named(each): each.late.value / each.limit for each in limited if not np.isnan(each.late.value)}
    sentence = (
        "**What learning costs.** On the rivers of training at the middle limits, episodes of the last quarter of the"
        f" steps cost {_range(late)} times the limit in the mean, and in {sum(each <= 1 for each in late.values())} of"
        f" {len(late)} cases no more than it."
    )
    free = {each.task: each for each in every if each.algorithm in LIMITLESS}
    shares = {
        _named(each): each.per_steps.value / free[each.task].per_steps.value for each in limited if each.task in free
    }
    if shares:
        sentence += (
            f" All of training costs {_range(shares)} times as much as that of {free.popitem()[1].algorithm}, which"
            " knows no limit: whoever fails early begins more flights."
        )
    return sentence


def _named(cost: TrainingCost) -> str:
    return f"{cost.algorithm}, {cost.task}"


def _range(values: Mapping[str, float]) -> str:
    """Return the least and the greatest value with their names, and the median."""
    least, most = min(values, key=lambda name: values[name]), max(values, key=lambda name: values[name])
    middle = np.median([*values.values()])
    return f"{values[least]:.1f} ({least}) to {values[most]:.1f} ({most}; the median is {middle:.1f})"


def drawn_training(studies: Studies) -> bytes:
    """Return a PNG of the cost of training at the middle limits over its steps, a panel for each task."""
    with rc_context(STYLE):
        return with_palette(png(training_figure(studies)))


def training_figure(studies: Studies) -> Figure:
    """Return the figure of training costs of four tasks, in the style that is set."""
    figure = Figure(figsize=(8.0, 5.6))
    for axis, study in zip(figure.subplots(2, 2).flat, studies.values(), strict=True):
        _draw_training(axis, study)
    for axis in figure.axes[2:]:
        axis.set_xlabel("steps of training")
    figure.supylabel(f"cost of an episode, mean of {MEAN_EPISODES}", fontsize=9)
    figure.legend(handles=_legend(studies), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure


def _draw_training(axis: Axes, study: Study) -> None:
    """Draw the panel of a task: linear up to twice the middle limit, logarithmic beyond."""
    logs, limit = _logs_of(study), study.middle_limit
    for algorithm, own in logs.items():
        last = max(log.last_step for log in own)
        grid = np.linspace(last / GRID, last, GRID)
        mean, _ = mean_and_std([running_mean(log, log.cost, grid) for log in own])
        axis.plot(grid, mean, linewidth=1.1, **_style(algorithm))
    axis.axhline(limit, color=SHADE, linewidth=0.9, linestyle=":", zorder=0)
    axis.set_yscale("symlog", linthresh=2 * limit, linscale=1.5)
    ticks = [0.0, limit, 2 * limit, *(each for each in (10.0, 100.0, 1000.0) if each > 3 * limit)]
    top = 1.2 * axis.get_ylim()[1]
    axis.set_yticks([each for each in ticks if each <= top], labels=[f"{each:g}" for each in ticks if each <= top])
    axis.minorticks_off()
    axis.set_ylim(0.0, top)
    axis.set_xlim(left=0)
    axis.xaxis.set_major_formatter(lambda steps, _: f"{steps:,.0f}")
    axis.set_title(f"{study.task}, limit {limit:g}" if logs else f"{study.task}, not run yet")


def _style(algorithm: str) -> dict[str, Any]:
    return {"color": "black"} if algorithm in LIMITLESS else style_of(algorithm)


def _legend(studies: Studies) -> list[Line2D]:
    run = {name for study in studies.values() for name in _logs_of(study)}
    lines = [
        Line2D([], [], linewidth=1.6, label=f"{name}, without a limit" if name in LIMITLESS else name, **_style(name))
        for name in algorithms_of(studies)
        if name in run
    ]
    return [*lines, Line2D([], [], color=SHADE, linewidth=0.9, linestyle=":", label="middle limit")]
