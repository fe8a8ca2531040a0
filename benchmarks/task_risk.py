"""Tables and the picture of `docs/task-findings.md` beyond mean costs of flights: the area of cost and return that an
algorithm's limits cover, the worst tenth of its flights, and what its training costs.

Areas are those of reports (`thalweg.bench.report.price_tables`), on the fixed river. Costs of training are of finished
episodes, with all the noise of sampled actions, on the rivers of training.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from task_findings_picture import SHADE, style_of, with_palette
from task_outcomes import LIMITLESS, Outcome, Study, mean_text, spread

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.fronts.fronts import FIXED
from thalweg.bench.report.figures import GRID, STYLE, png
from thalweg.bench.report.price_tables import covered_areas
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import Estimate, clip, t_interval
from thalweg.bench.results.statistics import TrainingLog, mean_and_std, running_mean

Studies = Mapping[str, Study]
NOTHING = "Nothing has been run yet.\n"


@dataclass(frozen=True)
class TrainingCost:
    """What the training of an algorithm cost, beside a limit."""

    task: str
    algorithm: str
    limit: float
    mean: Estimate
    """Mean cost of an episode from the first step to the last."""


def area_section(studies: Studies) -> str:
    """Return the share of the oracle's area that each algorithm covers, in a row for each, a column for each task."""
    found = {
        (task, each.name): spread(each.share)
        for task, study in studies.items()
        if study.results is not None
        for each in covered_areas(study.results)
    }
    names = [name for name in _algorithms(studies) if any(key[1] == name for key in found)]
    rows = [[name, *(found.get((task, name), "missing") for task in studies)] for name in names]
    return markdown(frame(["algorithm", *studies], rows)) if rows else NOTHING


def tail_section(studies: Studies) -> str:
    """Return the mean cost of the worst tenth of flights on the fixed river at the middle limits, a row for each
    algorithm, a column for each task."""
    return _middle_table(studies, lambda study, name: _tail_text(study.outcome(FIXED, name, study.middle_limit)))


def training_section(studies: Studies) -> str:
    """Return the mean cost of an episode of training at the middle limits, as `tail_section`."""
    costs = {(each.task, each.algorithm): spread(each.mean) for each in training_costs(studies)}
    return _middle_table(studies, lambda study, name: costs.get((study.task, name)))


def _middle_table(studies: Studies, cell: Callable[[Study, str], str | None]) -> str:
    rows = []
    for name in _algorithms(studies):
        cells = [cell(study, name) for study in studies.values()]
        if any(cells):
            label = f"{name}, without a limit" if name in LIMITLESS else name
            rows.append([label, *(each or "missing" for each in cells)])
    columns = ["algorithm", *(f"{task}, limit {study.middle_limit:g}" for task, study in studies.items())]
    return markdown(frame(columns, rows)) if rows else NOTHING


def _algorithms(studies: Studies) -> list[str]:
    """Return the algorithms of all studies, in the order of the suites."""
    return list(dict.fromkeys(name for study in studies.values() for name in study.algorithms))


def _tail_text(outcome: Outcome | None) -> str | None:
    """Return the worst tenth of an outcome with its interval, in whose middle it does not lie."""
    if outcome is None:
        return None
    tail, text = outcome.tail, mean_text(outcome.tail.value)
    return text if math.isnan(tail.low) else f"{text} [{mean_text(tail.low)}, {mean_text(tail.high)}]"


def training_costs(studies: Studies) -> list[TrainingCost]:
    """Return what each algorithm's training cost beside the middle limit of each task, as far as it was run."""
    found = []
    for study in studies.values():
        for algorithm, logs in _logs_of(study).items():
            each = np.array([float(np.average(log.cost, weights=log.episodes_of_rows)) for log in logs])
            estimate = clip(t_interval(float(each.mean()), each), 0.0, np.inf)
            found.append(TrainingCost(study.task, algorithm, study.middle_limit, estimate))
    return found


def _logs_of(study: Study) -> dict[str, list[TrainingLog]]:
    """Return the training logs of the policies beside the middle limit of a task, by algorithm."""
    every = [] if study.results is None else [log for log in study.results.training if len(log.step)]
    names = {algorithm: study.name_of(algorithm, study.middle_limit) for algorithm in study.algorithms}
    logs = {algorithm: [log for log in every if log.algorithm == name] for algorithm, name in names.items()}
    return {algorithm: own for algorithm, own in logs.items() if own}


def tail_fact(studies: Studies) -> str:
    """Return how much the worst tenth of flights costs where the middle limit is held."""
    holders = [each for study in studies.values() for each in study.limited(FIXED, study.middle_limit) if each.holds]
    if not holders:
        return "**The worst tenth.** Nobody holds a middle limit."
    times = [each.tail.value / each.limit for each in holders]
    least, most = holders[int(np.argmin(times))], holders[int(np.argmax(times))]
    return (
        f"**The worst tenth.** Where the middle limit is held in the mean ({len(holders)} times), the worst tenth of"
        f" flights costs {min(times):.1f} ({least.algorithm}, {least.task}) to {max(times):.1f} times the limit"
        f" ({most.algorithm}, {most.task}), with a median of {np.median(times):.1f}."
    )


def training_fact(studies: Studies) -> str:
    """Return whether episodes of training keep to the middle limits."""
    limited = [each for each in training_costs(studies) if each.algorithm not in LIMITLESS]
    if not limited:
        return "**What learning costs** is not known yet."
    times = [each.mean.value / each.limit for each in limited]
    least, most = limited[int(np.argmin(times))], limited[int(np.argmax(times))]
    return (
        "**What learning costs.** Episodes of training at the middle limits cost, in the mean from the first step to"
        f" the last, {min(times):.1f} ({least.algorithm}, {least.task}) to {max(times):.1f} times the limit"
        f" ({most.algorithm}, {most.task}), and in {sum(each <= 1 for each in times)} of {len(times)} cases no more"
        " than it."
    )


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
        axis.plot(*_curve(own), linewidth=1.1, **_style(algorithm))
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


def _curve(logs: Sequence[TrainingLog]) -> tuple[np.ndarray, np.ndarray]:
    """Return steps [G] and the mean cost [G] over some runs there."""
    last = max(log.last_step for log in logs)
    grid = np.linspace(last / GRID, last, GRID)
    return grid, mean_and_std([running_mean(log, log.cost, grid) for log in logs])[0]


def _style(algorithm: str) -> dict:
    return {"color": "black"} if algorithm in LIMITLESS else style_of(algorithm)


def _legend(studies: Studies) -> list[Line2D]:
    run = {name for study in studies.values() for name in _logs_of(study)}
    names = [name for name in _algorithms(studies) if name in run]
    lines = [
        Line2D([], [], linewidth=1.6, label=f"{name}, without a limit" if name in LIMITLESS else name, **_style(name))
        for name in names
    ]
    return [*lines, Line2D([], [], color=SHADE, linewidth=0.9, linestyle=":", label="middle limit")]
