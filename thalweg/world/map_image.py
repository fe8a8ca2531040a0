"""A picture of a world from straight above, with its course, banks, bridges and islands.

It is for choosing and checking rivers; camera frames are the task of `thalweg.render`.
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke

from thalweg.core.atomic_io import atomic_path
from thalweg.world.bridges import deck
from thalweg.world.islands import outline
from thalweg.world.noise import fractal, smooth_step
from thalweg.world.record import World
from thalweg.world.species import KINDS

f4 = np.float32

SUN = np.array((1.30, 1.24, 1.12), np.float32)
SKY = np.array((0.30, 0.36, 0.46), np.float32)
"""Light of the sun and the sky on the map, linear."""
STONE = np.array((0.40, 0.35, 0.28), np.float32)
DEEP = np.array((0.030, 0.075, 0.105), np.float32)
"""Linear colours of the bridges and of deep water."""
LEAF_GAIN = 1.2
"""Brightness of leaves with transmitted light, relative to reflection alone."""
ABSORPTION_PER_M = np.array((1.1, 0.75, 0.62), np.float32)
CANOPY_ALPHA = 0.8
"""Opacity of the canopy over the ground."""
EXPOSURE = 1.25
DPI = 100
SHARES, FIXED_PX = (0.055, 0.045), (12, 10)
"""Heights of the title above the map and of the legend below it: a share of the longer side, and pixels."""
SOLIDS, MARKERS = 4, 5
"""Drawing order: the markers on the centre line go over the bridges, which would hide them."""
BARS_M, BAR_SHARE = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0), 0.3
"""Lengths of scale bars, and the greatest share of a map's width that one takes."""
MARKER_SPACING_M = 50.0
"""Distance between the markers on the centre line."""
DECK = "#cbbfa8"
"""Colour of the decks of bridges."""
BANK, CENTRE, BRIDGE, ISLAND = "#7fe3ff", "#ffffff", "#e4572e", "#ffb000"
"""Colours of the lines over the map."""


def draw(world: World, path: str | Path, *, size_px: int = 1200) -> None:
    """Write the orthographic view of a world to a PNG file atomically; its longer side has `size_px` pixels.

    Raises `ValueError` for a picture too small to read.
    """
    if size_px < 300:
        raise ValueError(f"a map needs at least 300 pixels, not {size_px}")
    figure = _figure(world, size_px)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        FigureCanvasAgg(figure).print_png(file)


def size_in_scale(world: World, px_per_m: float) -> int:
    """Return the `size_px` with which `draw` shows a metre in so many pixels."""
    rows, columns = (count * world.grid.cell_m * px_per_m for count in world.ground_m.shape)
    return round(max((rows + sum(FIXED_PX)) / (1.0 - sum(SHARES)), columns))


def view(world: World) -> np.ndarray:
    """Return [GY, GX, 3] uint8 sRGB: ground, water and forest in the baked light, seen from above.

    The first row is the southernmost.
    """
    ground = _lit((world.albedo / f4(255.0)) ** 2, world)
    depth = (world.water_m - world.ground_m)[..., None]
    cleared = ground * np.exp(-np.maximum(depth, 0.0) * ABSORPTION_PER_M)
    water = f4(0.55) * cleared + DEEP * (f4(0.35) + f4(0.65) * world.sun[..., None] / f4(255.0))
    colour = np.where(depth > 0.0, water, ground)
    rise = world.canopy_m - np.maximum(world.ground_m, world.water_m)
    share = f4(CANOPY_ALPHA) * smooth_step(0.3, 2.5, rise)
    colour += share[..., None] * (_roof(world) - colour)
    linear = np.clip(f4(EXPOSURE) * colour, 0.0, None)
    linear = linear * (f4(1.0) + linear / f4(4.0)) / (f4(1.0) + linear)
    coded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return np.rint(np.clip(coded, 0.0, 1.0) * 255.0).astype(np.uint8)


def _lit(reflectance: np.ndarray, world: World) -> np.ndarray:
    """Return the radiance [GY, GX, 3] of a reflectance [GY, GX, 3] under the baked sun and sky."""
    sun = world.sun[..., None] / f4(255.0) * f4(math.sin(world.sun_elevation)) * SUN
    return reflectance * (sun + world.sky[..., None] / f4(255.0) * SKY)


def _roof(world: World) -> np.ndarray:
    """Return [GY, GX, 3] float32 the colour of the forest's canopy, shaded by its slope towards the sun."""
    leaves = fractal(world.ground_m.shape, world.grid.cell_m, 1.6, 3, np.random.default_rng(0), gain=0.8)
    north, east = np.gradient(world.canopy_m + f4(0.12) * leaves, f4(world.grid.cell_m))
    flat = math.cos(world.sun_elevation)
    toward = flat * math.cos(world.sun_azimuth) * -east + flat * math.sin(world.sun_azimuth) * -north
    facing = np.clip((toward + math.sin(world.sun_elevation)) / np.sqrt(1.0 + east**2 + north**2), 0.0, 1.0)
    light = facing[..., None].astype(np.float32) * SUN + f4(0.5) * SKY
    return _leaf_colours(world) * np.exp(f4(0.10) * leaves)[..., None] * light


def _leaf_colours(world: World) -> np.ndarray:
    """Return [GY, GX, 3] float32 the reflectance of the highest plant over each node, else of a bridge."""
    rows, columns = world.ground_m.shape
    grid, plants = world.grid, world.plants
    leaves = f4(LEAF_GAIN) * np.array([kind.leaf_reflectance for kind in KINDS], np.float32)
    colour = np.tile(STONE, (rows, columns, 1))
    highest = np.full((rows, columns), -np.inf, np.float32)
    tops = plants.position_m[:, 2] + plants.height_m
    column = (plants.position_m[:, 0] - grid.origin_x_m) / grid.cell_m
    row = (plants.position_m[:, 1] - grid.origin_y_m) / grid.cell_m
    radius = 0.5 * plants.width_m / grid.cell_m
    for m in range(len(tops)):
        i0, i1 = max(math.ceil(row[m] - radius[m]), 0), min(math.floor(row[m] + radius[m]) + 1, rows)
        j0, j1 = max(math.ceil(column[m] - radius[m]), 0), min(math.floor(column[m] + radius[m]) + 1, columns)
        away = (np.arange(i0, i1)[:, None] - row[m]) ** 2 + (np.arange(j0, j1)[None, :] - column[m]) ** 2
        top = tops[m] - plants.height_m[m] * away / max(radius[m], 0.5) ** 2
        higher = (top > highest[i0:i1, j0:j1]) & (away < radius[m] ** 2)
        highest[i0:i1, j0:j1][higher] = top[higher]
        colour[i0:i1, j0:j1][higher] = leaves[plants.kind[m]] * plants.tint[m]
    return colour


def _figure(world: World, size_px: int) -> Figure:
    """Return the complete page: map, markers, title and legend."""
    rows, columns = world.ground_m.shape
    top, bottom = (share * size_px + fixed for share, fixed in zip(SHARES, FIXED_PX, strict=True))
    scale = min((size_px - top - bottom) / rows, size_px / columns)
    width, height = columns * scale, rows * scale
    figure = Figure(figsize=(width / DPI, (height + top + bottom) / DPI), dpi=DPI, facecolor="#14181c")
    page = height + top + bottom
    axes = figure.add_axes((0.0, bottom / page, 1.0, height / page))
    axes.set_axis_off()
    cell = world.grid.cell_m
    west, south = world.grid.origin_x_m - 0.5 * cell, world.grid.origin_y_m - 0.5 * cell
    box = (west, west + columns * cell, south, south + rows * cell)
    axes.imshow(view(world), origin="lower", extent=box, interpolation="antialiased")
    point = size_px / 1200
    _draw_course(axes, world, point)
    _draw_solids(axes, world, point)
    _draw_scale_and_north(axes, world, box, point)
    _write_title(figure, world, 1.0 - 0.5 * top / page, width, point)
    _write_legend(figure, world, 0.5 * bottom / page, width, point)
    return figure


def _draw_course(axes, world: World, point: float) -> None:
    """Draw the centre line with a marker every 50 m and an arrow at its start, and both banks."""
    river = world.river
    normal = np.stack([-river.tangent[:, 1], river.tangent[:, 0]], axis=1)
    half = 0.5 * river.width_m[:, None]
    ends = [0] if river.closed else []
    for side in (river.position_m + half * normal, river.position_m - half * normal):
        axes.plot(*np.concatenate([side, side[ends]]).T, color=BANK, lw=1.1 * point, alpha=0.9, solid_joinstyle="round")
    line = np.concatenate([river.position_m, river.position_m[ends]])
    axes.plot(*line.T, color=CENTRE, lw=1.3 * point, ls=(0, (6, 3)), alpha=0.95)
    arc = np.concatenate([river.arc_m, [river.length_m] * len(ends)])
    edge = [withStroke(linewidth=2.5 * point, foreground="#10202a")]
    for distance in np.arange(MARKER_SPACING_M, river.length_m, MARKER_SPACING_M):
        point_m = np.array([np.interp(distance, arc, line[:, 0]), np.interp(distance, arc, line[:, 1])])
        axes.plot(*point_m, "o", ms=4.0 * point, color=CENTRE, mec="#10202a", mew=0.8 * point, zorder=MARKERS)
        axes.annotate(
            f"{distance:.0f}",
            point_m,
            xytext=(5 * point, 4 * point),
            textcoords="offset points",
            color=CENTRE,
            fontsize=8.5 * point,
            path_effects=edge,
            zorder=MARKERS,
        )
    start, ahead = river.position_m[0], river.position_m[0] + 7.0 * river.tangent[0]
    arrow = {
        "arrowstyle": "-|>",
        "color": CENTRE,
        "lw": 2.0 * point,
        "mutation_scale": 16 * point,
        "path_effects": edge,
    }
    axes.annotate("", ahead, xytext=start, arrowprops=arrow, zorder=MARKERS)
    axes.plot(*start, "s", ms=6.0 * point, color=CENTRE, mec="#10202a", mew=1.0 * point, zorder=MARKERS)


def _draw_solids(axes, world: World, point: float) -> None:
    """Draw the decks of the bridges and the edges of the islands."""
    for bridge in world.bridges:
        axes.add_patch(
            Polygon(deck(bridge), facecolor=DECK, edgecolor=BRIDGE, lw=1.8 * point, alpha=0.9, zorder=SOLIDS)
        )
    for island in world.islands:
        axes.add_patch(Polygon(outline(island), fill=False, edgecolor=ISLAND, lw=1.6 * point, zorder=SOLIDS))


def _draw_scale_and_north(axes, world: World, box: tuple[float, float, float, float], point: float) -> None:
    """Draw a scale bar with its length at its end, an arrow to the north, and the direction of the sun."""
    west, east, south, north = box
    length = max(metres for metres in BARS_M if metres <= max(BAR_SHARE * (east - west), BARS_M[0]))
    x, y = west + 0.03 * (east - west), south + 0.03 * (north - south)
    edge = [withStroke(linewidth=3.0 * point, foreground="#10202a")]
    text = {"color": "white", "fontsize": 10 * point, "path_effects": edge, "ha": "center"}
    high = 0.007 * (north - south)
    for part, colour in enumerate(("white", "#222222")):
        corner = (x + 0.5 * part * length, y - 0.5 * high)
        axes.add_patch(Rectangle(corner, 0.5 * length, high, fc=colour, ec="white", lw=point, path_effects=edge))
    for metres, label in ((0.0, "0"), (length, f"{length:.0f} m")):
        axes.text(x + metres, y + high, label, va="bottom", **text)
    x, y, size = east - 0.05 * (east - west), south + 0.04 * (north - south), 0.06 * (north - south)
    arrow = {
        "arrowstyle": "-|>",
        "color": "white",
        "lw": 2.2 * point,
        "mutation_scale": 18 * point,
        "path_effects": edge,
    }
    axes.annotate("", (x, y + size), xytext=(x, y), arrowprops=arrow)
    axes.text(x, y + 1.05 * size, "N", va="bottom", weight="bold", **text)
    toward = 0.5 * size * np.array([math.cos(world.sun_azimuth), math.sin(world.sun_azimuth)])
    middle = np.array([x - 1.6 * size, y + 0.5 * size])
    sun = {"arrowstyle": "-", "color": "#ffd75e", "lw": 1.8 * point, "path_effects": edge}
    axes.annotate("", middle + toward, xytext=middle - toward, arrowprops=sun)
    axes.plot(*(middle + toward), "o", ms=8 * point, color="#ffd75e", mec="#10202a")
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)


def short_name(world: World) -> str:
    """Return the name of a world, with the kinds of its banks alone where it names reaches, which would be too long."""
    base, plus, _ = world.name.partition("+")
    kinds = list(dict.fromkeys(reach.kind for reach in world.banks))
    return "+".join([base, *kinds]) if plus and kinds else world.name


def _write_title(figure: Figure, world: World, height: float, width: float, point: float) -> None:
    """Write the name, seed and figures of the course; on a narrow map the figures go under the name."""
    river = world.river
    shape = "loop" if river.closed else "open course"
    narrow = width < 1000.0 * point
    size = min(1.0, width / (880.0 * point)) * point
    name = f"{short_name(world)}, seed {world.seed}"
    facts = (
        f"{shape} of {river.length_m:.1f} m, N = {river.segments}, "
        f"width {river.width_m.min():.1f} to {river.width_m.max():.1f} m, "
        f"depth {river.depth_m.min():.1f} to {river.depth_m.max():.1f} m, "
        f"fall {np.ptp(river.level_m):.1f} m, {len(world.plants.kind):,} plants"
    )
    line = 13.0 * point / figure.bbox.height if narrow else 0.0
    bold = {"fontsize": 17 * point, "weight": "bold", "parse_math": False}
    figure.text(0.02, height + line, name, color="white", va="center", **bold)
    x, side = (0.02, "left") if narrow else (0.98, "right")
    figure.text(x, height - line, facts, color="#c8d0d8", fontsize=10.5 * size, va="center", ha=side)


def _write_legend(figure: Figure, world: World, height: float, width: float, point: float) -> None:
    """Write the meaning of lines and colours in one row, smaller on a narrow map."""
    size = min(1.0, width / (850.0 * point)) * point
    entries = [
        Line2D([], [], color=CENTRE, ls=(0, (4, 2)), lw=1.5, label="centre line, markers every 50 m"),
        Line2D([], [], color=BANK, lw=1.5, label="banks (width)"),
        Patch(facecolor=DECK, edgecolor=BRIDGE, label=f"bridges ({len(world.bridges)})"),
        Patch(facecolor="none", edgecolor=ISLAND, label=f"islands ({len(world.islands)})"),
        Line2D([], [], color="#ffd75e", marker="o", lw=1.5, label="towards the sun"),
    ]
    figure.legend(
        handles=entries,
        loc="center",
        bbox_to_anchor=(0.5, height),
        ncols=len(entries),
        frameon=False,
        labelcolor="white",
        fontsize=9.0 * size,
        columnspacing=1.4,
        handlelength=1.8,
    )
