"""Maps of the rivers from above, and of where on them each policy failed.

The rivers are built from the levels and seeds that the results name.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from thalweg.bench.evaluate.episodes import REASON_TEXT, Episode
from thalweg.bench.evaluate.rivers import RIVERS
from thalweg.bench.report.figures import REASON_COLOURS, STYLE
from thalweg.bench.results.results import Results
from thalweg.bench.results.statistics import group_episodes
from thalweg.world import LEVELS, World, WorldError, level_named, load_or_build
from thalweg.world.bridges import deck
from thalweg.world.islands import outline
from thalweg.world.map_image import DECK, view

WATER, LAND, SHORE, RAIL = "#bcd7e6", "#eef0e6", "#9aa58b", "#7a6f58"
COLUMNS = 4


def failure_maps(results: Results, level: str, world: World) -> Figure | None:
    """Draw one panel for each policy, other than baselines, that flew on the level: its river, and a dot where an
    episode ended without success.

    Returns None where the results do not record where episodes ended.
    """
    baselines = results.suite.get("baselines", [])
    groups = group_episodes(results.episodes)
    on_level = {name: rows for (name, river), rows in groups.items() if river == level and name not in baselines}
    panels = {name: rows for name, rows in on_level.items() if not np.isnan([row.end_x for row in rows]).any()}
    if not panels:
        return None
    failures = [reason for reason in results.reasons if reason != "Success"]
    lines = -(-len(panels) // COLUMNS)
    east, north = (np.ptp(world.river.position_m[:, axis]) + 60.0 for axis in (0, 1))
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(9.0, 0.7 + lines * (0.3 + 2.2 * min(max(north / east, 0.35), 1.6))))
        axes = np.atleast_1d(figure.subplots(lines, COLUMNS, squeeze=False)).ravel()
        for axis in axes[len(panels) :]:
            axis.set_visible(False)
        for axis, (name, rows) in zip(axes, panels.items(), strict=False):
            _draw_panel(axis, world, rows, failures)
            failed = sum(not row.success for row in rows)
            axis.set_title(f"{name}: {failed} of {len(rows)} failed", fontsize=8)
        handles: list[Artist] = [
            Line2D([], [], marker="o", markersize=4, linestyle="", color=REASON_COLOURS[reason]) for reason in failures
        ]
        labels = [REASON_TEXT[reason] for reason in failures]
        for name, face, edge, shown in (("bridge", DECK, RAIL, world.bridges), ("island", LAND, SHORE, world.islands)):
            if len(shown):
                handles.append(Patch(facecolor=face, edgecolor=edge, linewidth=0.5))
                labels.append(name)
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=8)
    return figure


def failures_on(level: str) -> Callable[[Results], Figure | None]:
    """Return a function that draws the maps of a level, or None where nothing was flown on it."""

    def draw(results: Results) -> Figure | None:
        world = _world(results, level)
        return None if world is None else failure_maps(results, level, world)

    return draw


def levels_from_above(results: Results) -> Figure | None:
    """Draw the orthographic view of each level's river, with a scale; None where only other rivers were flown."""
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
            edge = [withStroke(linewidth=2.0, foreground="#10202a")]
            ends = [left + 20.0, left + 120.0]
            axis.plot(ends, [bottom + 20.0] * 2, color="white", linewidth=2.5, path_effects=edge)
            axis.text(ends[1] + 8.0, bottom + 20.0, "100 m", color="white", fontsize=7, va="center", path_effects=edge)
    return figure


def _world(results: Results, level: str) -> World | None:
    """Return the river of a level, or a real one of the package, with the seed that the results name; None for several
    seeds, and for an unknown level or the river of a file, which does not lie among the results."""
    seeds = {row.world_seed for row in results.episodes if row.level == level}
    if len(seeds) != 1:
        return None
    if level.partition("+")[0] in LEVELS:
        try:
            known = level_named(level)
        except WorldError:  # another version knows these banks
            return None
        return load_or_build(known, seeds.pop())
    recorded = {key: each for key, each in results.suite.get("rivers", {}).get(level, {}).items() if key != "has_banks"}
    reach = RIVERS.get(level)
    return reach.build(seeds.pop()) if reach is not None and reach.as_data() == recorded else None


def _draw_panel(axis, world: World, rows: list[Episode], failures: Sequence[str]) -> None:
    """Draw the river from above with its islands and bridges, and on it the ends of episodes with one of the
    `failures`."""
    river = world.river
    side = 0.5 * river.width_m[:, None] * np.column_stack([-river.tangent[:, 1], river.tangent[:, 0]])
    left, right = river.position_m[:, :2] + side, river.position_m[:, :2] - side
    quads = np.stack([left, np.roll(left, -1, axis=0), np.roll(right, -1, axis=0), right], axis=1)
    pieces = quads if river.closed else quads[:-1]
    axis.add_collection(PolyCollection(list(pieces), facecolors=WATER, edgecolors=WATER, linewidths=0.3))
    shores = [outline(island) for island in world.islands]
    axis.add_collection(PolyCollection(shores, facecolors=LAND, edgecolors=SHORE, linewidths=0.5, label="islands"))
    decks = [deck(bridge) for bridge in world.bridges]
    axis.add_collection(PolyCollection(decks, facecolors=DECK, edgecolors=RAIL, linewidths=0.5, label="bridges"))
    for reason in failures:
        ends = np.array([(row.end_x, row.end_y) for row in rows if row.reason == reason]).reshape(-1, 2)
        axis.scatter(*ends.T, s=9, color=REASON_COLOURS[reason], edgecolors="#333", linewidths=0.25, zorder=3)
    axis.set_facecolor(LAND)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.margins(0.06)
