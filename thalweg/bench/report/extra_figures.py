"""What do returns and conditions look like? Profiles of returns, and how far each condition moves each policy."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from thalweg.bench.report.extra_tables import train_level, trained_policies
from thalweg.bench.report.figures import STYLE, line_style
from thalweg.bench.results.comparison import SHARES, profile
from thalweg.bench.results.inference import table_of
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import grouped, summaries

FEW = 4
"""Policies of which intervals can still be told apart."""


def profiles(results: Results) -> Figure | None:
    """The share of each trained policy's flights that return at least so much, a panel for each level; of few policies
    with pointwise intervals over seeds. None where nothing was trained."""
    flown = grouped(results.episodes)
    names = [name for name in trained_policies(results) if any((name, level) in flown for level in results.levels)]
    if not names:
        return None
    with rc_context(STYLE):
        figure = Figure(figsize=(max(6.0, 3.2 * len(results.levels)), 3.6))
        axes = np.atleast_1d(figure.subplots(1, len(results.levels), sharey=True))
        for axis, level in zip(axes, results.levels, strict=True):
            for place, name in enumerate(names):
                try:
                    share, low, high = profile(table_of(flown.get((name, level), [])))
                except (ValueError, IndexError):
                    continue  # a seed did not fly every start: the tables say so
                style = line_style(place)
                axis.plot(SHARES, share, label=name, linewidth=1.3, **style)
                if len(names) <= FEW:
                    axis.fill_between(SHARES, low, high, color=style["color"], alpha=0.12, linewidth=0)
            axis.set_title(level)
            axis.set_xlabel("return")
            axis.set_ylim(0, 1.02)
        axes[0].set_ylabel("share of flights with at least that return")
        found = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        figure.legend(found.values(), found.keys(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def condition_grid(results: Results) -> Figure | None:
    """Mean return of each policy under each condition on the level of training, or else on its own river; None without
    conditions."""
    level = train_level(results)
    cells = {"main": summaries(results.episodes)} | {name: summaries(rows) for name, rows in results.beyond.items()}
    if len(cells) == 1:
        return None
    names = [name for name in results.policies if any(name == one for found in cells.values() for one, _ in found)]
    table = np.full((len(names), len(cells)), np.nan)
    for column, found in enumerate(cells.values()):
        rivers = {where for _, where in found}
        where = level if level in rivers else next(iter(rivers))
        for row, name in enumerate(names):
            if (name, where) in found:
                table[row, column] = found[name, where].return_mean
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(2.2 + 0.48 * len(cells), 1.5 + 0.3 * len(names)))
        axis = figure.subplots()
        image = axis.imshow(table, cmap="cividis", vmin=0, vmax=10, aspect="auto")
        axis.set_xticks(range(len(cells)), list(cells), rotation=55, ha="right", rotation_mode="anchor")
        axis.set_yticks(range(len(names)), names)
        for (row, column), value in np.ndenumerate(table):
            if not np.isnan(value):
                colour = "black" if value > 5.5 else "white"
                axis.text(column, row, f"{value:.1f}", ha="center", va="center", fontsize=7, color=colour)
        figure.colorbar(image, ax=axis, label="mean return", shrink=0.8)
    return figure
