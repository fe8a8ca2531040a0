"""How does rendering grow? Frames a second by number of cameras, size of the frame and number of worlds.

`python benchmarks/scaling.py` writes scaling.csv and scaling.png beside itself; it takes about five minutes, most of
them to build 64 worlds on the first run. `--plot` only draws scaling.png from scaling.csv again.
"""

import argparse
import csv
import statistics
import time
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
CAMERAS, SIZES, WORLDS = (1, 4, 16, 64, 256), (64, 128, 256), (1, 4, 16, 64)
USUAL = (16, 128, 4)
"""Cameras, pixels and worlds of a point where only one of them varies."""
SECONDS, REPEATS = 0.8, 5
TICKS = (100, 200, 500, 1000, 2000, 5000)
"""Frames a second that the plot names."""


def points() -> list[tuple[int, int, int]]:
    """(cameras, pixels, worlds): cameras by sizes in the usual worlds, then worlds with as many cameras."""
    grid = [(count, size, USUAL[2]) for size in SIZES for count in CAMERAS]
    return grid + [(max(USUAL[0], worlds), USUAL[1], worlds) for worlds in WORLDS]


def rate(renderer: Renderer, worlds: list[World], cameras: int) -> tuple[float, float, float]:
    """Frames a second: the median, least and greatest of the repeats."""
    index = np.arange(cameras) % len(worlds)
    starts = [sample_starts(world, -(-cameras // len(worlds)), 0) for world in worlds]
    poses = np.array([starts[world][place // len(worlds)] for place, world in enumerate(index)])
    renderer.render(poses, index)
    found = []
    for _ in range(REPEATS):
        frames, begun = 0, time.perf_counter()
        while (passed := time.perf_counter() - begun) < SECONDS:
            renderer.render(poses, index)
            frames += cameras
        found.append(frames / passed)
    return statistics.median(found), min(found), max(found)


def plot(rows: list[dict]) -> None:
    """Cameras against frames a second, a line per size, and worlds against frames a second."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for size in SIZES:
        line = [row for row in rows[: len(SIZES) * len(CAMERAS)] if row["pixels"] == size]
        left.loglog([r["cameras"] for r in line], [r["frames_per_s"] for r in line], "o-", label=f"{size} x {size}")
    left.set(xlabel="cameras in one call", ylabel="frames a second", xticks=CAMERAS, xticklabels=CAMERAS)
    left.set(yticks=TICKS, yticklabels=TICKS, ylim=(TICKS[0], TICKS[-1]))
    left.legend(loc="upper center", ncols=len(SIZES))
    line = rows[len(SIZES) * len(CAMERAS) :]
    right.semilogx([r["worlds"] for r in line], [r["frames_per_s"] for r in line], "o-")
    right.set(xlabel="worlds drawn from, 128 x 128", xticks=WORLDS, xticklabels=WORLDS)
    right.set_ylim(0, 1.1 * max(r["most"] for r in line))
    for axes in (left, right):
        axes.minorticks_off()
        axes.grid(alpha=0.3)
    with atomic_path(HERE / "scaling.png") as draft:
        figure.savefig(draft, dpi=110)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", action="store_true", help="draw scaling.png from scaling.csv again")
    if parser.parse_args(arguments).plot:
        with (HERE / "scaling.csv").open(newline="") as file:
            plot([{name: float(number) for name, number in row.items()} for row in csv.DictReader(file)])
        return
    worlds = [load_or_build("Medium", seed) for seed in range(max(WORLDS))]
    rows, renderers = [], {}
    for cameras, size, count in points():
        if (size, count) not in renderers:
            renderers = {(size, count): Renderer(worlds[:count], Camera(size, size))}
        median, least, most = rate(renderers[size, count], worlds[:count], cameras)
        row = {"cameras": cameras, "pixels": size, "worlds": count}
        rows.append(row | {"frames_per_s": round(median, 1), "least": round(least, 1), "most": round(most, 1)})
        print(*rows[-1].items(), flush=True)
    with atomic_path(HERE / "scaling.csv") as draft, draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    plot(rows)


if __name__ == "__main__":
    main()
