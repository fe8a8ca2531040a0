"""Learning curves of both libraries: returns above and costs below, with the mean and range over the seeds.

    python -m benchmarks.omnisafe.plot

draws curves.png from curves.csv; `compare.py` does so at its end, too.
"""

import csv
from collections import defaultdict
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from benchmarks.omnisafe.contests import CONTESTS, LIMIT
from thalweg.core.atomic_io import atomic_path

HERE = Path(__file__).resolve().parent
COLOURS = {"OmniSafe": "#d95f02", "Thalweg": "#1b6ca8"}
ACROSS = 5
"""Number of columns."""
MEASURES = {"return": "return", "cost": "falls per episode"}
TOPS = (8.0, 0.65)
"""Least upper ends of the axes, so that most of them agree."""

Curves = dict[tuple[str, str], dict[int, dict[int, dict[str, float]]]]
"""Return, cost and episodes of each interval, by algorithm and side, then seed, then last step."""


def read(file: Path) -> Curves:
    """Read the table that `compare.py` writes."""
    curves: Curves = defaultdict(lambda: defaultdict(dict))
    with file.open(newline="") as text:
        for row in csv.DictReader(text):
            numbers = {name: float(row[name]) for name in (*MEASURES, "episodes")}
            curves[row["algorithm"], row["side"]][int(row["seed"])][int(row["step"])] = numbers
    return curves


def read_versions(file: Path) -> dict[str, int]:
    """Return the version of each of Thalweg's algorithms that the table was made with."""
    with file.open(newline="") as text:
        return {row["algorithm"]: int(row["version"]) for row in csv.DictReader(text) if row["version"]}


def band(seeds: dict[int, dict[int, dict[str, float]]], measure: str) -> np.ndarray:
    """Return [4, steps]: step, mean, least and greatest, at the steps that all seeds have."""
    steps = sorted(set.intersection(*(set(points) for points in seeds.values())))
    values = np.array([[points[step][measure] for step in steps] for points in seeds.values()])
    return np.stack([steps, values.mean(0), values.min(0), values.max(0)])


def draw(table: Path, figure: Path) -> None:
    """Draw the figure of a table."""
    curves = read(table)
    names = [contest.algorithm for contest in CONTESTS if any(key[0] == contest.algorithm for key in curves)]
    across = min(ACROSS, len(names))
    down = -(-len(names) // across)
    size = (2.9 * across + 0.6, 4.4 * down + 0.4)
    plots, axes = plt.subplots(2 * down, across, figsize=size, squeeze=False, layout="constrained")
    for index in range(down * across):
        column, pair = index % across, axes[2 * (index // across) :][:2, index % across]
        if index >= len(names):
            for axis in pair:
                axis.set_axis_off()
            continue
        pair[0].set_title(names[index])
        for axis, measure in zip(pair, MEASURES, strict=True):
            draw_one(axis, curves, names[index], measure)
            if not column:
                axis.set_ylabel(MEASURES[measure])
        pair[1].set_xlabel("thousand steps")
        pair[1].axhline(LIMIT, color="black", linewidth=0.8, linestyle=":")
        for axis, least in zip(pair, TOPS, strict=True):
            axis.set_ylim(0, max(least, axis.get_ylim()[1]))
    axes[0, 0].legend(frameon=False, loc="lower right")
    with atomic_path(figure) as draft:
        plots.savefig(draft, dpi=110, format="png")
    plt.close(plots)


def draw_one(axis: Axes, curves: Curves, algorithm: str, measure: str) -> None:
    """Draw both sides of one algorithm."""
    for side, colour in COLOURS.items():
        if (algorithm, side) not in curves:
            continue
        steps, mean, least, greatest = band(curves[algorithm, side], measure)
        axis.plot(steps / 1000, mean, color=colour, label=side)
        axis.fill_between(steps / 1000, least, greatest, color=colour, alpha=0.2, linewidth=0)
    axis.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    draw(HERE / "curves.csv", HERE / "curves.png")
