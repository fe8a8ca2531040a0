"""Archives of runs: all files of a run by name, for transfer between machines that share no disk.

A run may be packed while it is executed, and unpacking may be killed halfway: the result is a run that was interrupted
at some moment, like any other. Therefore the newest checkpoints, of the run and of its unfinished earlier stage, are
read before the tables, which only grow, and written after them.
"""

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.execute.backend import STAGES
from thalweg.bench.execute.executors import LOGS
from thalweg.bench.results.results import evaluation_path
from thalweg.core.atomic_io import write_atomic
from thalweg.train.errors import TrainingError
from thalweg.train.folder.checkpoint import FOLDER as CHECKPOINTS
from thalweg.train.folder.run_record import POLICY, STATUS, read_status

Files = dict[str, bytes]
"""Contents of files, by their paths relative to a results folder."""


def archive_names(folder: Path, run: str, trials: Sequence[Trial]) -> list[str]:
    """Return the names of all files of a run in a results folder, in the order in which they must be read: newest
    checkpoints of the run and its unfinished stages, rest of the run's folder, evaluations and log.
    """
    run_folder = folder / "runs" / run
    stages = [stage for stage in sorted((run_folder / STAGES).glob("[0-9]*")) if not _is_finished(stage)]
    paths = [path for stage in (run_folder, *stages) for path in _newest_checkpoint(stage)]
    paths += _outside_checkpoints(run_folder)
    others = [evaluation_path(folder, run, trial) for trial in trials] + [folder / LOGS / f"{run}.txt"]
    paths += [path for path in others if path.exists()]
    return [path.relative_to(folder).as_posix() for path in paths]


def milestones(names: Iterable[str]) -> frozenset[str]:
    """Return the names that mark a run's progress: checkpoints, policies and evaluations."""
    return frozenset(name for name in names if _is_checkpoint(name) or _is_policy(name) or _is_evaluation(name))


def pack(folder: Path, run: str, trials: Sequence[Trial]) -> Files:
    """Return the files of `archive_names`; raises `FileNotFoundError` if the run removes one meanwhile."""
    return {name: (folder / name).read_bytes() for name in archive_names(folder, run, trials)}


def unpack(files: Files, folder: Path, run: str) -> None:
    """Write packed files into a results folder, each atomically, and remove other files from the run's folder there."""
    checkpoint = [name for name in files if _is_checkpoint(name)]
    # A run with a policy counts as trained, and one whose status says so as finished: both are written last.
    last = sorted(
        (name for name in files if _is_policy(name) or name.endswith(f"/{STATUS}")), reverse=True, key=_is_policy
    )
    for name in files:
        if name not in checkpoint and name not in last:
            write_atomic(folder / name, files[name])
    _write_checkpoints({folder / name: files[name] for name in checkpoint})
    for name in last:
        write_atomic(folder / name, files[name])
    for path in _outside_checkpoints(folder / "runs" / run):
        if path.relative_to(folder).as_posix() not in files:
            path.unlink()


def _is_finished(stage: Path) -> bool:
    """Whether a stage is trained to its end, so that no one resumes it; not with a damaged status."""
    try:
        return read_status(stage).get("state") == "finished"
    except TrainingError:  # whoever executes the run says so
        return False


def _newest_checkpoint(stage: Path) -> list[Path]:
    """Return the files of the newest checkpoint in the folder of a run or of a stage; none if it has none."""
    newest = max((path for path in (stage / CHECKPOINTS).glob("[0-9]*") if path.is_dir()), default=None)
    return [] if newest is None else sorted(newest.iterdir())


def _write_checkpoints(contents: dict[Path, bytes]) -> None:
    """Write each checkpoint's folder atomically, and remove the other checkpoints beside it."""
    for final in {path.parent: None for path in contents}:
        draft = final.with_name(f".{final.name}.archive.part")  # trainers remove folders with such names
        if not final.exists():
            shutil.rmtree(draft, ignore_errors=True)
            for path, content in contents.items():
                if path.parent == final:
                    write_atomic(draft / path.name, content)
            os.rename(draft, final)
        for other in final.parent.iterdir():
            if other.is_dir() and other != final:
                shutil.rmtree(other)


def _is_checkpoint(name: str) -> bool:
    return f"/{CHECKPOINTS}/" in name


def _is_evaluation(name: str) -> bool:
    return name.startswith("evaluation/")


def _is_policy(name: str) -> bool:
    return name.endswith(f"/{POLICY}")


def _outside_checkpoints(run_folder: Path) -> Iterator[Path]:
    """Visible files in a run's folder and in those of its stages, except for checkpoints."""
    for parent, folders, names in os.walk(run_folder):
        visible = (name for name in folders if name == STAGES or not name.startswith("."))
        folders[:] = sorted(name for name in visible if name != CHECKPOINTS)
        yield from (Path(parent, name) for name in sorted(names) if not name.startswith("."))
