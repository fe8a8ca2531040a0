"""Where on the river does each policy fail? A map for each policy and level, with a mark where a flight ended."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from thalweg.bench.episodes import REASONS, WORDS, Episode
from thalweg.bench.figures import REASON_COLOURS, STYLE
from thalweg.bench.results import Results
from thalweg.bench.statistics import grouped
from thalweg.world import World

WATER, LAND = "#bcd7e6", "#eef0e6"
COLUMNS = 4
FAILED = [reason for reason in REASONS if reason != "Success"]
COLOURS = dict(zip(REASONS, REASON_COLOURS, strict=True))


def failure_maps(results: Results, level: str, world: World) -> Figure | None:
    """One panel for each policy that learnt and flew on the level: its river, and a dot where a flight ended without
    success; None where results do not say where flights ended."""
    blind = results.suite.get("baselines", [])
    every = grouped(results.episodes)
    flown = {name: rows for (name, where), rows in every.items() if where == level and name not in blind}
    kept = {name: rows for name, rows in flown.items() if not np.isnan([row.end_x for row in rows]).any()}
    if not kept:
        return None
    lines = -(-len(kept) // COLUMNS)
    east, north = (np.ptp(world.river.position_m[:, axis]) + 60.0 for axis in (0, 1))
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(9.0, 0.7 + lines * (0.3 + 2.2 * min(max(north / east, 0.35), 1.6))))
        axes = np.atleast_1d(figure.subplots(lines, COLUMNS, squeeze=False)).ravel()
        for axis in axes[len(kept) :]:
            axis.set_visible(False)
        for axis, (name, rows) in zip(axes, kept.items(), strict=False):
            _panel(axis, world, rows)
            failed = sum(not row.success for row in rows)
            axis.set_title(f"{name}: {failed} of {len(rows)} failed", fontsize=8)
        handles = [Figure().add_subplot().scatter([], [], color=COLOURS[reason], s=14) for reason in FAILED]
        words = [WORDS[reason] for reason in FAILED]
        figure.legend(handles, words, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure


def _panel(axis, world: World, rows: list[Episode]) -> None:
    """The river from above, and the ends of flights on it."""
    river = world.river
    side = 0.5 * river.width_m[:, None] * np.column_stack([-river.tangent[:, 1], river.tangent[:, 0]])
    left, right = river.position_m[:, :2] + side, river.position_m[:, :2] - side
    for one, two in zip(range(len(left)), [*range(1, len(left)), 0], strict=True):
        if two or river.closed:
            axis.add_patch(Polygon([left[one], left[two], right[two], right[one]], color=WATER, linewidth=0.3))
    for reason in FAILED:
        ends = np.array([(row.end_x, row.end_y) for row in rows if row.reason == reason]).reshape(-1, 2)
        axis.scatter(*ends.T, s=9, color=COLOURS[reason], edgecolors="#333", linewidths=0.25, zorder=3)
    axis.set_facecolor(LAND)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.margins(0.06)
