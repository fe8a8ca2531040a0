"""The paper's figures: training curves, and bars of why episodes ended; with the style of all figures."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.evaluate.episodes import ALL_REASONS, REASON_TEXT
from thalweg.bench.report.policies import seeds_text
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import (
    Summary,
    TrainingCurve,
    TrainingLog,
    mean_and_std,
    summaries,
    training_curve,
)

GRID = 200
"""Points of a training curve."""
MOST_TOGETHER = 5
"""Most policies whose training curves can be told apart in one panel."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f5539", "#444444", "#a2a500", "#8338ec")
"""Colours of the algorithms, in order; the first ones can be told apart by colour-blind people (Okabe and Ito 2008)."""
REASON_COLOURS = dict(
    zip(
        ALL_REASONS,
        ("#8c1d18", "#d6453d", "#f2a099", "#e9c46a", "#c2b68c", "#8d99ae", "#2a9d6f", "#7b5ea7"),
        strict=True,
    )
)
"""Colour of each reason: tight violations red, loose ones yellow to grey, success green, the cost of a task purple."""

STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "axes.titlesize": 10,
    "figure.constrained_layout.use": True,
    "pdf.fonttype": 42,
}


def fix_layout(figure: Figure) -> None:
    """Compute the layout of a figure once, so that it is not computed again for each file."""
    with matplotlib.rc_context(STYLE):
        figure.draw_without_rendering()
    figure.set_layout_engine("none")


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG."""
    return _saved(figure, format="png", dpi=150)


def pdf(figure: Figure) -> bytes:
    """Return the figure as a PDF with embedded fonts, as journals require; the same bytes each time."""
    return _saved(figure, format="pdf", metadata={"CreationDate": None})


def _saved(figure: Figure, **options: Any) -> bytes:
    buffer = io.BytesIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(buffer, **options)
    return buffer.getvalue()


PANELS = (
    ("return_", f"return (mean of the last {MEAN_EPISODES} episodes)"),
    ("total_rate", "violations per step, all"),
    ("tight_rate", "violations per step, tight"),
    ("loose_rate", "violations per step, loose"),
)
"""Field of a curve and title, for each panel of the training curves."""


def training_curves(results: Results) -> Figure | None:
    """Draw return and violation rates over training steps, with a band over seeds; None where nothing was trained.

    More than `MOST_TOGETHER` policies have a row each, with the curves of the others in grey behind their own.
    """
    logs = [log for log in results.training if len(log.step)]
    if not logs:
        return None
    last = results.most_steps or int(max(log.step[-1] for log in logs))
    grid = np.linspace(last / GRID, last, GRID)
    names = list(dict.fromkeys(log.algorithm for log in logs))
    if len(names) > MOST_TOGETHER:
        return _small_multiples(results, {name: [log for log in logs if log.algorithm == name] for name in names}, grid)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9, 5.8 + 0.05 * len(names)))
        axes = list(figure.subplots(2, 2, sharex=True).flat)
        for index, name in enumerate(names):
            own = [log for log in logs if log.algorithm == name]
            curves = [training_curve(log, grid) for log in own]
            label = f"{name} ({_seed_count(results, own)})"
            for axis, (field, _) in zip(axes, PANELS, strict=True):
                _draw_band(axis, curves, field, line_style(index), label)
        for axis, (_, title) in zip(axes, PANELS, strict=True):
            axis.set_title(title)
            axis.set_ylim(bottom=0)
            axis.set_xlim(0, last)
        for axis in axes[2:]:
            axis.set_xlabel("steps of training")
            axis.xaxis.set_major_locator(MaxNLocator(4))
            axis.xaxis.set_major_formatter(lambda steps, _: f"{steps:,.0f}")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _small_multiples(results: Results, logs: dict[str, list[TrainingLog]], grid: np.ndarray) -> Figure:
    """Draw a row of panels for each policy, which share their axes by column."""
    curves = {name: [training_curve(log, grid) for log in own] for name, own in logs.items()}
    means = {
        name: {field: mean_and_std([getattr(curve, field) for curve in own])[0] for field, _ in PANELS}
        for name, own in curves.items()
    }
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9, 0.8 + 0.95 * len(curves)))
        axes = figure.subplots(len(curves), len(PANELS), sharex=True, sharey="col", squeeze=False)
        for row, (name, own) in zip(axes, curves.items(), strict=True):
            for axis, (field, _) in zip(row, PANELS, strict=True):
                for other in means.values():
                    axis.plot(grid, other[field], color="#c9cdd1", linewidth=0.6)
                _draw_band(axis, own, field, {"color": COLOURS[0]}, name)
            row[0].set_ylabel(
                f"{name}\n({_seed_count(results, logs[name])})", rotation=0, ha="right", va="center", fontsize=8
            )
        for axis, (_, title) in zip(axes[0], PANELS, strict=True):
            axis.set_title(title.replace(" (", "\n("), fontsize=8)
            axis.set_ylim(bottom=0)
            axis.set_xlim(0, grid[-1])
        for axis in axes[-1]:
            axis.xaxis.set_major_locator(MaxNLocator(2))
            axis.xaxis.set_major_formatter(lambda steps, _: f"{steps / 1000:,.0f}")
        figure.supxlabel("steps of training, in thousands", fontsize=8)
    return figure


def line_style(index: int) -> dict[str, Any]:
    """Return colour and line style of the policy with that index: ten solid lines, then the same colours dashed."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": "-" if index < len(COLOURS) else "--"}


def _seed_count(results: Results, logs: Sequence[TrainingLog]) -> str:
    """Return how many of a policy's runs a curve averages, and how many of these failed."""
    count = seeds_text(results, logs[0].algorithm, len(logs))
    failed = {(row.algorithm, row.seed) for row in results.runs if (row.kind, row.status) == ("train", "failed")}
    stopped = sum((log.algorithm, log.seed) in failed for log in logs)
    return f"{count} seed{'s' * (count != '1')}" + (f", {stopped} of them failed" if stopped else "")


def _draw_band(axis, curves: list[TrainingCurve], field: str, style: dict[str, Any], label: str) -> None:
    mean, std = mean_and_std([getattr(curve, field) for curve in curves])
    axis.plot(curves[0].steps, mean, label=label, linewidth=1.4, **style)
    if len(curves) > 1:
        axis.fill_between(curves[0].steps, mean - std, mean + std, color=style["color"], alpha=0.2, linewidth=0)


def failure_bars(results: Results) -> Figure:
    """Draw why episodes ended, as shares of each policy's episodes, one panel per level; gaps are labelled."""
    by_policy_and_level, names = summaries(results.episodes), results.policies
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(max(7.0, 3.0 * len(results.levels)), 1.6 + 0.3 * len(names)))
        axes = np.atleast_1d(figure.subplots(1, len(results.levels), sharey=True))
        for axis, level in zip(axes, results.levels, strict=True):
            level_summaries = [by_policy_and_level.get((name, level)) for name in names]
            left = np.zeros(len(names))
            for reason in results.reasons:
                shares = [cell.reasons[reason] / cell.episodes if cell else 0.0 for cell in level_summaries]
                axis.barh(names, shares, left=left, color=REASON_COLOURS[reason], label=REASON_TEXT[reason], height=0.7)
                left += shares
            for row, (name, cell) in enumerate(zip(names, level_summaries, strict=True)):
                _label_gap(axis, row, results, name, cell)
            axis.set_title(level)
            axis.set_xlim(0, 1)
            axis.xaxis.set_major_formatter(lambda share, _: f"{share:.0%}")
            axis.grid(axis="y", visible=False)
        axes[0].invert_yaxis()
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)
    return figure


def _label_gap(axis, row: int, results: Results, name: str, cell: Summary | None) -> None:
    """Write into a policy's row why it is empty, or how many seeds are missing."""
    seeds = seeds_text(results, name, cell.seeds if cell else 0)
    if cell is None:
        axis.text(0.02, row, results.gap(name), va="center", style="italic")
    elif "of" in seeds:
        box = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.5}
        axis.text(0.98, row, f"{seeds} seeds", va="center", ha="right", fontsize=7, bbox=box)
