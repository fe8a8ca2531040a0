"""Failures of students on the fixed rivers: where, at the start or under way, on what sight, and which ones are shared.

    python benchmarks/fixed_failures.py runs/any_river/FIRST runs/any_river/SECOND
    python benchmarks/fixed_failures.py --write        # table and maps of docs/imitation-findings.md, flying nothing

Any of them may be `packaged`. They fly the `fixed` flights of `any_river.py`. fixed_failures.csv has a row for each
flight that ends in a violation, with the share of its first frame that is water, and one without a start for each
student and level that was flown, which is not flown again, with the number of all starts that show less water than
`DRY`. Students are named by the hashes of their files, in the order in which they were flown.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from any_river import VERSIONS, Cell
from matplotlib.figure import Figure
from page_sections import replace_section
from same_failures import SOON
from tables import of_versions, put, rows_of

from thalweg.algos.imitation.student import ALGORITHM
from thalweg.bench.csv_files import ResultsError, read_csv
from thalweg.bench.packaged import policy_path
from thalweg.bench.report.figures import STYLE
from thalweg.bench.report.table import frame, markdown
from thalweg.core.atomic_io import atomic_path, write_atomic
from thalweg.core.cache import file_hash
from thalweg.render import Renderer
from thalweg.train import load_policy
from thalweg.train.observations import observation_of
from thalweg.train.run_in_folder import policy_file
from thalweg.world import LEVELS, load_or_build
from thalweg.world.map_image import view

HERE = Path(__file__).resolve().parent
TABLE, PAGE, SECTION = HERE / "fixed_failures.csv", HERE.parent / "docs" / "imitation-findings.md", "fixed failures"
MAPS = HERE.parent / "docs" / "images" / "fixed_failures.jpg"
SEES = "rgb+mask"
EPISODES = 300
"""Flights of each student on each river."""
KEY = ("student", "level", "episodes", *VERSIONS)
"""Columns that identify the flights of a student on a level."""
POINTS = ("x", "y", "end_x", "end_y")
"""Columns of start and end, in metres."""
COLUMNS = (*KEY, "start", *POINTS, "reason", "length", "water", "dry_starts")
DRY = 0.01
"""Share of a frame below which hardly any water is seen."""
MARGIN_M = 20.0
"""Land around a river on its map."""
LETTERS = ("A", "B", "C")
"""Names of the students on the page, in the order of their rows."""
COLOURS = ("#d7301f", "#2166ac", "#f4a300")
Rows = Sequence[Mapping[str, str]]


def flights_of(path: Path, level: str) -> list[dict[str, str]]:
    """Return the rows of a student's flights on the fixed river of a level: one for each violation, and one for all.

    Raises `ResultsError` unless it is a student of image and mask.
    """
    policy = load_policy(path)
    if (seen := (policy.about.algorithm, observation_of(policy))) != (ALGORITHM, SEES):
        raise ResultsError(f"{path} must be a student ({ALGORITHM}) of {SEES}, not {seen[0]} of {seen[1]}")
    key = dict(zip(KEY, key_of(path, level), strict=True))
    water = water_at_starts(level)
    failed = [
        {name: f"{getattr(each, name):.2f}" for name in POINTS}
        | {"start": str(each.episode), "reason": each.reason, "length": str(each.length)}
        | {"water": f"{water[each.episode]:.4f}", "dry_starts": ""}
        for each in cell_of(level).fly(policy)
        if each.cost > 0
    ]
    flown = dict.fromkeys(COLUMNS[len(KEY) :], "") | {"dry_starts": str((water < DRY).sum())}
    return [key | row for row in (*failed, flown)]


def water_at_starts(level: str) -> np.ndarray:
    """Return the share [K] of the first frame of each flight on the fixed river of a level that is water."""
    (course,) = cell_of(level).courses()
    return (Renderer([course.world]).render_mask(course.starts) > 0).mean(axis=(1, 2))


def cell_of(level: str) -> Cell:
    """Return the flights on the fixed river of a level; whose they are does not matter here."""
    return Cell(SEES, 0, 0, "fixed", level, EPISODES)


def key_of(path: Path, level: str) -> tuple[str, ...]:
    """Return the values of `KEY`; a student is identified by the hash of its file."""
    return (file_hash(policy_file(path)), level, str(EPISODES), *map(str, VERSIONS.values()))


def students_of(rows: Rows) -> list[str]:
    """Return the hashes of students in the order in which they were flown."""
    return list(dict.fromkeys(row["student"] for row in rows))


def table(rows: Rows) -> str:
    """Return the table of the page: a row for each level and student that was flown on it."""
    lines = []
    for level in LEVELS:
        dry_starts = {row["student"]: row["dry_starts"] for row in rows if row["level"] == level and not row["start"]}
        for name, letter in zip(students_of(rows), LETTERS, strict=False):
            if name in dry_starts:
                lines.append([level, dry_starts[name], letter, *map(str, counts_of(rows, name, level))])
    header = [
        "level",
        "starts that show hardly any water",
        "student",
        "violations",
        f"within {SOON} steps",
        "at such starts",
        "without leaving the spot",
        "at starts where another has one",
    ]
    return markdown(frame(header, lines))


def counts_of(rows: Rows, student: str, level: str) -> tuple[int, ...]:
    """Return the violations of a student on a level: all, the early ones, those at starts that show hardly any water,
    those that end above or below their start, and those at starts where another student has one too."""
    mine = [row for row in rows if is_failure(row, student, level)]
    others = {row["start"] for row in rows if row["level"] == level and row["student"] != student and row["start"]}
    return (
        len(mine),
        sum(int(row["length"]) <= SOON for row in mine),
        sum(float(row["water"]) < DRY for row in mine),
        sum((row["x"], row["y"]) == (row["end_x"], row["end_y"]) for row in mine),
        sum(row["start"] in others for row in mine),
    )


def is_failure(row: Mapping[str, str], student: str, level: str) -> bool:
    """Return whether a row is that of a violation of a student on a level."""
    return (row["student"], row["level"]) == (student, level) and row["start"] != ""


def maps(rows: Rows) -> Figure:
    """Draw the fixed rivers from above, with the starts of flights that end soon as circles, of one colour for each
    student, and the ends of others as crosses."""
    with matplotlib.rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(9.0, 3.4))
        for axis, level in zip(figure.subplots(1, len(LEVELS)), LEVELS, strict=True):
            world = load_or_build(level)
            grid, picture = world.grid, view(world)
            height, width = picture.shape[:2]
            right, top = grid.origin_x_m + width * grid.cell_m, grid.origin_y_m + height * grid.cell_m
            extent = (grid.origin_x_m, right, grid.origin_y_m, top)
            axis.imshow(picture, origin="lower", extent=extent)
            for number, name in enumerate(students_of(rows)):
                failed = [row for row in rows if is_failure(row, name, level)]
                colour, size = COLOURS[number], 26.0 * (1 + number)  # larger, so that those of both are seen
                soon = points_of([row for row in failed if int(row["length"]) <= SOON], "x", "y")
                late = points_of([row for row in failed if int(row["length"]) > SOON], "end_x", "end_y")
                axis.scatter(*soon.T, s=size, marker="o", linewidth=1.2, facecolors="none", edgecolors=colour)
                axis.scatter(*late.T, s=size, marker="x", linewidth=1.2, color=colour)
            middle = (world.river.position_m.max(axis=0) + world.river.position_m.min(axis=0)) / 2
            reach = np.ptp(world.river.position_m, axis=0).max() / 2 + MARGIN_M
            axis.set_xlim(middle[0] - reach, middle[0] + reach)
            axis.set_ylim(middle[1] - reach, middle[1] + reach)
            axis.set_title(level)
            axis.set_xticks([])
            axis.set_yticks([])
    return figure


def points_of(rows: Rows, *names: str) -> np.ndarray:
    """Return the points [K, 2] in two columns of some rows."""
    return np.array([[float(row[name]) for name in names] for row in rows]).reshape(-1, 2)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("students", nargs="*", help="folders of runs of students, their files, or `packaged`")
    parser.add_argument("--levels", nargs="+", choices=tuple(LEVELS), default=list(LEVELS))
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="fly nothing, but write table and maps of the page")
    given = parser.parse_args(arguments)
    if given.write:
        rows = of_versions(read_csv(given.out, COLUMNS), VERSIONS)
        if (found := len(students_of(rows))) > len(LETTERS):
            parser.error(f"{given.out} holds {found} students, but the page has room for {len(LETTERS)}")
        text = table(rows) if rows else "Nothing was measured with today's versions.\n"
        write_atomic(PAGE, replace_section(PAGE.read_text(encoding="utf-8"), SECTION, text))
        if rows:
            with atomic_path(MAPS) as draft:
                maps(rows).savefig(draft, format="jpeg", dpi=140, pil_kwargs={"quality": 85})
        return 0
    paths = [policy_path(student) for student in given.students]
    if not 1 <= len(paths) <= len(LETTERS):
        parser.error(f"between one and {len(LETTERS)} students are needed, not {len(paths)}")
    done = {tuple(row[name] for name in KEY) for row in rows_of(given.out, COLUMNS) if not row["start"]}
    for level in given.levels:
        for path in paths:
            if key_of(path, level) not in done:
                put(given.out, COLUMNS, flights_of(path, level), KEY)
                print(f"{path} on {level}: flown", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
