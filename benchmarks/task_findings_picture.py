"""The picture of the findings on tasks: the oracle's front of each, and where each algorithm stands at its limits."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image
from task_outcomes import LIMITLESS, Study

from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.fronts.fronts import FIXED
from thalweg.bench.report.figures import STYLE, line_style, png
from thalweg.bench.report.price_figures import MARKERS

SHADE = "0.55"
"""Grey of limits and of markers in the legend."""
COLOURS_KEPT = 256
"""Colours of the picture's palette; with 96, two algorithms had the same one."""
POINTS = 400
"""Points of the line of a front, which is bent on an axis that is not linear."""


def drawn_fronts(studies: Mapping[str, Study]) -> bytes:
    """Return a PNG with a panel for each task: fixed river of the training level, cost from 0 to the tightest limit on
    a linear axis and from there on a logarithmic one."""
    with rc_context(STYLE):
        return with_palette(png(figure_of(studies)))


def figure_of(studies: Mapping[str, Study]) -> Figure:
    """Return the figure of four tasks, in the style that is set."""
    figure = Figure(figsize=(8.0, 6.4))
    for axis, study in zip(figure.subplots(2, 2, sharey=True).flat, studies.values(), strict=True):
        _draw_study(axis, study)
    for axis in figure.axes[::2]:
        axis.set_ylabel("mean return of an episode")
    figure.legend(handles=_legend(studies), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure


def with_palette(picture: bytes) -> bytes:
    """Return a PNG with a palette, which is a third of its size."""
    written = io.BytesIO()
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(COLOURS_KEPT).save(written, "PNG", optimize=True)
    return written.getvalue()


def _draw_study(axis: Axes, study: Study) -> None:
    """Draw the panel of a task."""
    front, tightest = study.fronts[FIXED], study.limits[0]
    costs = (each.cost.value for (rivers, _, _), each in study.outcomes.items() if rivers == FIXED)
    last = max([float(front.cost[-1]), *costs])
    _draw_front(axis, study, last)
    for limit in study.limits:
        axis.axvline(limit, color=SHADE, linewidth=0.9, linestyle=":", zorder=0)
    for algorithm in study.algorithms:
        found = [each for limit in study.limits if (each := study.outcome(FIXED, algorithm, limit)) is not None]
        if not found:
            continue
        style = style_of(algorithm)
        costs, returns = [each.cost.value for each in found], [each.return_.value for each in found]
        if algorithm in LIMITLESS:
            axis.plot(costs[0], returns[0], "X", color="black", markersize=7)
            continue
        axis.plot(costs, returns, linewidth=0.8, **style)
        for each in found:
            marker = MARKERS[study.place(each.limit)]
            face = style["color"] if each.holds else "white"
            point = each.cost.value, each.return_.value
            axis.plot(*point, marker, color=style["color"], markerfacecolor=face, markersize=5.5)
            if variant := algorithm.partition("-")[2]:  # no line tells it from its algorithm where there is one limit
                axis.annotate(variant, point, (4, 3), textcoords="offset points", color=style["color"], fontsize=7)
    axis.set_xscale("symlog", linthresh=tightest, linscale=0.5)
    ticks = [0.0, *study.limits, *(each for each in (10.0, 100.0) if 1.5 * study.limits[-1] < each < 1.25 * last)]
    axis.set_xticks(ticks, labels=[f"{each:g}" for each in ticks])
    axis.minorticks_off()
    axis.set(xlim=(0.0, 1.25 * last), ylim=(0.0, 10.3), xlabel="mean cost of an episode; dotted: limits")
    axis.set_title(study.task if study.outcomes else f"{study.task}, not run yet")


def style_of(algorithm: str) -> dict[str, Any]:
    """Return colour and line style of an algorithm; one of its variants, such as `PPOLag-cnn`, is dotted."""
    names, own = list(ALGORITHMS), algorithm.partition("-")[0]
    style = line_style(names.index(own))
    return style if own == algorithm else style | {"linestyle": ":"}


def _draw_front(axis: Axes, study: Study, last: float) -> None:
    """Draw the oracle's front up to a cost, where it goes on level."""
    front = study.fronts[FIXED]
    costs = np.concatenate([np.geomspace(0.01, last, POINTS), front.cost])
    costs = np.sort(costs[costs >= front.cost[0]])
    axis.plot(costs, front.greatest_return(costs), color="black", linewidth=1.4)
    axis.plot(front.cost, front.return_, ".", color="black", markersize=3)


def _legend(studies: Mapping[str, Study]) -> list[Line2D]:
    """Return the lines of the legend: the oracle, algorithms that were flown, and markers of limits."""
    flown = {each.algorithm for study in studies.values() for each in study.outcomes.values()}
    handles = [Line2D([], [], color="black", linewidth=1.4, label="oracle, which knows the map")]
    for name in sorted(flown, key=lambda name: (list(ALGORITHMS).index(name.partition("-")[0]), name)):
        if name in LIMITLESS:
            handles.append(
                Line2D([], [], color="black", marker="X", linestyle="none", label=f"{name}, without a limit")
            )
        else:
            handles.append(Line2D([], [], linewidth=1.6, label=name, **style_of(name)))
    words = ("tight limit", "middle limit", "generous limit")
    handles += [
        Line2D([], [], color=SHADE, marker=marker, linestyle="none", label=word)
        for marker, word in zip(MARKERS, words, strict=False)
    ]
    hollow = Line2D([], [], color=SHADE, marker="o", markerfacecolor="white", linestyle="none", label="limit not held")
    return [*handles, hollow]
