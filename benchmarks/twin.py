"""How near is the kernel, at one sample a pixel, to the definition at 64? Over 20 poses in three rivers, at full size.

    python benchmarks/twin.py

writes twin.csv, a row per pose, and twin.png, three of them, beside itself, and fails where the figures miss what is
asked for. The definition is `thalweg/render/reference/frame.py`; each of its frames takes about half a minute, two are
drawn at a time. A row is written when its pose is finished, so that a killed run goes on where it stopped. Rows of
another version of worlds or frames (`thalweg/core/versions.py`) are dropped and drawn again.

Colours are compared by the peak signal-to-noise ratio, 10 log10(255² / mean squared difference of the codes); masks and
classes by the share of pixels where the ray through the centre meets the same thing.
"""

import argparse
import csv
import multiprocessing
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from thalweg.bench.pictures.gallery import strip
from thalweg.core import versions
from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import cache_dir
from thalweg.env import sample_starts
from thalweg.render import Camera, Frame, Renderer
from thalweg.render.reference import frame as twin
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
LEVELS = ("Easy", "Medium", "Hard")
POSES, SEED = 20, 64
"""Starts as episodes have them, one level after another, from this seed."""
CAMERA, SAMPLES = Camera(128, 128), 8
"""Samples x samples rays a pixel."""
SHOWN = len(LEVELS)
"""So many poses, the first of each level, are in the picture."""
LEAST_DB, AIM_DB = 22.0, 26.0
LEAST_MASK = 0.995
"""Mean share of a frame's pixels that agree."""
AMPLIFIED = 4
"""Differences are shown so many times as large."""


@dataclass(frozen=True)
class Case:
    """A pose to draw twice."""

    number: int
    level: str
    pose: tuple[float, float, float, float]
    """x, y, z in metres, yaw in radians."""
    time_s: float

    @property
    def identity(self) -> dict[str, str]:
        """Columns that identify the row of this case, with the versions of its world and frame."""
        given = {
            "number": self.number,
            "level": self.level,
            **dict(zip(("x", "y", "z", "yaw"), self.pose, strict=True)),
        }
        given |= {"time_s": self.time_s, "pixels": CAMERA.height_px, "samples": SAMPLES**2}
        drawn_by = {"version": versions.RENDER, "world_version": versions.WORLD}
        return {key: str(value) for key, value in (given | drawn_by).items()}

    @property
    def kept(self) -> Path:
        """Where the definition's frame is kept for the picture."""
        return cache_dir() / "twin" / f"{versions.WORLD}-{versions.RENDER}-{self.number}.npy"


@cache
def river(level: str) -> World:
    return load_or_build(level)


def cases() -> list[Case]:
    """All poses, to the millimetre and the milliradian."""
    starts = {level: sample_starts(river(level), -(-POSES // len(LEVELS)), SEED) for level in LEVELS}
    found = []
    for number in range(POSES):
        level = LEVELS[number % len(LEVELS)]
        x, y, z, yaw = starts[level][number // len(LEVELS)].round(3).tolist()
        found.append(Case(number, level, (x, y, z, yaw), 1.5 * number))
    return found


def define(case: Case) -> tuple[twin.TwinFrame, float]:
    """The frame by the definition, and the seconds it took."""
    world, begun = river(case.level), time.perf_counter()
    truth = twin.draw(world, np.array(case.pose), CAMERA, samples=SAMPLES, time_s=case.time_s)
    return truth, time.perf_counter() - begun


def draw(planned: list[Case]) -> Frame:
    """Frames [20] by the kernel."""
    renderer = Renderer([river(level) for level in LEVELS], CAMERA)
    levels = [LEVELS.index(case.level) for case in planned]
    return renderer.render_layers([case.pose for case in planned], levels, [case.time_s for case in planned])


def compare(case: Case, ours: Frame, truth: twin.TwinFrame, seconds: float) -> dict[str, str]:
    """The row of a case, from the kernel's frames [20] and the definition's one."""
    place = case.number
    squared = np.mean((ours.rgb[place].astype(float) - truth.rgb) ** 2)
    return case.identity | {
        "psnr_db": f"{10 * np.log10(255**2 / squared):.3f}",
        "mask": f"{np.mean(ours.mask[place] == truth.mask):.6f}",
        "class": f"{np.mean(ours.class_id[place] == truth.class_id):.6f}",
        "seconds": f"{seconds:.1f}",
    }


def finished(path: Path, planned: list[Case]) -> dict[int, dict[str, str]]:
    """The rows that count, by their number."""
    if not path.is_file():
        return {}
    with path.open(newline="") as file:
        rows = {row.get("number"): row for row in csv.DictReader(file)}
    counted = {}
    for case in planned:
        row = rows.get(str(case.number), {})
        if case.identity.items() <= row.items() and (case.number >= SHOWN or case.kept.is_file()):
            counted[case.number] = row
    print(
        f"{len(counted)} of {POSES} poses are finished; {len(rows) - len(counted)} rows are of another picture",
        flush=True,
    )
    return counted


def write(path: Path, rows: dict[int, dict[str, str]]) -> None:
    """The table, in the order of the numbers."""
    ordered = [rows[number] for number in sorted(rows)]
    with atomic_path(path) as draft, draft.open("w", newline="") as file:
        writer = csv.DictWriter(file, ordered[0])
        writer.writeheader()
        writer.writerows(ordered)


def show(path: Path, planned: list[Case], ours: Frame, rows: dict[int, dict[str, str]]) -> None:
    """The picture: a strip for each of the first poses, as far as they are finished."""
    strips = []
    for case in planned[:SHOWN]:
        if case.number not in rows:
            continue
        frame, truth = ours.rgb[case.number], np.load(case.kept)
        apart = np.minimum(AMPLIFIED * np.abs(frame.astype(int) - truth), 255).astype(np.uint8)
        row = rows[case.number]
        title = f"{case.level}: kernel, definition, {AMPLIFIED} x difference; {row['psnr_db']} dB"
        strips.append(strip(title, np.stack([frame, truth, apart]).repeat(2, axis=1).repeat(2, axis=2)))
    width, height = strips[0].size
    picture = Image.new("RGB", (width, height * len(strips)), "white")
    for place, image in enumerate(strips):
        picture.paste(image, (0, place * height))
    with atomic_path(path) as draft:
        picture.save(draft, optimize=True)


def verdict(rows: dict[int, dict[str, str]]) -> str | None:
    """Prints the figures; returns what is wrong with them."""
    decibels = [float(row["psnr_db"]) for row in rows.values()]
    masks, kinds = ([float(row[name]) for row in rows.values()] for name in ("mask", "class"))
    mean, mask = statistics.mean(decibels), statistics.mean(masks)
    print(
        f"{len(rows)} poses: {mean:.2f} dB (least {min(decibels):.2f}, aim {AIM_DB:.0f}, must {LEAST_DB:.0f}); masks"
        f" agree on {mask:.3%} (least {min(masks):.3%}, must {LEAST_MASK:.1%}), classes on {statistics.mean(kinds):.2%}"
    )
    return None if mean >= LEAST_DB and mask >= LEAST_MASK else "kernel and definition are further apart than allowed"


def main() -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=POSES, help="draw only the first so many now")
    parser.add_argument("--processes", type=int, default=2, help="frames drawn at a time")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for twin.csv and twin.png")
    chosen = parser.parse_args()
    if not 1 <= chosen.poses <= POSES or chosen.processes < 1:
        parser.error(f"--poses must be 1 to {POSES}, --processes at least 1")
    planned = cases()
    ours = draw(planned)
    rows = finished(chosen.out / "twin.csv", planned)
    # Spawned, since threads of the kernel's run here; the kernel's frames are drawn, for the workers need no kernel.
    with ProcessPoolExecutor(chosen.processes, multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(define, case): case for case in planned[: chosen.poses] if case.number not in rows}
        for done in as_completed(waiting):
            case, (truth, seconds) = waiting[done], done.result()
            if case.number < SHOWN:
                with atomic_path(case.kept) as draft:
                    np.save(draft, truth.rgb)
            rows[case.number] = compare(case, ours, truth, seconds)
            write(chosen.out / "twin.csv", rows)
            print(
                case.number, case.level, *(f"{key} {rows[case.number][key]}" for key in ("psnr_db", "mask", "seconds"))
            )
    show(chosen.out / "twin.png", planned, ours, rows)
    return verdict(rows)


if __name__ == "__main__":
    sys.exit(main())
