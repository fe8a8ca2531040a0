"""Trainings that a suite takes from the results of another one, where they are the same.

Their folders are copied, and their policies are flown as any others. Flights are not copied: each suite has its own.
"""

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from thalweg.algos.common.errors import AlgorithmError
from thalweg.bench.execute.backend import STAGES
from thalweg.bench.execute.executors import ExecutionContext
from thalweg.bench.results.results import read_runs
from thalweg.bench.results.run_versions import (
    Versions,
    needs_training,
    read_sources,
    read_versions,
    write_versions,
)
from thalweg.bench.suite.arms import Run
from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import FOLDER as CHECKPOINTS
from thalweg.train.folder.run_record import CONFIG, POLICY, read_status


def take_trainings(context: ExecutionContext, runs: Mapping[Run, Versions], source: Path) -> None:
    """Copy the trainings of runs that have none yet from the results in `source`.

    A training is taken if it is finished there, under the same name and seed and with the versions of today, which
    `runs` has, and if the backend finds nothing in which it differs from what the suite asks for.
    """
    finished = {row.run for row in read_runs(source) if row.status == "finished"}
    recorded = read_versions(source)
    for run, current in runs.items():
        there, here = (folder / "runs" / run.name for folder in (source, context.folder))
        has_begun = (here / CONFIG).exists() or (here / STAGES).exists()
        if run.name not in finished or has_begun or needs_training(recorded.get(run.name, {}), current):
            continue
        stages = [there / STAGES / str(number) for number in range(len(context.suite.arm(run.algorithm).before))]
        if not all(map(_is_finished, (*stages, there))):
            continue
        copy = here.with_name(f".{run.name}")
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(there, copy, ignore=shutil.ignore_patterns(CHECKPOINTS))  # finished runs do not need them
        try:
            context.backend.train(run, copy)  # a finished run is not repeated, and another one is refused
        except (TrainingError, AlgorithmError) as error:
            shutil.rmtree(copy)
            context.console.print(f"{run.name}: not taken from {source}: {error}", highlight=False, markup=False)
            continue
        known = read_versions(context.folder) | {run.name: current}
        write_versions(context.folder, known, read_sources(context.folder))
        shutil.rmtree(here, ignore_errors=True)  # an attempt that failed before training began
        os.rename(copy, here)
        context.console.print(f"{run.name}: trained in {source}", highlight=False, markup=False)


def _is_finished(folder: Path) -> bool:
    """Return whether the training in a folder has ended with a policy."""
    return (folder / POLICY).exists() and read_status(folder).get("state") == "finished"
