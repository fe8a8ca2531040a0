"""Figures of tasks where a limit has a price: cost and return beside the oracle's front, and cost over training."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thalweg.algos.interface import MEAN_EPISODES
from thalweg.bench.fronts.fronts import FrontPoint, front_of
from thalweg.bench.report.figures import GRID, STYLE, line_style
from thalweg.bench.report.policies import train_level, trained_policies
from thalweg.bench.report.price_tables import limit_of, oracle_points, task_cost, task_return
from thalweg.bench.results.inference import Estimate
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes, mean_and_std, running_mean
from thalweg.bench.suite.record import arms_of, task_of
from thalweg.env.tasks import PAPER_TASK

MARKERS = "os^Dv"
"""Markers of an algorithm's policies, by rising limit."""
NARROW = 2.7
"""Width of a panel in inches."""


def front_figure(results: Results) -> Figure | None:
    """Draw mean cost and mean return of each trained policy, and the oracle's front; None for the paper's task.

    The front is today's, so outdated runs are not drawn beside it. They are drawn where there is no front: where no
    policy is current, or under rules that the oracle does not know.
    """
    groups, level = group_episodes(results.episodes), train_level(results)
    names = [name for name in trained_policies(results) if (name, level) in groups]
    if task_of(results.suite) == PAPER_TASK or not names:
        return None
    current = [name for name in names if name not in results.outdated]
    points = oracle_points(results) if current else []
    names = current if points else names
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 4.6))
        axis = figure.subplots()
        if points:
            _draw_oracle(axis, points)
        algorithms = algorithms_of(results)
        order, limits = list(dict.fromkeys(algorithms[name] for name in names)), _limits(results, names)
        for name in names:
            episodes = groups[name, level]
            colour = line_style(order.index(algorithms[name]))["color"]
            limit = limit_of(results, name)
            marker = "X" if limit is None else MARKERS[limits.index(limit) % len(MARKERS)]
            cost, returned = task_cost(episodes), task_return(results, episodes)
            _draw_point(axis, cost, returned, colour, marker, name)
        for limit in limits:
            axis.axvline(limit, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
        axis.set_xlabel("mean cost of an episode (dotted: limits)")
        axis.set_ylabel("mean return of an episode")
        axis.set_xlim(left=0)
        axis.set_ylim(min(0.0, 1.05 * axis.dataLim.ymin), 10.3)
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=7)
    return figure


def algorithms_of(results: Results) -> dict[str, str]:
    """Return the algorithm of each trained policy, outdated ones included."""
    arms = {arm["name"]: arm["algorithm"] for arm in arms_of(results.suite)}
    old = {name: arms[policy.policy] for name, policy in results.outdated.items() if policy.policy in arms}
    return arms | old


def _limits(results: Results, names: Sequence[str]) -> list[float]:
    """Return the cost limits of some policies, rising."""
    return sorted({limit for name in names if (limit := limit_of(results, name)) is not None})


def _draw_oracle(axis: Axes, points: Sequence[FrontPoint]) -> None:
    """Draw the oracle's points with their intervals, and the line of what their mixtures attain."""
    front = front_of(points)
    axis.plot(front.cost, front.return_, color="black", linewidth=1.2, label="oracle, which knows the map")
    low = [point.return_ - point.return_low for point in points]
    high = [point.return_high - point.return_ for point in points]
    costs, returns = [point.cost for point in points], [point.return_ for point in points]
    axis.errorbar(costs, returns, yerr=[low, high], fmt=".", color="black", markersize=3, linewidth=0.7)


def _draw_point(axis: Axes, cost: Estimate, return_: Estimate, colour: str, marker: str, label: str) -> None:
    """Draw a policy with the intervals of its cost and return, as far as it has any."""
    axis.plot(cost.value, return_.value, marker=marker, color=colour, markersize=5, linestyle="none", label=label)
    style = {"color": colour, "alpha": 0.4, "linewidth": 1}
    if not np.isnan(cost.low):
        axis.plot([max(cost.low, 0.0), cost.high], [return_.value] * 2, **style)
    if not np.isnan(return_.low):
        axis.plot([cost.value] * 2, [return_.low, return_.high], **style)


def training_costs(results: Results) -> Figure | None:
    """Draw the mean cost of the last episodes over training steps, a panel for each algorithm with a line for each of
    its limits; None for the paper's task, or where no arm of the suite has a training log."""
    logs = [log for log in results.training if len(log.step)]
    if task_of(results.suite) == PAPER_TASK or not logs:
        return None
    algorithms = algorithms_of(results)
    panels = list(dict.fromkeys(algorithms[log.algorithm] for log in logs if log.algorithm in algorithms))
    if not panels:
        return None
    last = results.most_steps or int(max(log.step[-1] for log in logs))
    grid = np.linspace(last / GRID, last, GRID)
    columns = min(4, len(panels))
    rows = -(-len(panels) // columns)
    with rc_context(STYLE):
        figure = Figure(figsize=(NARROW * columns, 0.6 + 1.8 * rows))
        axes = np.atleast_2d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False))
        for axis in axes.flat[len(panels) :]:
            axis.set_visible(False)
        for axis, algorithm in zip(axes.flat, panels, strict=False):
            names = [name for name in dict.fromkeys(log.algorithm for log in logs) if algorithms.get(name) == algorithm]
            for index, name in enumerate(names):
                _draw_costs(axis, results, name, grid, line_style(index)["color"])
            axis.set_title(algorithm)
            axis.set_ylim(bottom=0)
        figure.supxlabel("steps of training", fontsize=9)
        figure.supylabel(f"cost, mean of {MEAN_EPISODES} episodes", fontsize=9)
    return figure


def _draw_costs(axis: Axes, results: Results, name: str, grid: np.ndarray, colour: str) -> None:
    """Draw the running cost of a policy's runs with a band over seeds, and its limit as a dotted line."""
    logs = [log for log in results.training if log.algorithm == name and len(log.step)]
    curves = [running_mean(log, log.cost, grid) for log in logs]
    mean, std = mean_and_std(curves)
    axis.plot(grid, mean, color=colour, linewidth=1.2)
    if len(curves) > 1:
        axis.fill_between(grid, np.maximum(mean - std, 0.0), mean + std, color=colour, alpha=0.2, linewidth=0)
    limit = limit_of(results, name)
    if limit is not None:
        axis.axhline(limit, color=colour, linewidth=0.8, linestyle=":")
