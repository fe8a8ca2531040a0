"""The ladder of rivers, and the ablations: what diversity is worth, and each part of an imitation.

    python benchmarks/ladder.py --jobs 2                            # trains and flies all that has no row yet
    python benchmarks/ladder.py --only 'student-16-*' 'no-memory-*' # arms by their labels, see --list
    python benchmarks/ladder.py --steps 20000 --episodes 10 --out trial.csv
    python benchmarks/ladder.py --write  # the tables and the plot of docs/imitation-findings.md

An arm is a training: students of the steady pilot, and FOCOPS through frames, on 1, 4, 16, 64 and more rivers of a
level with looks fixed or varied; FOCOPS end to end, on codes of the autoencoder, and on rivers of Hard, on one rung
each; and students that lack one thing each. A row of ladder.csv is appended as each cell is flown: an arm's flights of
one kind on one level. `seen` flights are on rivers of the training, `unseen` ones on as many other rivers as episodes,
`varied` ones on these under varied looks, suns, pitches and fields of view. A cell that has a row is skipped, and
training resumes in the folder `--runs`. A row names the versions, settings and encoder that it depends on: with others,
its cell is flown again. An arm that fails is named at the end, and the others go on, unless its process was killed.
"""

import argparse
import fnmatch
import multiprocessing.connection
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path

from ladder_arms import CELL_KEY, KINDS, NUM_ENVS, VARIED, Arm, Cell, all_arms
from ladder_page import PAGE, PICTURE, drawn_ladder, written_page
from river_flights import RESULTS, figures_of, fly
from tables import append, is_begun

from thalweg.bench.csv_files import read_csv
from thalweg.bench.evaluate.evaluation import Label
from thalweg.core.atomic_io import write_atomic
from thalweg.core.parent_process import end_with_parent
from thalweg.encoder import Encoder
from thalweg.env import EnvConfig
from thalweg.render.records.randomisation import Randomisation
from thalweg.train import load_policy
from thalweg.train.folder.run_record import POLICY
from thalweg.train.imitation.imitate import Imitation
from thalweg.train.river import RiverTraining, load_compatible_encoder

HERE = Path(__file__).resolve().parent
TABLE = HERE / "ladder.csv"
COLUMNS = (*CELL_KEY, *RESULTS)
EPISODES = 50


@dataclass(frozen=True)
class Task:
    """The training of an arm, after which its cells are flown, or the flights of a cell."""

    arm: Arm
    folder: Path
    """Folder of the run."""
    threads: int | None = None
    """Threads for learning; None: as many as the algorithm benefits from."""
    device: str = "cpu"
    """Where a student is trained."""
    cells: tuple[Cell, ...] = ()
    """Cells to fly when the arm is trained."""
    cell: Cell | None = None
    """Cell to fly now."""

    def run(self) -> dict[str, str] | None:
        """Train, or fly a cell; returns the row of a cell."""
        if self.cell is not None:
            return measure(self.cell, self.folder)
        if not (self.folder / POLICY).is_file():  # trained here or elsewhere
            train(self.arm, self.folder, self.threads, self.device)
        return None

    @property
    def following(self) -> list["Task"]:
        """Tasks that can be done when this one is."""
        return [replace(self, cells=(), cell=cell) for cell in self.cells]


def train(arm: Arm, folder: Path, threads: int | None = None, device: str = "cpu") -> None:
    """Train an arm in its folder, or resume; only students are trained on another device."""
    if arm.is_student:
        settings = arm.student_settings
        Imitation(
            folder, arm.steps, arm.seed, arm.levels, arm.seeds, settings=settings, threads=threads, device=device
        ).run(progress=True)
        return
    rules = EnvConfig(randomisation=Randomisation() if arm.looks == VARIED else None)
    # Whatever their number, each episode is in a random river, as those of students are.
    training = RiverTraining(arm.levels, NUM_ENVS, tuple(arm.seeds), rules, rivers="episode")
    encoder, settings = encoder_of(arm), dict(arm.settings) or None
    training.train(
        arm.algorithm, encoder, steps=arm.steps, seed=arm.seed, folder=folder, settings=settings, threads=threads
    )


def measure(cell: Cell, folder: Path) -> dict[str, str]:
    """Fly a cell with the policy of a folder; returns its row."""
    arm = cell.arm
    label = Label(arm.algorithm, arm.seed, cell.level)
    return row_of(cell, figures_of(fly(load_policy(folder), cell.courses(), label, cell.config, encoder_of(arm))))


def encoder_of(arm: Arm) -> Encoder | None:
    """Return the encoder whose codes an arm sees; None for one that sees images."""
    return None if arm.sees_images else load_compatible_encoder(arm.encoder)


def row_of(cell: Cell, figures: Mapping[str, str]) -> dict[str, str]:
    """Return the row of a cell."""
    return dict(zip(CELL_KEY, cell.key, strict=True)) | dict(figures)


def work_through(tasks: Sequence[Task], jobs: int, table: Path) -> list[str]:
    """Do tasks and those that follow them, `jobs` at a time, and append a row to the table as each cell is flown.

    Returns a line for each task that failed.
    """
    waiting, running = deque(tasks), dict[Future[dict[str, str] | None], Task]()
    failures = []
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        while waiting or running:
            while waiting and len(running) < jobs:
                task = waiting.popleft()
                running[pool.submit(task.run)] = task
            for ended in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(ended)
                if (error := ended.exception()) is not None:
                    failures.append(f"{task.arm.label}: {type(error).__name__}: {error}")
                    print(failures[-1], file=sys.stderr, flush=True)
                    if isinstance(error, BrokenProcessPool):
                        waiting.clear()  # a process was killed, perhaps for want of memory: the pool takes no more
                    continue
                waiting.extendleft(reversed(task.following))
                if (row := ended.result()) is not None:
                    append(table, COLUMNS, row)
                    print(*(f"{name} {row[name]}" for name in COLUMNS), flush=True)
    return failures


def status_of(tasks: Sequence[Task], jobs: int, table: Path) -> int:
    """Do tasks as `work_through` does, and name those that failed at the end; returns the exit status."""
    failures = work_through(tasks, jobs, table)
    print(*(f"failed: {line}" for line in failures), sep="\n", end="\n" if failures else "", file=sys.stderr)
    return int(bool(failures))


def missing_cells(arm: Arm, rows: Sequence[Mapping[str, str]], episodes: int, kinds: Sequence[str]) -> list[Cell]:
    """Return the cells of an arm that have no row."""
    done = {tuple(row[name] for name in CELL_KEY) for row in rows}
    return [cell for cell in arm.cells(episodes, kinds) if cell.key not in done]


def chosen_arms(only: Sequence[str], steps: int | None) -> list[Arm]:
    """Return the arms whose labels match a pattern, all of them without patterns; `steps` replaces their own."""
    chosen = [arm for arm in all_arms() if not only or any(fnmatch.fnmatchcase(arm.label, pattern) for pattern in only)]
    return chosen if steps is None else [replace(arm, steps=steps) for arm in chosen]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="PATTERN", help="arms by their labels; default: all")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--episodes", type=int, default=EPISODES, help="flights of each cell")
    parser.add_argument("--steps", type=int, help="steps of training of each arm in place of its own")
    parser.add_argument("--jobs", type=int, default=1, help="arms and cells at a time; an arm takes up to 10 GB")
    parser.add_argument("--threads", type=int, help="threads for learning of each arm")
    parser.add_argument("--device", default="cpu", help="where students are trained, such as cuda")
    parser.add_argument("--runs", type=Path, default=HERE.parent / "runs" / "ladder", help="folder of the runs")
    parser.add_argument("--out", type=Path, default=TABLE, help="the table")
    parser.add_argument("--list", action="store_true", help="train and fly nothing, but list the arms and their cells")
    parser.add_argument("--write", action="store_true", help="train and fly nothing, but write the page and the plot")
    given = parser.parse_args(arguments)
    if given.episodes < 2 or given.jobs < 1 or (given.steps is not None and given.steps < 1):
        parser.error("--episodes must be at least 2, --jobs and --steps at least 1")
    arms = chosen_arms(given.only, given.steps)
    if not arms:
        parser.error(f"--only {' '.join(given.only)} matches no arm; --list shows their labels")
    rows = read_csv(given.out, COLUMNS) if is_begun(given.out) else []
    if given.write:
        if picture := drawn_ladder(rows):
            write_atomic(PICTURE, picture)
        write_atomic(PAGE, written_page(PAGE.read_text(encoding="utf-8"), rows))
        return 0
    tasks = []
    for arm in arms:
        missing = missing_cells(arm, rows, given.episodes, given.kinds)
        total = len(arm.cells(given.episodes, given.kinds))
        print(f"{arm.label}: {len(missing)} of {total} cells are to be flown", flush=True)
        if missing:
            tasks.append(Task(arm, given.runs / arm.folder, given.threads, given.device, tuple(missing)))
    if given.list:
        return 0
    return status_of(tasks, given.jobs, given.out)


if __name__ == "__main__":
    sys.exit(main())
