"""Time of a frame behind lenses, beside that of a pinhole with the same focal length, on one thread.

    python benchmarks/lenses.py

writes lenses.csv, a row per lens, beside this script, and ../docs/images/lenses.jpg, which shows one view through each.
Cameras take turns, so that a change of the machine's speed meets them all.
"""

import csv
import os
import statistics
import time
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.core.atomic_io import atomic_path
from thalweg.core.compute.threads import set_num_threads
from thalweg.core.machine import machine_info
from thalweg.env import sample_starts
from thalweg.render import Camera, Renderer
from thalweg.render.optics.lens import Lens
from thalweg.world import load_or_build

HERE = Path(__file__).resolve().parent
SIZE_PX, FRAMES, REPEATS = 128, 16, 15
FOV_DEG = 64.0
LENSES = {
    "none": None,
    "axis 4 and 3 pixels beside the middle": Lens(offset_x_px=4.0, offset_y_px=-3.0),
    "barrel, k1 = -0.28": Lens("plumb_bob", (-0.28, 0.07, 0.001, -0.001)),
    "pincushion, k1 = 0.3": Lens("plumb_bob", (0.3,)),
    "fisheye, 72 degrees across": Lens("equidistant", (-0.02,)),
    "fisheye, 105 degrees across": Lens("equidistant", (-0.02,)),
}
WIDER = {"fisheye, 105 degrees across": 84.0}
"""Fields of view in degrees of the pinholes with the focal lengths of lenses that have another than `FOV_DEG`."""
SHOWN, SHOWN_PX, SHOWN_POSE = ("none", "barrel, k1 = -0.28", "fisheye, 105 degrees across"), 320, 5


def cameras(size_px: int) -> dict[str, Camera]:
    """Return a camera behind each lens."""
    scale = size_px / SIZE_PX
    return {
        name: Camera(size_px, size_px, WIDER.get(name, FOV_DEG), lens=lens and _scaled(lens, scale))
        for name, lens in LENSES.items()
    }


def _scaled(lens: Lens, scale: float) -> Lens:
    """Return a lens for images with `scale` times the pixels along a side."""
    return Lens(lens.model, lens.coefficients, lens.focal_ratio, lens.offset_x_px * scale, lens.offset_y_px * scale)


def milliseconds(renderers: list[Renderer], poses: np.ndarray) -> list[tuple[float, float]]:
    """Return the least and the median time of a frame of each renderer, in turns."""
    times: list[list[float]] = [[] for _ in renderers]
    for turn in range(REPEATS + 1):
        for renderer, found in zip(renderers, times, strict=True):
            start = time.perf_counter()
            renderer.render(poses)
            if turn:  # the first one loads the kernels
                found.append((time.perf_counter() - start) / len(poses) * 1e3)
    return [(min(found), statistics.median(found)) for found in times]


def main() -> None:
    """Measure, and draw the picture."""
    set_num_threads(1)
    machine, load = machine_info(), f"{os.getloadavg()[0]:.1f}"
    world = load_or_build("Medium")
    renderers = [Renderer([world], camera) for camera in cameras(SIZE_PX).values()]
    found = milliseconds(renderers, sample_starts(world, FRAMES, 0))
    with atomic_path(HERE / "lenses.csv") as draft, draft.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(
            ["lens", "wide_height_px", "wide_width_px", "least_ms", "median_ms", "cpu_type", "vector_bits", "load"]
        )
        for name, renderer, numbers in zip(LENSES, renderers, found, strict=True):
            drawing = renderer._lens
            size = (SIZE_PX, SIZE_PX) if drawing is None else (drawing.wide.height_px, drawing.wide.width_px)
            row = [f"{number:.2f}" for number in numbers]
            out.writerow([name, *size, *row, machine["cpu_type"], machine["vector_bits"], load])
    poses = sample_starts(world, 8, 0)[[SHOWN_POSE]]
    shown = cameras(SHOWN_PX)
    views = [Renderer([world], shown[name]).render(poses)[0, ..., :3] for name in SHOWN]
    with atomic_path(HERE.parent / "docs" / "images" / "lenses.jpg") as draft:
        Image.fromarray(np.concatenate(views, axis=1)).save(draft, "JPEG", quality=88)


if __name__ == "__main__":
    main()
