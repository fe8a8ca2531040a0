"""Frames per second of the renderer by number of cameras, frame size and number of worlds.

    python benchmarks/scaling.py

writes scaling.csv and scaling.png beside this script. The first run takes about five minutes, most of which is spent
building 64 worlds. Each row names the type of the processor and the width of its vectors. `--plot` measures nothing:
it draws scaling.png from scaling.csv.
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
from thalweg.core.machine import machine_info
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
CAMERAS, SIZES, WORLDS = (1, 4, 16, 64, 256), (64, 128, 256), (1, 4, 16, 64)
DEFAULT_POINT = (16, 128, 4)
"""Cameras, pixels and worlds where they do not vary."""
SECONDS, REPEATS = 0.8, 5
NUMBERS = ("cameras", "pixels", "worlds", "frames_per_s", "least", "most")
TICKS = (50, 100, 200, 500, 1000, 2000, 5000)
"""Frames per second that are labelled in the plot."""


def points() -> list[tuple[int, int, int]]:
    """Return (cameras, pixels, worlds): cameras by sizes, then worlds with at least one camera each."""
    grid = [(count, size, DEFAULT_POINT[2]) for size in SIZES for count in CAMERAS]
    return grid + [(max(DEFAULT_POINT[0], worlds), DEFAULT_POINT[1], worlds) for worlds in WORLDS]


def rate(renderer: Renderer, worlds: list[World], cameras: int) -> tuple[float, float, float]:
    """Return the median, least and greatest frames per second over the repetitions."""
    index = np.arange(cameras) % len(worlds)
    starts = [sample_starts(world, -(-cameras // len(worlds)), 0) for world in worlds]
    poses = np.array([starts[world][camera // len(worlds)] for camera, world in enumerate(index)])
    renderer.render(poses, index)
    rates = []
    for _ in range(REPEATS):
        frames, start = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - start) < SECONDS:
            renderer.render(poses, index)
            frames += cameras
        rates.append(frames / elapsed)
    return statistics.median(rates), min(rates), max(rates)


def plot(rows: list[dict]) -> None:
    """Draw frames per second over cameras, with a line per size, and over worlds."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for size in SIZES:
        line = [row for row in rows[: len(SIZES) * len(CAMERAS)] if row["pixels"] == size]
        left.loglog([r["cameras"] for r in line], [r["frames_per_s"] for r in line], "o-", label=f"{size} x {size}")
    left.set(xlabel="cameras in one call", ylabel="frames per second", xticks=CAMERAS, xticklabels=CAMERAS)
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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", action="store_true", help="measure nothing, but draw scaling.png from scaling.csv")
    if parser.parse_args(arguments).plot:
        with (HERE / "scaling.csv").open(newline="") as file:
            plot([{name: float(row[name]) for name in NUMBERS} for row in csv.DictReader(file)])
        return
    worlds = [load_or_build("Medium", seed) for seed in range(max(WORLDS))]
    rows, renderers = [], {}
    machine = {name: machine_info()[name] for name in ("cpu_type", "vector_bits")}
    for cameras, size, count in points():
        if (size, count) not in renderers:
            renderers = {(size, count): Renderer(worlds[:count], Camera(size, size))}
        median, least, most = rate(renderers[size, count], worlds[:count], cameras)
        row = {"cameras": cameras, "pixels": size, "worlds": count}
        row |= {"frames_per_s": round(median, 1), "least": round(least, 1), "most": round(most, 1)}
        rows.append(row | machine)
        print(*rows[-1].items(), flush=True)
    with atomic_path(HERE / "scaling.csv") as draft, draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    plot(rows)


if __name__ == "__main__":
    main()
