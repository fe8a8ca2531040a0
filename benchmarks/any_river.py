"""Benchmark of policies that fly any river: students of the steady pilot, on rivers and under looks they never saw.

    python benchmarks/any_river.py --jobs 2                       # trains and flies all that has no row yet
    python benchmarks/any_river.py --seeds 0 --episodes 50 --out trial.csv
    python benchmarks/any_river.py --policy runs/student          # flies another policy; trains nothing
    python benchmarks/any_river.py --write                  # tables of imitation-findings.md and packaged-policy.md

A row of any_river.csv is appended as each cell is flown: a student's flights of one kind on one level. A cell that has
a row is skipped, and training resumes in the folder `--runs`. `fixed` is the river of the level with `--episodes`
starts; `unseen` as many rivers that nobody trains on, with one start each; `varied` the same under varied looks, suns,
pitches and fields of view; `real` are reaches of real rivers, with `--episodes` starts each. The teacher flies all of
them too, but for `varied`, since it sees no looks. Violations are episodes that end in a tight or loose cost.

All flights show frames of full quality. The packaged student with masks flies as well from them as from the fast frames
that it learned from; those of the image alone do not, and learn the last fifth of their steps from full frames, in a
training of its own that begins with the first one. Beside the table, `any_river_trainings.csv` has a row of each
training that ended here, with the steps of the student until then, its own minutes, over all interruptions, and the
greatest memory of the process that ended it.
"""

import argparse
import hashlib
import itertools
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from any_river_aims import LEVELS, TEACHER, packaged_aims, student_aims
from package_flight import NAMES
from page_sections import replace_section
from river_flights import RESULTS, figures_of, fly, fly_cells, mean_return
from tables import append, last_of_each, of_versions, rows_of

from thalweg.algos import AlgorithmError
from thalweg.bench.evaluate.baselines import BASELINES, Policy
from thalweg.bench.evaluate.conditions import RIVERS
from thalweg.bench.evaluate.course import UNSEEN, Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import Label
from thalweg.bench.report.table import frame, markdown
from thalweg.bench.results.inference import Estimate, t_interval, widen_to_wilson, wilson_interval
from thalweg.core import versions
from thalweg.core.atomic_io import write_atomic
from thalweg.core.cache import file_hash
from thalweg.core.machine import machine_info
from thalweg.core.parent_process import end_with_parent
from thalweg.render.records.randomisation import Randomisation
from thalweg.train import load_policy
from thalweg.train.folder.run_record import POLICY
from thalweg.train.imitation.imitate import Imitation
from thalweg.train.run_in_folder import policy_file

HERE = Path(__file__).resolve().parent
TABLE = HERE / "any_river.csv"
DOCS = HERE.parent / "docs"
FLIGHTS = {"unseen": "unseen rivers", "varied": "the same under varied looks and suns"}
"""Words for kinds of flights on the page of the packaged policies."""
KINDS = ("fixed", "unseen", "varied", "real")
SEEDS, OBSERVATIONS = (0, 1, 2), ("rgb+mask", "rgb")
WORLD_SEEDS = "1000:1064"
STEPS = {"rgb+mask": 1_600_000, "rgb": 2_000_000}
FULL_SHARE = 5
"""A student of the image alone learns one of so many steps, its last ones, from frames of full quality."""
FULL: dict[str, Any] = {"quality": "full", "teacher_steps": 0, "learning_rate": 5e-4}
"""Settings of these steps."""
LOOKS = Randomisation(suns=1)
"""Appearances of `varied` flights; each river has one sun."""
VERSIONS = {
    "imitation": versions.IMITATION,
    "render": versions.RENDER,
    "world": versions.WORLD,
    "rules": versions.RULES,
    "evaluation": versions.EVALUATION,
}
"""Versions that a cell depends on, by their columns."""
COLUMNS: tuple[str, ...] = (
    "policy",
    "steps",
    "seed",
    "kind",
    "level",
    "episodes",
    *VERSIONS,
    *RESULTS,
)
KEY = COLUMNS[: 6 + len(VERSIONS)]
"""Columns that identify a cell."""
OF_STUDENTS = ("seeds", "observations", "steps", "device", "runs")
"""Options that say which students are trained, and how."""
TRAINING_COLUMNS = ("policy", "steps", "seed", *VERSIONS, "processor", "cores", "minutes", "peak_gib")
"""Columns of the table of trainings."""


@dataclass(frozen=True)
class Cell:
    """Flights of one kind on one level by one policy."""

    policy: str
    """What a student sees, `TEACHER`, or the hash of another policy's file."""
    steps: int
    """Steps of training; 0 for another policy."""
    seed: int
    kind: str
    level: str
    """A level, or a real river."""
    episodes: int

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        mine = (self.policy, str(self.steps), str(self.seed), self.kind, self.level, str(self.episodes))
        return *mine, *map(str, VERSIONS.values())

    def courses(self) -> Iterator[Course]:
        """Yield the rivers with their starts, and looks if they vary."""
        config = EvaluationConfig(self.episodes, deterministic=True)
        drawn = self.policy != TEACHER
        if self.kind == "real":
            yield Course.on(RIVERS[self.level].build(), config)
            return
        if self.kind == "fixed":
            yield Course.of_level(self.level, config, drawn=drawn)
            return
        seeds = range(UNSEEN, UNSEEN + self.episodes)
        # The start on the i-th river is the i-th of that river's own list, and so is its look.
        for index, course in enumerate(Course.of_seeds(self.level, seeds, config, drawn=drawn)):
            yield (course.varied(LOOKS, config) if self.kind == "varied" else course).only(index)

    def fly(self, policy: Policy) -> list[Episode]:
        """Return the episodes of a policy."""
        config = EvaluationConfig(self.episodes, deterministic=True)
        return fly(policy, self.courses(), Label(self.policy, self.seed, self.level), config)


def student_folder(runs: Path, cell: Cell, trainings: int | None = None) -> Path:
    """Return the folder in which the student of a cell is trained, another one for everything that it depends on.

    `trainings`: how many of its `stages` it has had; None: all.
    """
    learnt = stages(cell.policy, cell.steps)[:trainings]
    trained_with = {name: number for name, number in VERSIONS.items() if name != "evaluation"}
    made_with = hashlib.sha256(repr((WORLD_SEEDS, trained_with, learnt)).encode()).hexdigest()[:8]
    return runs / f"{cell.policy.replace('+', '-')}-{cell.steps}-{cell.seed}-{made_with}"


def stages(policy: str, steps: int) -> list[tuple[int, dict[str, Any]]]:
    """Return the trainings of a student, each of which begins with the one before: their steps and settings."""
    last = steps // FULL_SHARE if policy == "rgb" else 0
    return [(steps - last, {})] + ([(last, FULL)] if last else [])


def trained(runs: Path, cell: Cell, table: Path, device: str = "cpu") -> Path:
    """Return the folder of a cell's student, trained now or before; a training that ends now gets a row in a table."""
    last, taken = student_folder(runs, cell), 0
    if (last / POLICY).is_file():  # trained here or elsewhere
        return last
    before: Path | None = None
    for number, (steps, settings) in enumerate(stages(cell.policy, cell.steps), 1):
        taken += steps
        folder = student_folder(runs, cell, number)
        if not (folder / POLICY).is_file():
            imitation = Imitation(
                folder,
                steps=steps,
                seed=cell.seed,
                world_seeds=WORLD_SEEDS,
                settings={"observation": cell.policy, **settings},
                begin_with=before,
                device=device,
            )
            # A process of its own, whose greatest memory is that of this training alone.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent) as pool:
                minutes, peak = pool.submit(timed, imitation).result()
            append(table, TRAINING_COLUMNS, training_row(replace(cell, steps=taken), minutes, peak))
        before = folder
    return last


def timed(imitation: Imitation) -> tuple[float, float]:
    """Train a student, or resume; returns the minutes of its training and the peak memory of this process in GiB."""
    import resource  # which Windows lacks

    result = imitation.run(progress=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return result.seconds / 60, peak / (2**30 if sys.platform == "darwin" else 2**20)


def training_row(cell: Cell, minutes: float, peak: float) -> dict[str, str]:
    """Return the row of a training."""
    machine = machine_info()
    values = (cell.policy, cell.steps, cell.seed, *VERSIONS.values(), machine["cpu"], machine["cores"])
    texts = (*map(str, values), f"{minutes:.1f}", f"{peak:.2f}")
    return dict(zip(TRAINING_COLUMNS, texts, strict=True))


def row_of(cell: Cell, episodes: Sequence[Episode]) -> dict[str, str]:
    """Return the row of a cell."""
    return dict(zip(KEY, cell.key, strict=True)) | figures_of(episodes)


def measure(cell: Cell, path: Path | None) -> dict[str, str]:
    """Fly a cell with the policy of a file or folder, None for the teacher; returns its row."""
    return row_of(cell, cell.fly(load_policy(path) if path else BASELINES["steady"]))


def page_table(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the page: a line for each policy, kind of flights and river, of today's versions alone.

    Of each line only the longest trainings and the most episodes count, so that trials leave it as it is. Returns are
    means over seeds, with 95 % intervals from three seeds on; violations are the share of flights, see `_violations`.
    """
    lines = []
    for policy, kind in itertools.product(dict.fromkeys(row["policy"] for row in _of_today(rows)), KINDS):
        for level in levels_of(kind):
            if cells := cells_of(rows, policy, kind, level):
                lines.append([policy, kind, level, str(len(cells)), str(mean_return(cells)), _violations(cells)])
    return markdown(frame(["policy", "flights", "level or river", "seeds", "return", "violations"], lines))


def packaged_table(rows: Sequence[dict[str, str]]) -> str:
    """Return the table of the packaged policies, which are the students of seed 0: of each kind of flights on each
    level the mean return with its standard error over flights, and the share of flights that end in a violation. Of
    several rows that of the longest training and of the most episodes counts."""
    rows = sorted(_of_today(rows), key=_amount)
    found = {
        (row["policy"], row["kind"], row["level"]): f"{float(row['return']):.2f} ± {float(row['return_error']):.2f},"
        f" {100 * float(row['violations']):.1f} %"
        for row in rows
        if row["seed"] == "0"
    }
    lines = [
        [NAMES[policy], words, *(found[policy, kind, level] for level in LEVELS)]
        for policy in OBSERVATIONS
        for kind, words in FLIGHTS.items()
        if all((policy, kind, level) in found for level in LEVELS)
    ]
    header = ["policy", "flights", *(f"{level}: return, violations" for level in LEVELS)]
    return markdown(frame(header, lines))


SECTIONS: dict[tuple[Path, str], Callable[[Sequence[dict[str, str]]], str]] = {
    (DOCS / "imitation-findings.md", "any river"): page_table,
    (DOCS / "imitation-findings.md", "student aims"): lambda rows: student_aims(partial(cells_of, rows)),
    (DOCS / "packaged-policy.md", "returns"): packaged_table,
    (DOCS / "packaged-policy.md", "aims"): lambda rows: packaged_aims(partial(cells_of, rows)),
}
"""Sections of pages that `--write` writes, with the functions that return them."""


def cells_of(rows: Sequence[dict[str, str]], policy: str, kind: str, level: str) -> list[dict[str, str]]:
    """Return the rows of a policy's flights of a kind on a level or real river, of today's versions, and of these only
    the longest trainings and the most episodes: one for each seed."""
    same = [row for row in _of_today(rows) if (row["policy"], row["kind"], row["level"]) == (policy, kind, level)]
    most = max(map(_amount, same), default=(0, 0))
    return [row for row in same if _amount(row) == most]


def _of_today(rows: Sequence[dict[str, str]]) -> list[dict[str, str]]:
    """Return the rows of today's versions; of those of the same cell, which two commands may have flown, the last."""
    return last_of_each(of_versions(rows, VERSIONS), KEY)


def _amount(row: dict[str, str]) -> tuple[int, int]:
    """Return steps and episodes of a row."""
    return int(row["steps"]), int(row["episodes"])


def _violations(cells: Sequence[dict[str, str]]) -> str:
    """Return the share of flights with violations as text, with its 95 % interval over seeds, which is at least as wide
    as Wilson's over flights; with fewer than three seeds it is Wilson's, and leaves out how seeds differ."""
    per_seed = np.array([float(row["violations"]) for row in cells])
    flights = [int(row["episodes"]) for row in cells]
    found = t_interval(float(np.average(per_seed, weights=flights)), per_seed)
    if np.isnan(found.low):
        found = Estimate(found.value, *wilson_interval(found.value, sum(flights)))
    found = widen_to_wilson(found, sum(flights))
    return f"{found.value:.1%} [{100 * found.low:.1f}, {100 * found.high:.1f}]"


def levels_of(kind: str) -> tuple[str, ...]:
    """Return the levels that flights of a kind have, or the real rivers."""
    return tuple(RIVERS) if kind == "real" else LEVELS


def main() -> str | None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--observations", nargs="+", choices=(TEACHER, *OBSERVATIONS), default=[TEACHER, *OBSERVATIONS])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--levels", nargs="+", choices=LEVELS, default=list(LEVELS))
    parser.add_argument("--episodes", type=int, default=300, help="starts, or rivers, of each cell")
    parser.add_argument("--steps", type=int, help=f"steps of training of each student; by default {STEPS}")
    parser.add_argument("--policy", type=Path, help="folder of a run or policy file that is flown instead")
    parser.add_argument("--jobs", type=int, default=1, help="cells that are flown at a time")
    parser.add_argument("--device", default="cpu", help="where students are trained, such as cuda")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "any_river", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--write", action="store_true", help="train and fly nothing, but write the table of the page")
    given = parser.parse_args()
    if given.episodes < 2 or given.jobs < 1:
        parser.error("--episodes must be at least 2, --jobs at least 1")
    if given.steps is not None and given.steps < FULL_SHARE:
        parser.error(f"--steps must be at least {FULL_SHARE}, not {given.steps}")
    refuse_ignored(parser, given)
    rows = rows_of(given.out, COLUMNS)
    if given.write:
        for (page, section), table in SECTIONS.items():
            write_atomic(page, replace_section(page.read_text(encoding="utf-8"), section, f"{table(rows)}\n"))
        return None
    done = {tuple(row[name] for name in KEY) for row in rows}
    if given.policy:
        refuse_blind(parser, given.policy)
        students = [(file_hash(policy_file(given.policy)), 0, 0)]
    else:
        seen = [each for each in given.observations if each != TEACHER]
        students = [
            (each, STEPS[each] if given.steps is None else given.steps, seed) for each in seen for seed in given.seeds
        ]
        students += [(TEACHER, 0, 0)] if TEACHER in given.observations else []
    failures = []
    for student in students:
        planned = planned_cells(student, given.kinds, given.levels, given.episodes)
        cells = [cell for cell in planned if cell.key not in done]
        print(f"{' '.join(map(str, student))}: {len(cells)} of {len(planned)} cells are to be flown", flush=True)
        if cells:
            teacher = student[0] == TEACHER
            trainings = given.out.with_name(f"{given.out.stem}_trainings.csv")
            path = None if teacher else given.policy or trained(given.runs, cells[0], trainings, given.device)
            flights = {" ".join(cell.key): partial(measure, cell, path) for cell in cells}
            failures += fly_cells(flights, given.jobs, given.out, COLUMNS)
    return "\n".join(failures) or None


def refuse_blind(parser: argparse.ArgumentParser, path: Path) -> None:
    """End with an error for a path that holds no policy, or one that sees no frames."""
    try:
        policy = load_policy(path)
    except (AlgorithmError, OSError) as error:
        parser.error(f"--policy: {error}")
    if getattr(getattr(policy, "shape", None), "eyes", None) is None:
        parser.error(f"--policy: {path} sees no frames; a policy of `thalweg imitate`, or with policy=cnn, is needed")


def refuse_ignored(parser: argparse.ArgumentParser, given: argparse.Namespace) -> None:
    """End with an error for options of students beside `--policy`, which trains none."""
    changed = [f"--{name}" for name in OF_STUDENTS if getattr(given, name) != parser.get_default(name)]
    if given.policy and changed:
        parser.error(f"--policy trains no students; leave out {' and '.join(changed)}")


def planned_cells(
    student: tuple[str, int, int], kinds: Sequence[str], levels: Sequence[str], episodes: int
) -> list[Cell]:
    """Return the cells of a student, (what it sees, steps, seed): `levels` select among those that a kind has."""
    shown = [kind for kind in kinds if student[0] != TEACHER or kind != "varied"]
    return [
        Cell(*student, kind, level, episodes)
        for kind in shown
        for level in levels_of(kind)
        if kind == "real" or level in levels
    ]


if __name__ == "__main__":
    sys.exit(main())
