"""IoU of the packaged finder of water in frames of rivers held out of its training, under all looks.

    python benchmarks/water_iou.py            # writes water_iou.csv
    python benchmarks/water_iou.py --write    # the table of docs/follow.md, drawing nothing

A row for each level, under the sun of each river as in its training, and under others: the IoU of each frame, averaged;
the same of frames with at least `SOME_WATER` of water; and the IoU of all pixels together.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from page_sections import replace_section

from thalweg.bench.csv_files import csv_text, read_csv
from thalweg.bench.report.table import frame, markdown
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.cache import file_hash
from thalweg.encoder.water import PACKAGED_WATER, load_segmenter, mean_iou, water_in
from thalweg.render.records.randomisation import Randomisation
from thalweg.train.encoder.frames import collect_frames
from thalweg.world import LEVELS

HERE = Path(__file__).resolve().parent
TABLE, PAGE, SECTION = HERE / "water_iou.csv", HERE.parent / "docs" / "follow.md", "water"
RIVERS = range(3000, 3002)
"""Seeds of rivers on which the finder was not trained."""
FRAMES, SEED = 200, 7
"""Frames of each level, and the seed of their poses, clocks and looks."""
SOME_WATER = 0.05
"""Share of a frame."""
SUNS = {"own": 0, "others": 4}
"""Suns under which each river is drawn: its own alone, or as many others."""
FIGURES = {
    "mean_iou": "IoU, mean over frames",
    "mean_iou_some_water": f"IoU of frames with at least {SOME_WATER:.0%} of water",
    "pixels_iou": "IoU of all pixels together",
}
"""Columns, and what the page calls them."""
MADE_WITH = ("segmenter", "render", "world", "rules")
"""Columns of what figures depend on: a hash of the file, and versions."""
COLUMNS = (*MADE_WITH, "level", "suns", "frames", *FIGURES)


def figures_of(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return `FIGURES` of masks bool [K, H, W], some of which must have at least `SOME_WATER` of water."""
    some = truth.mean((1, 2)) >= SOME_WATER
    values = mean_iou(found, truth), mean_iou(found[some], truth[some]), (found & truth).sum() / (found | truth).sum()
    return dict(zip(FIGURES, map(float, values), strict=True))


def made_with(segmenter: Path) -> dict[str, str]:
    """Return `MADE_WITH` of figures of today."""
    return dict(
        zip(MADE_WITH, map(str, (file_hash(segmenter), versions.RENDER, versions.WORLD, versions.RULES)), strict=True)
    )


def measure(level: str, suns: str, segmenter: Path) -> dict[str, str]:
    """Return the row of a level under `SUNS`."""
    looks = Randomisation(suns=SUNS[suns])
    images = collect_frames(FRAMES, level, SEED, world_seeds=RIVERS, randomisation=looks)
    figures = figures_of(water_in(load_segmenter(segmenter), images[..., :3]), images[..., 3] > 0)
    shown = {name: f"{value:.4f}" for name, value in figures.items()}
    return made_with(segmenter) | {"level": level, "suns": suns, "frames": str(FRAMES)} | shown


def table(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the table of the page."""
    own, others = ({row["level"]: row for row in rows if row["suns"] == suns} for suns in SUNS)
    lines = [
        [words, *(f"{float(own[level][name]):.2f} / {float(others[level][name]):.2f}" for level in own)]
        for name, words in FIGURES.items()
    ]
    heading = (
        f"{FRAMES} frames of {len(RIVERS)} rivers held out, all looks varied: with the suns of the rivers / with others"
    )
    return markdown(frame([heading, *own], lines))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--segmenter", type=Path, default=PACKAGED_WATER, help="file of a finder of water")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table, which is written anew")
    parser.add_argument("--write", action="store_true", help="draw nothing, but write the table of the page")
    given = parser.parse_args()
    if given.write:
        today = made_with(given.segmenter)
        found = read_csv(given.out, COLUMNS) if given.out.is_file() else []
        rows = [row for row in found if {name: row[name] for name in MADE_WITH} == today]
        text = table(rows) if rows else "Nothing was measured with today's versions.\n"
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, text))
        return 0
    rows = [measure(level, suns, given.segmenter) for level in LEVELS for suns in SUNS]
    write_atomic(given.out, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in rows)))
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
