"""Outdated runs of a results folder: set aside in `outdated/` until they have been run again.

`outdated/` has the layout of a results folder. At any moment, all files of a run in the one or the other belong to the
versions that `versions.json` there names. A process can therefore be killed at any point: nothing is lost, nothing is
mixed, and the next call continues.
"""

import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.results.results import evaluation_path, read_runs, write_runs
from thalweg.bench.results.run_versions import (
    Sources,
    Versions,
    needs_training,
    read_sources,
    read_versions,
    write_versions,
)
from thalweg.bench.suite.arms import Run

FOLDER = "outdated"


@dataclass(frozen=True)
class _Store:
    """The files of one run in a results folder, or in the folder of outdated runs."""

    folder: Path
    run: Run
    trials: tuple[Trial, ...]

    @property
    def run_folder(self) -> Path:
        return self.folder / "runs" / self.run.name

    @property
    def versions(self) -> Versions | None:
        """The run's versions; None if they are not recorded."""
        return read_versions(self.folder).get(self.run.name)

    @property
    def sources(self) -> Sources:
        """Hashes of the sources of plug-ins that the run was made with."""
        return read_sources(self.folder).get(self.run.name, {})

    def set_versions(self, recorded: Versions | None, sources: Sources | None = None) -> None:
        """Record the run's versions, and the hashes of its plug-ins' sources; None removes them."""
        known, hashes = read_versions(self.folder), read_sources(self.folder)
        others = {name: versions for name, versions in known.items() if name != self.run.name}
        changed = others if recorded is None else known | {self.run.name: recorded}
        changed_hashes = hashes | {self.run.name: sources or {}}
        if changed != known or (sources or {}) != hashes.get(self.run.name, {}):
            write_versions(self.folder, changed, changed_hashes)

    def evaluations(self) -> list[Path]:
        """The evaluation files of the run that exist."""
        paths = (evaluation_path(self.folder, self.run.name, trial) for trial in self.trials)
        return [path for path in paths if path.exists()]

    def is_empty(self) -> bool:
        rows = (row.run for row in read_runs(self.folder))
        return not self.evaluations() and not self.run_folder.exists() and self.run.name not in rows

    def drop_row(self) -> None:
        """Remove the run's row from `runs.csv`."""
        rows = read_runs(self.folder)
        if self.run.name in {row.run for row in rows}:
            write_runs(self.folder, [row for row in rows if row.run != self.run.name])

    def remove(self, *, with_training: bool) -> None:
        """Remove all files of the run, `with_training` or except for its folder."""
        self.drop_row()
        for path in self.evaluations():
            path.unlink()
        if with_training:
            shutil.rmtree(self.run_folder, ignore_errors=True)

    def move_training_to(self, target: "_Store") -> None:
        """Move the run's folder, if there is one."""
        if self.run_folder.exists():
            shutil.rmtree(target.run_folder, ignore_errors=True)
            target.run_folder.parent.mkdir(parents=True, exist_ok=True)
            os.rename(self.run_folder, target.run_folder)

    def move_to(self, target: "_Store", *, with_training: bool) -> None:
        """Move all files of the run; what an interrupted move has left is moved too.

        Its row comes last: a run counts as finished where that is.
        """
        for path in self.evaluations():
            moved = target.folder / path.relative_to(self.folder)
            moved.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, moved)
        if with_training:
            self.move_training_to(target)
        rows = [row for row in read_runs(self.folder) if row.run == self.run.name]
        if rows:
            others = [row for row in read_runs(target.folder) if row.run != self.run.name]
            write_runs(target.folder, others + rows)
            self.drop_row()


def prepare(folder: Path, run: Run, trials: Iterable[Trial], current: Versions, sources: Sources | None = None) -> str:
    """Make a results folder ready for a run with the current versions; returns what is done again.

    Files of the run with other versions are set aside: its evaluations, and its training if that is outdated too. If
    finished ones are set aside already, later unfinished ones are removed instead. If those set aside are flights
    alone, the training that they were flown with is moved to them. `sources` are the current hashes of its plug-ins.
    Returns `trained`, `flown` or an empty string for a run that is new or continues.
    """
    active, outdated = (_Store(base, run, tuple(trials)) for base in (folder, folder / FOLDER))
    recorded, previous = active.versions, outdated.versions
    outcome = ""
    if recorded != current:
        with_training = run.kind == "train" and needs_training(recorded or {}, current)
        if not active.is_empty():
            outcome = "trained" if with_training else "flown"
            if previous is None or previous == (recorded or {}):
                outdated.set_versions(recorded or {}, active.sources)
                active.move_to(outdated, with_training=with_training)
            else:
                # If flights alone were set aside, they were flown with the training that is still here.
                if with_training and not (outdated.run_folder.exists() or needs_training(previous, recorded or {})):
                    active.move_training_to(outdated)
                active.remove(with_training=with_training)
    if (recorded, active.sources) != (current, sources or {}):
        active.set_versions(current, sources)
    if outdated.versions == current:  # the versions of an earlier call are the current ones again
        outdated.move_to(active, with_training=True)
        active.set_versions(current, outdated.sources)
        outdated.set_versions(None)
        outcome = ""
    return outcome


def discard(folder: Path, run: Run, trials: Iterable[Trial]) -> None:
    """Remove the outdated files of a run that has been run again."""
    outdated = _Store(folder / FOLDER, run, tuple(trials))
    if not outdated.folder.exists():
        return
    outdated.remove(with_training=True)
    outdated.set_versions(None)
    if not read_versions(outdated.folder):
        shutil.rmtree(outdated.folder, ignore_errors=True)


def is_current(folder: Path, run: Run, current: Versions) -> bool:
    """Whether the files of a run have the current versions; raises `ResultsError` for unreadable versions."""
    try:
        return read_versions(folder).get(run.name) == current
    except ResultsError as error:
        raise ResultsError(f"{folder}: {error}") from error
