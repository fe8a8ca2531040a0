"""What of a run travels between machines that share no disk? Everything that it left, as files by their names.

A run may be packed while it goes on, and unpacked by somebody who is killed in the midst of it: what comes out is a run
that was interrupted at some moment, as any other. The newest checkpoint is therefore read before the tables, which only
grow, and put in its place after them.
"""

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.execute.executors import LOGS
from thalweg.bench.execute.rivers import STAGES
from thalweg.bench.results.results import evaluation_path
from thalweg.core.atomic_io import write_atomic
from thalweg.train.folder.checkpoint import FOLDER as CHECKPOINTS
from thalweg.train.folder.run_record import POLICY, STATUS

Files = dict[str, bytes]
"""Contents by their names below a folder of results."""


def names_of(folder: Path, run: str, trials: Sequence[Trial]) -> list[str]:
    """What a folder of results holds of a run, in the order in which it is to be read: its newest checkpoint, the rest
    of its folder, its evaluations and its log."""
    home = folder / "runs" / run
    newest = max((path for path in (home / CHECKPOINTS).glob("[0-9]*") if path.is_dir()), default=None)
    paths = [] if newest is None else sorted(newest.iterdir())
    paths += _beside_checkpoints(home)
    others = [evaluation_path(folder, run, trial) for trial in trials] + [folder / LOGS / f"{run}.txt"]
    paths += [path for path in others if path.exists()]
    return [path.relative_to(folder).as_posix() for path in paths]


def milestones(names: Iterable[str]) -> frozenset[str]:
    """Those of a run's files that say how far it is: what they hold need not be done again."""
    return frozenset(name for name in names if _is_checkpoint(name) or _is_policy(name) or _is_evaluation(name))


def pack(folder: Path, run: str, trials: Sequence[Trial]) -> Files:
    """The files of `names_of`; raises `FileNotFoundError` where the run took one away meanwhile."""
    return {name: (folder / name).read_bytes() for name in names_of(folder, run, trials)}


def unpack(files: Files, folder: Path, run: str) -> None:
    """Put what `pack` gave into a folder of results, each file whole or not at all, and remove what else the run's
    folder holds there."""
    checkpoint = [name for name in files if _is_checkpoint(name)]
    # A run that has a policy is taken for trained, and one whose status says so for finished.
    last = sorted(
        (name for name in files if _is_policy(name) or name.endswith(f"/{STATUS}")), reverse=True, key=_is_policy
    )
    for name in files:
        if name not in checkpoint and name not in last:
            write_atomic(folder / name, files[name])
    _put_checkpoint({folder / name: files[name] for name in checkpoint})
    for name in last:
        write_atomic(folder / name, files[name])
    for path in _beside_checkpoints(folder / "runs" / run):
        if path.relative_to(folder).as_posix() not in files:
            path.unlink()


def _put_checkpoint(contents: dict[Path, bytes]) -> None:
    """A checkpoint as a whole folder, in place of those beside it."""
    for final in {path.parent for path in contents}:
        draft = final.with_name(f".{final.name}.parcel.part")  # trainers remove what is called so
        if not final.exists():
            shutil.rmtree(draft, ignore_errors=True)
            for path, content in contents.items():
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


def _beside_checkpoints(home: Path) -> Iterator[Path]:
    """The files in a run's folder and in those of stages before it, but for checkpoints and what is hidden."""
    for parent, folders, names in os.walk(home):
        kept = (name for name in folders if name == STAGES or not name.startswith("."))
        folders[:] = sorted(name for name in kept if name != CHECKPOINTS)
        yield from (Path(parent, name) for name in sorted(names) if not name.startswith("."))
