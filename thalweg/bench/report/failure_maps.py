"""What do the rivers look like from above, and where on them does each policy fail?

The rivers are built from the levels and seeds that the results name.
"""

from collections.abc import Callable

import numpy as np
from matplotlib import rc_context
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from thalweg.bench.evaluate.episodes import REASONS, WORDS, Episode
from thalweg.bench.report.figures import REASON_COLOURS, STYLE
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import grouped
from thalweg.world import LEVELS, World, level_named, load_or_build
from thalweg.world.map_image import view

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
        handles = [Line2D([], [], marker="o", markersize=4, linestyle="", color=COLOURS[reason]) for reason in FAILED]
        words = [WORDS[reason] for reason in FAILED]
        figure.legend(handles, words, loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    return figure


def failures_on(level: str) -> Callable[[Results], Figure | None]:
    """What draws the maps of a level, if it was flown on."""

    def drawn(results: Results) -> Figure | None:
        world = _world(results, level)
        return None if world is None else failure_maps(results, level, world)

    return drawn


def levels_from_above(results: Results) -> Figure | None:
    """The orthographic view of each level's river, with a scale; None where only others were flown on."""
    worlds = {level: world for level in results.levels if (world := _world(results, level)) is not None}
    if not worlds:
        return None
    views = {level: view(world) for level, world in worlds.items()}
    tallest = max(len(picture) / len(picture[0]) for picture in views.values())
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(3.0 * len(worlds), 3.0 * tallest + 0.5))
        for axis, (level, world) in zip(np.atleast_1d(figure.subplots(1, len(worlds))), worlds.items(), strict=True):
            grid, picture = world.grid, views[level]
            rows, columns = picture.shape[:2]
            left, bottom = grid.origin_x_m, grid.origin_y_m
            extent = (left, left + columns * grid.cell_m, bottom, bottom + rows * grid.cell_m)
            axis.imshow(picture, origin="lower", extent=extent)
            axis.set_title(f"{level}: {world.river.length_m:.0f} m")
            axis.set_xticks([])
            axis.set_yticks([])
            axis.plot([left + 20.0, left + 120.0], [bottom + 20.0] * 2, color="white", linewidth=2.5)
            axis.text(left + 20.0, bottom + 28.0, "100 m", color="white", fontsize=7)
    return figure


def _world(results: Results, level: str) -> World | None:
    """The river of a level as the results name it; None if they don't, or if there is no such level."""
    seeds = {row.world_seed for row in results.episodes if row.level == level}
    if len(seeds) != 1 or level not in LEVELS:
        return None
    return load_or_build(level_named(level), seeds.pop())


def _panel(axis, world: World, rows: list[Episode]) -> None:
    """The river from above, and the ends of flights on it."""
    river = world.river
    side = 0.5 * river.width_m[:, None] * np.column_stack([-river.tangent[:, 1], river.tangent[:, 0]])
    left, right = river.position_m[:, :2] + side, river.position_m[:, :2] - side
    quads = np.stack([left, np.roll(left, -1, axis=0), np.roll(right, -1, axis=0), right], axis=1)
    pieces = quads if river.closed else quads[:-1]
    axis.add_collection(PolyCollection(list(pieces), facecolors=WATER, edgecolors=WATER, linewidths=0.3))
    for reason in FAILED:
        ends = np.array([(row.end_x, row.end_y) for row in rows if row.reason == reason]).reshape(-1, 2)
        axis.scatter(*ends.T, s=9, color=COLOURS[reason], edgecolors="#333", linewidths=0.25, zorder=3)
    axis.set_facecolor(LAND)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.margins(0.06)
