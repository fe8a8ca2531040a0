"""The tables and the plot of the ladder and of the ablations, from the rows of today's versions and settings."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from any_river import LEVELS
from ladder_arms import (
    ABLATED,
    ABLATIONS,
    ARM_KEY,
    CLIMBERS,
    COMPARED,
    FIXED,
    RUNGS,
    VARIED,
    all_arms,
    whole_student,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from page_sections import replace_section
from river_flights import mean_return

from thalweg.bench.report.figures import COLOURS, STYLE, png
from thalweg.bench.report.table import frame, markdown

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, PICTURE = DOCS / "imitation-findings.md", DOCS / "images" / "ladder.png"
LADDER, ABLATION = "ladder", "ablations"
"""Sections of the page."""
NOTHING = "This has not been measured yet.\n"
SHOWN = (("seen", "Medium"), ("unseen", "Medium"), ("unseen", "Hard"), ("varied", "Medium"), ("varied", "Hard"))
"""Flights in the table of the ladder: kind and level, which all climbers have."""
PLOTTED = "Medium"
TABULATED = (*CLIMBERS, *COMPARED)
"""Lines of the table of the ladder; only climbers are plotted."""
APART = 1.08
"""Factor by which the numbers of rivers are drawn aside, so that intervals of seen and unseen rivers are told apart."""
Rows = Sequence[Mapping[str, str]]


def current_rows(rows: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the rows of today's arms, versions and settings; of the same flights, those of the longest training and
    of the most episodes."""
    arms = {(arm.name, str(arm.rivers), arm.looks, str(arm.seed)): arm for arm in all_arms()}
    found: dict[tuple[str, ...], Mapping[str, str]] = {}
    for row in rows:
        arm = arms.get((row["arm"], row["rivers"], row["looks"], row["seed"]))
        if arm is None or replace(arm, steps=int(row["steps"])).key != tuple(row[name] for name in ARM_KEY):
            continue
        same = (*(row[name] for name in ("arm", "rivers", "looks", "seed", "kind", "level")),)
        if same not in found or _extent(found[same]) < _extent(row):
            found[same] = row
    return list(found.values())


def _extent(row: Mapping[str, str]) -> tuple[int, int]:
    """Return steps and episodes of a row."""
    return int(row["steps"]), int(row["episodes"])


def selected(rows: Rows, **values: str) -> list[Mapping[str, str]]:
    """Return the rows with these values in these columns."""
    return [row for row in rows if all(row[name] == value for name, value in values.items())]


def flights_text(rows: Rows) -> str:
    """Return mean return, its interval, and share of violations over seeds as text; empty without rows."""
    if not rows:
        return ""
    return f"{mean_return(rows)}, {np.mean([float(row['violations']) for row in rows]):.1%}"


def ladder_table(rows: Rows) -> str:
    """Return the table of the ladder: a line for each climber, looks of training and number of rivers."""
    lines = []
    for climber in TABULATED:
        for looks in (FIXED, VARIED):
            group = selected(rows, arm=climber.name, looks=looks)
            for rivers in sorted({int(row["rivers"]) for row in group}):
                here = selected(group, rivers=str(rivers))
                cells = [flights_text(selected(here, kind=kind, level=level)) for kind, level in SHOWN]
                lines.append([climber.name, looks, str(rivers), *_training(here), *cells])
    heading = ["trained", "looks", "rivers", "steps", "seeds", *(f"{level}, {kind}" for kind, level in SHOWN)]
    return markdown(frame(heading, lines))


def ablation_table(rows: Rows) -> str:
    """Return the table of the ablations: a line for each student and kind of flights."""
    whole = whole_student()
    lines = []
    for name in (whole.name, *ABLATIONS):
        group = selected(rows, arm=name, rivers=str(ABLATED), looks=whole.looks, seed=str(whole.seed))
        for kind in ("unseen", "varied"):
            here = selected(group, kind=kind)
            if here:
                cells = [flights_text(selected(here, level=level)) for level in LEVELS]
                called = "the whole student" if name == whole.name else name.replace("-", " ")
                lines.append([called, kind, _training(here)[0], *cells])
    return markdown(frame(["student", "flights", "steps", *LEVELS], lines))


def _training(rows: Rows) -> tuple[str, str]:
    """Return the steps of training, and the number of seeds, of rows as text."""
    steps = sorted({int(row["steps"]) for row in rows})
    return " and ".join(f"{each:,}" for each in steps), str(len({row["seed"] for row in rows}))


def drawn_ladder(rows: Iterable[Mapping[str, str]]) -> bytes | None:
    """Return a PNG of return on seen and unseen rivers over the number of rivers; None without rows of today."""
    names = [climber.name for climber in CLIMBERS]
    shown = [row for row in selected(current_rows(rows), level=PLOTTED) if row["arm"] in names]
    if not shown:
        return None
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 2.9))
        for axes, looks in zip(figure.subplots(1, 2, sharey=True), (FIXED, VARIED), strict=True):
            for name, colour in zip(names, COLOURS, strict=False):
                for kind, style, shift in (("seen", "--", 1.0 / APART), ("unseen", "-", APART)):
                    line = selected(shown, arm=name, looks=looks, kind=kind)
                    if line:
                        _draw_line(axes, line, shift, color=colour, linestyle=style, label=f"{name}, {kind}")
            axes.set(title=f"trained under {looks} looks", xlabel=f"rivers of {PLOTTED}", ylim=(0.0, 10.3))
            axes.set_xscale("log")
            axes.set_xticks(RUNGS, labels=[str(rung) for rung in RUNGS])
            axes.minorticks_off()
        figure.axes[0].set_ylabel("return")
        handles = {str(line.get_label()): line for axes in figure.axes for line in axes.get_legend_handles_labels()[0]}
        figure.legend(handles.values(), handles.keys(), loc="outside right center", frameon=False)
        return png(figure)


def _draw_line(axes: Axes, rows: Rows, shift: float, **style: Any) -> None:
    """Draw mean returns over the number of rivers times `shift`, with intervals where there are enough seeds."""
    rivers = sorted({int(row["rivers"]) for row in rows})
    found = [mean_return(selected(rows, rivers=str(number))) for number in rivers]
    ends = np.array([(each.value - each.low, each.high - each.value) for each in found])
    axes.errorbar(
        [shift * number for number in rivers],
        [each.value for each in found],
        np.nan_to_num(ends).T,
        marker="o",
        markersize=3,
        linewidth=1.2,
        capsize=2,
        **style,
    )


def ladder_section(rows: Rows) -> str:
    """Return the section of the ladder."""
    shown = [row for row in rows if row["arm"] in [climber.name for climber in TABULATED]]
    if not shown:
        return NOTHING
    return f"![Return over the number of rivers](images/{PICTURE.name})\n\n{ladder_table(shown)}"


def written_page(page: str, rows: Iterable[Mapping[str, str]]) -> str:
    """Return the page with the sections of the ladder and of the ablations as the rows have them."""
    shown = current_rows(rows)
    lacking = [row for row in shown if row["arm"] in ABLATIONS]
    page = replace_section(page, LADDER, ladder_section(shown))
    return replace_section(page, ABLATION, ablation_table(shown) if lacking else NOTHING)
