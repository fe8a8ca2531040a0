"""Figures that compare policies: performance profiles, and returns under each evaluation condition."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from thalweg.bench.report.figures import STYLE, line_style
from thalweg.bench.report.policies import train_level, trained_policies
from thalweg.bench.results.comparison import PROFILE_RETURNS, performance_profile
from thalweg.bench.results.inference import score_matrix
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes, summaries
from thalweg.bench.suite.record import flown_levels

MAX_BANDS = 4
"""Most policies whose interval bands can be told apart in one panel."""


def return_profiles(results: Results) -> Figure | None:
    """Draw the share of each trained policy's episodes with at least a given return, one panel per level.

    Up to `MAX_BANDS` policies have pointwise intervals over seeds. Returns None where nothing was trained.
    """
    groups = group_episodes(results.episodes)
    names = [name for name in trained_policies(results) if any((name, level) in groups for level in results.levels)]
    if not names:
        return None
    with rc_context(STYLE):
        figure = Figure(figsize=(max(6.0, 3.2 * len(results.levels)), 3.6))
        axes = np.atleast_1d(figure.subplots(1, len(results.levels), sharey=True))
        for axis, level in zip(axes, results.levels, strict=True):
            for index, name in enumerate(names):
                try:
                    share, low, high = performance_profile(score_matrix(groups.get((name, level), [])))
                except (ValueError, IndexError):
                    continue  # a seed did not fly every start; the tables name it
                style = line_style(index)
                axis.plot(PROFILE_RETURNS, share, label=name, linewidth=1.3, **style)
                if len(names) <= MAX_BANDS:
                    axis.fill_between(PROFILE_RETURNS, low, high, color=style["color"], alpha=0.12, linewidth=0)
            axis.set_title(level)
            axis.set_xlabel("return")
            axis.set_ylim(0, 1.02)
        axes[0].set_ylabel("share of flights with at least that return")
        lines = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        figure.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=6, frameon=False)
    return figure


def condition_grid(results: Results) -> Figure | None:
    """Draw the mean return of each policy under each condition as a heat map.

    Returns are those on the training level, or on the first river or level of the condition that was flown where it
    excludes that level, in the order of the suite. Returns None without conditions.
    """
    own = {each["name"]: flown_levels(results.suite, each) for each in results.suite.get("conditions", [])}
    conditions = {"main": summaries(results.episodes)}
    conditions |= {name: summaries(rows) for name, rows in results.condition_episodes.items()}
    if len(conditions) == 1:
        return None
    flown = {policy for summaries_by_river in conditions.values() for policy, _ in summaries_by_river}
    names = [name for name in results.policies if name in flown]
    returns = np.full((len(names), len(conditions)), np.nan)
    for column, (condition, summaries_by_river) in enumerate(conditions.items()):
        rivers = list(dict.fromkeys(river for _, river in summaries_by_river))
        river = next(each for each in (train_level(results), *own.get(condition, ()), *rivers) if each in rivers)
        for row, name in enumerate(names):
            if (name, river) in summaries_by_river:
                returns[row, column] = summaries_by_river[name, river].return_mean
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(2.2 + 0.48 * len(conditions), 1.5 + 0.3 * len(names)))
        axis = figure.subplots()
        image = axis.imshow(returns, cmap="cividis", vmin=0, vmax=10, aspect="auto")
        axis.set_xticks(range(len(conditions)), list(conditions), rotation=55, ha="right", rotation_mode="anchor")
        axis.set_yticks(range(len(names)), names)
        for (row, column), value in np.ndenumerate(returns):
            if not np.isnan(value):
                colour = "black" if value > 5.5 else "white"
                axis.text(column, row, f"{value:.1f}", ha="center", va="center", fontsize=7, color=colour)
        figure.colorbar(image, ax=axis, label="mean return", shrink=0.8)
    return figure
