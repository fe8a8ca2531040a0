"""A run in its folder: opened or resumed, trained to its end, and its result."""

import math
import numbers
import operator
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.policy import policy as policies
from thalweg.core.cache import file_hash
from thalweg.core.compute.device import resolve_device
from thalweg.core.compute.heap import keep_freed_memory
from thalweg.core.notices import notice
from thalweg.core.plugins.record import PluginWarning, changed_source
from thalweg.core.seeds import MAX_SEED
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.folder import run_record
from thalweg.train.folder.checkpoint import load_checkpoint
from thalweg.train.folder.loggers import RunLog
from thalweg.train.folder.progress_bar import ProgressBar
from thalweg.train.loop import AnyTrainer, StatusFile, training_loop

MOST: Mapping[str, int] = MappingProxyType({"num_envs": 1_000_000, "sequences": 1_000_000})
"""Maximum of numbers of which far fewer exhaust any memory."""
NO_VERSIONS: Mapping[str, int] = MappingProxyType({})


@dataclass(frozen=True)
class RunResult:
    """Result of a run."""

    folder: Path
    algorithm: str
    steps: int
    """Steps taken, all environments together: the requested number, rounded up to a step of every environment, or to a
    whole rollout of environments of tensors."""
    episodes: int
    return_mean: float
    """Mean undiscounted return of the last 50 episodes; NaN without episodes."""
    cost_mean: float
    """Mean undiscounted cost of the same episodes."""
    cost_rate: float
    """Episodes with a cost, per step."""
    seconds: float
    """Training time, over all interruptions."""
    resumed_from: int | None
    """Step from which this call resumed; None for a run that it started."""
    already_finished: bool
    """Whether the run was finished before this call."""
    warnings: tuple[str, ...]
    """Problems of the settings, such as a limit that never binds."""

    @property
    def policy(self) -> Any:
        """The trained policy."""
        return load_policy(self.folder)


def check_numbers(**given: tuple[Any, int]) -> tuple[int, ...]:
    """Return the numbers of pairs (number, minimum) as Python's integers, in order; raises `TrainingError` for one that
    is not whole, below its minimum, or beyond 64 bits or the maximum in `MOST`."""
    for name, (number, minimum) in given.items():
        if isinstance(number, bool | np.bool_) or not hasattr(number, "__index__"):
            raise TrainingError(f"{name} must be a whole number, got {number!r:.60}")
        if number < minimum:
            required = f"be at least {minimum}" if minimum else "not be negative"
            raise TrainingError(f"{name} must {required}, got {number}")
        if number > (most := MOST.get(name, MAX_SEED)):
            raise TrainingError(f"{name} must be at most {most}, got {number}")
    return tuple(operator.index(number) for number, _ in given.values())


def check_seconds(**times: Any) -> None:
    """Raise `TrainingError` for a time in seconds that is not a finite number of at least 0."""
    for name, seconds in times.items():
        is_number = isinstance(seconds, numbers.Real) and not isinstance(seconds, bool)
        if not (is_number and 0.0 <= float(seconds) < math.inf):
            raise TrainingError(f"{name} must be a finite number of at least 0, got {seconds!r:.60}")


def open_folder(
    folder: Path,
    identity: dict[str, Any],
    threads: int,
    learner: Mapping[str, int] = NO_VERSIONS,
    device: str | None = None,
) -> dict[str, Any]:
    """Create the folder of a run, or check that an existing one is of the same run; returns its status.

    `learner` has the version of what learns by its name, unless it is in the context; `device` is the GPU's name with
    its number, such as cuda:1, of a run that is on one.

    Raises `TrainingError` for the folder of another run, and for one begun with other versions than today's
    and not finished; warns of a finished one, and if packages, threads or the fast path have changed, or the source of
    a plug-in whose version has not.
    """
    description = run_record.describe(identity, threads, learner, device)
    existing = run_record.read_config(folder)
    if existing is None:
        run_record.config_text(description)  # raises for what is no plain data, before the folder is created
        with run_record.RUN_FOLDER.locked(folder):  # so that of two that begin at once, one is the first
            if (existing := run_record.read_config(folder)) is None:
                run_record.write_config(folder, description)
                return {}
    run_record.require_same(folder, existing["run"], identity)
    now_sources = run_record.plugin_sources(identity)
    for name, source in run_record.plugin_sources(existing["run"]).items():
        if (found := now_sources.get(name, "")) != source:
            warnings.warn(changed_source(name, str(folder), source, found), PluginWarning, stacklevel=3)
    status = run_record.read_status(folder)
    _check_made_with(folder, existing, description, finished=status.get("state") == "finished")
    machine, fast = existing.get("machine") or {}, description["machine"]["fast_path"]
    # Folders begun earlier do not say whether it was on.
    learnt = {"threads": machine.get("learning_threads"), "fast path": machine.get("fast_path", fast)}
    before = (existing.get("versions") or {}) | learnt
    now = run_record.package_versions() | {"threads": threads, "fast path": fast}
    if status.get("state") != "finished" and before != now:
        warnings.warn(
            f"{folder} was started with {before} and resumes with {now}: "
            "the numbers may differ from those of an uninterrupted run",
            ResumeWarning,
            stacklevel=3,
        )
    return status


def _check_made_with(folder: Path, existing: dict[str, Any], now: dict[str, Any], finished: bool) -> None:
    """Raise `TrainingError` for an unfinished run of other versions than today's, and warn of a finished one; folders
    from before any were recorded pass."""
    recorded, current = (description.get(run_record.MADE_WITH) or {} for description in (existing, now))
    names = [*dict.fromkeys([*recorded, *current])] if recorded else []
    names = [name for name in names if name in recorded or name not in run_record.RECORDED_LATER]
    other = [f"{name} {recorded.get(name, 'unknown')}, not {current.get(name)}" for name in names
             if recorded.get(name) != current.get(name)]  # fmt: skip
    if not other:
        return
    found = f"{folder} was made with {'; '.join(other)}"
    if not finished:
        raise TrainingError(
            f"{found}: it cannot be resumed, since its numbers would mix both; train it again in another folder"
        )
    warnings.warn(f"{found}; train it again in another folder for today's numbers", ResumeWarning, stacklevel=4)


def result_of(folder: Path, status: dict[str, Any], resumed_from: int | None, already_finished: bool) -> RunResult:
    """Return the result of a run from its status, in which null stands for NaN."""
    names = ("algorithm", "steps", "episodes", "return_mean", "cost_mean", "cost_rate", "seconds")
    values: dict[str, Any] = {name: math.nan if status[name] is None else status[name] for name in names}
    return RunResult(
        folder=folder,
        **values,
        resumed_from=resumed_from,
        already_finished=already_finished,
        warnings=tuple(status["warnings"].values()),
    )


def train_to_end(
    folder: Path, trainer: AnyTrainer, identity: dict[str, Any], *, progress: bool, checkpoint_seconds: float
) -> RunResult:
    """Start or resume a run in its folder, and write its policy at the end; `identity` is that of `open_folder`.

    Raises `TrainingError` if another process is at it.
    """
    with run_record.RUN_FOLDER.locked(folder):
        return _train_to_end(folder, trainer, identity, progress, checkpoint_seconds)


def _train_to_end(
    folder: Path, trainer: AnyTrainer, identity: dict[str, Any], progress: bool, checkpoint_seconds: float
) -> RunResult:
    checkpoint = load_checkpoint(folder)
    if checkpoint is None:
        step, state, log = None, None, RunLog(folder)
    else:
        step, state = checkpoint
        run_record.require_same(folder, state["identity"], identity)
        log = RunLog(folder, kept_bytes=state["bytes"], step=step)
    algorithm = identity["algorithm"]
    status_file = StatusFile(folder, algorithm, trainer)
    if progress and step is not None:
        notice(f"{folder} resumes from step {step:,} of {trainer.steps:,}.")
    keep_freed_memory()
    try:
        trainer.start(state)
        status_file.write("running")
        with ProgressBar(f"{algorithm}, seed {trainer.seed}", trainer.steps, shown=progress) as bar:
            training_loop(trainer, log, bar, status_file, identity, checkpoint_seconds)
        trainer.policy.save(folder / run_record.POLICY)
        status = status_file.write("finished")
    except KeyboardInterrupt:
        status_file.write("interrupted")
        raise
    except Exception as error:
        status_file.write("failed", error)
        raise
    finally:
        log.close()
    return result_of(folder, status, resumed_from=step, already_finished=False)


def load_policy(path: str | Path, device: str = "cpu") -> Any:
    """Return the policy in a run's folder or a policy file, on a device.

    Raises `AlgorithmError` if there is none, with the status of the run.
    """
    return policies.load_policy(policy_file(path), torch.device(resolve_device(device)))


def initialise_policy(policy: Any, file: Path, copied: policies.OptionCopy | None = None) -> dict[str, Any]:
    """Initialise a policy from a policy file, and return what identifies the file, and what is `copied` in it.

    Raises `AlgorithmError` for a planner, and for a file of a policy of another kind.
    """
    if not isinstance(policy, policies.Policy):
        raise AlgorithmError(f"{policy.about.algorithm} is a planner and can't start from the policy of another run")
    other = policies.load_policy(file, policy.device)
    if copied is not None and isinstance(other, policies.Policy):
        other.copy_option(copied)
    policy.initialise_from(other)
    changed = {} if copied is None else {"copied_option": copied._asdict()}
    return {"algorithm": other.about.algorithm, "content": file_hash(file), **changed}


def policy_file(path: str | Path) -> Path:
    """Return the policy file of a run's folder, or the path of a file itself.

    Raises `AlgorithmError` for a folder without a policy.
    """
    path = Path(path)
    if path.is_dir() and not (path / run_record.POLICY).exists():
        if (state := run_record.read_status(path).get("state")) is None:
            raise AlgorithmError(f"{path} is not the folder of a run: it holds no {run_record.POLICY}")
        raise AlgorithmError(
            f"there is no {run_record.POLICY} in {path} ({state}): it is written when the run finishes, and the"
            " command that began the run resumes it"
        )
    return path / run_record.POLICY if path.is_dir() else path
