"""Accuracy of the renderer at one sample per pixel against the reference renderer at 64, over 20 poses in three rivers.

    python benchmarks/reference_accuracy.py

writes reference_accuracy.csv, a row per pose, and reference_accuracy.png, which shows three of them, beside itself. It
fails if the accuracy is below the required one. The reference is `thalweg/render/reference/frame.py`; each of its
frames takes about half a minute, and two are drawn in parallel. A row is written when its pose is finished, so that an
interrupted run resumes where it stopped. Rows of another version of worlds or frames (`thalweg/core/versions.py`) are
dropped and drawn again.

Colours are compared by the peak signal-to-noise ratio, 10 log10(255² / mean squared difference of the codes); masks and
classes by the share of pixels whose central ray hits the same thing.
"""

import argparse
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
from tables import Rows, change, rows_of

from thalweg.bench.pictures.gallery import strip
from thalweg.core import versions
from thalweg.core.atomic_io import atomic_path
from thalweg.core.cache import cache_dir
from thalweg.core.parent_process import end_with_parent
from thalweg.env import sample_starts
from thalweg.render import Camera, Frame, Renderer
from thalweg.render.reference import frame as reference
from thalweg.world import World, load_or_build

HERE = Path(__file__).resolve().parent
LEVELS = ("Easy", "Medium", "Hard")
POSES, SEED = 20, 64
"""Number of poses, starts of episodes on the levels in turn, and the seed that they are drawn with."""
CAMERA, SAMPLES = Camera(128, 128), 8
"""The camera, and the reference's samples x samples rays per pixel."""
SHOWN = len(LEVELS)
"""Number of poses in the picture, the first of each level."""
LEAST_DB, AIM_DB = 22.0, 26.0
"""Required and desired mean of the signal-to-noise ratio."""
LEAST_MASK = 0.995
"""Required mean share of a frame's mask pixels that agree."""
COLUMNS = (
    *("number", "level", "x", "y", "z", "yaw", "time_s", "pixels", "samples", "version", "world_version"),
    *("psnr_db", "mask", "class", "seconds"),
)
AMPLIFIED = 4
"""Factor by which differences are amplified in the picture."""


@dataclass(frozen=True)
class Case:
    """A pose that both renderers draw."""

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
    def cached_frame(self) -> Path:
        """Path of the reference frame that is kept for the picture."""
        return cache_dir() / "reference" / f"{versions.WORLD}-{versions.RENDER}-{self.number}.npy"


@cache
def river(level: str) -> World:
    """Return the river of a level."""
    return load_or_build(level)


def cases() -> list[Case]:
    """Return all poses, rounded to the millimetre and the milliradian."""
    starts = {level: sample_starts(river(level), -(-POSES // len(LEVELS)), SEED) for level in LEVELS}
    planned = []
    for number in range(POSES):
        level = LEVELS[number % len(LEVELS)]
        x, y, z, yaw = starts[level][number // len(LEVELS)].round(3).tolist()
        planned.append(Case(number, level, (x, y, z, yaw), 1.5 * number))
    return planned


def draw_reference(case: Case) -> tuple[reference.ReferenceFrame, float]:
    """Return the frame of the reference renderer, and the seconds it took."""
    world, start = river(case.level), time.perf_counter()
    truth = reference.draw(world, np.array(case.pose), CAMERA, samples=SAMPLES, time_s=case.time_s)
    return truth, time.perf_counter() - start


def draw(planned: list[Case]) -> Frame:
    """Return the frames [20] of the renderer."""
    renderer = Renderer([river(level) for level in LEVELS], CAMERA)
    levels = [LEVELS.index(case.level) for case in planned]
    return renderer.render_layers([case.pose for case in planned], levels, [case.time_s for case in planned])


def compare(case: Case, ours: Frame, truth: reference.ReferenceFrame, seconds: float) -> dict[str, str]:
    """Return the row of a case, from the renderer's frames [20] and the reference's one."""
    index = case.number
    squared = np.mean((ours.rgb[index].astype(float) - truth.rgb) ** 2)
    return case.identity | {
        "psnr_db": f"{10 * np.log10(255**2 / squared):.3f}",
        "mask": f"{np.mean(ours.mask[index] == truth.mask):.6f}",
        "class": f"{np.mean(ours.class_id[index] == truth.class_id):.6f}",
        "seconds": f"{seconds:.1f}",
    }


def current(rows: Rows, planned: list[Case]) -> dict[int, dict[str, str]]:
    """Return the rows of today's poses and versions, by number."""
    by_number = {row["number"]: row for row in rows}
    found = {case.number: by_number.get(str(case.number), {}) for case in planned}
    return {case.number: found[case.number] for case in planned if case.identity.items() <= found[case.number].items()}


def finished(path: Path, planned: list[Case]) -> dict[int, dict[str, str]]:
    """Return the finished rows of the current versions, by number."""
    rows, shown = rows_of(path, COLUMNS), {case.number: case.cached_frame for case in planned if case.number < SHOWN}
    valid = {
        number: row for number, row in current(rows, planned).items() if number not in shown or shown[number].is_file()
    }
    print(
        f"{len(valid)} of {POSES} poses are finished; {len(rows) - len(valid)} rows are of other versions",
        flush=True,
    )
    return valid


def write(path: Path, row: dict[str, str], planned: list[Case]) -> None:
    """Write a row into the table, in the order of the numbers; rows of other versions are dropped."""

    def changed(rows: Rows) -> Rows:
        found = current([*rows, row], planned)
        return [found[number] for number in sorted(found)]

    change(path, COLUMNS, changed)


def show(path: Path, planned: list[Case], ours: Frame, rows: dict[int, dict[str, str]]) -> None:
    """Draw a strip for each of the first poses, as far as they are finished."""
    strips = []
    for case in planned[:SHOWN]:
        if case.number not in rows:
            continue
        frame, truth = ours.rgb[case.number], np.load(case.cached_frame)
        difference = np.minimum(AMPLIFIED * np.abs(frame.astype(int) - truth), 255).astype(np.uint8)
        row = rows[case.number]
        title = f"{case.level}: renderer, reference, {AMPLIFIED} x difference; {row['psnr_db']} dB"
        strips.append(strip(title, np.stack([frame, truth, difference]).repeat(2, axis=1).repeat(2, axis=2)))
    width, height = strips[0].size
    picture = Image.new("RGB", (width, height * len(strips)), "white")
    for index, image in enumerate(strips):
        picture.paste(image, (0, index * height))
    with atomic_path(path) as draft:
        picture.save(draft, optimize=True)


def verdict(rows: dict[int, dict[str, str]]) -> str | None:
    """Print the figures; return an error message if they are below the required ones."""
    decibels = [float(row["psnr_db"]) for row in rows.values()]
    masks, kinds = ([float(row[name]) for row in rows.values()] for name in ("mask", "class"))
    mean, mask = statistics.mean(decibels), statistics.mean(masks)
    print(
        f"{len(rows)} poses: {mean:.2f} dB (least {min(decibels):.2f}, aim {AIM_DB:.0f}, must {LEAST_DB:.0f}); masks"
        f" agree on {mask:.3%} (least {min(masks):.3%}, must {LEAST_MASK:.1%}), classes on {statistics.mean(kinds):.2%}"
    )
    return None if mean >= LEAST_DB and mask >= LEAST_MASK else "renderer and reference differ more than allowed"


def main() -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=POSES, help="number of poses to draw now, from the first")
    parser.add_argument("--processes", type=int, default=2, help="number of frames drawn in parallel")
    parser.add_argument(
        "--out", type=Path, default=HERE, help="folder for reference_accuracy.csv and reference_accuracy.png"
    )
    chosen = parser.parse_args()
    if not 1 <= chosen.poses <= POSES or chosen.processes < 1:
        parser.error(f"--poses must be 1 to {POSES}, --processes at least 1")
    planned = cases()
    ours = draw(planned)
    rows = finished(chosen.out / "reference_accuracy.csv", planned)
    # Spawned, not forked, since threads of the renderer run here.
    with ProcessPoolExecutor(chosen.processes, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        waiting = {
            pool.submit(draw_reference, case): case for case in planned[: chosen.poses] if case.number not in rows
        }
        for done in as_completed(waiting):
            case, (truth, seconds) = waiting[done], done.result()
            if case.number < SHOWN:
                with atomic_path(case.cached_frame) as draft:
                    np.save(draft, truth.rgb)
            rows[case.number] = compare(case, ours, truth, seconds)
            write(chosen.out / "reference_accuracy.csv", rows[case.number], planned)
            print(
                case.number, case.level, *(f"{key} {rows[case.number][key]}" for key in ("psnr_db", "mask", "seconds"))
            )
    show(chosen.out / "reference_accuracy.png", planned, ours, rows)
    return verdict(rows)


if __name__ == "__main__":
    sys.exit(main())
