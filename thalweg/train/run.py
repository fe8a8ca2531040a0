"""How does an algorithm learn on an environment? The loop, and the folder that it leaves behind."""

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from gymnasium.vector import VectorEnv

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Learner, Task
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.policy import policy as policies
from thalweg.algos.registry import Entry, algorithm_named
from thalweg.core.cache import file_hash
from thalweg.core.config import to_plain
from thalweg.core.device import DeviceError, resolve_device
from thalweg.core.torch_threads import torch_threads
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.folder import run_record as record
from thalweg.train.folder.checkpoint import load_checkpoint, save_checkpoint
from thalweg.train.folder.loggers import RunLog
from thalweg.train.folder.progress import Progress
from thalweg.train.rollouts.torch_collector import TensorEnv, collector_for
from thalweg.train.run_state import Training

CHECKPOINT_SHARE = 20
"""A checkpoint that takes long, as that of a large replay, is made at most once in so many times its duration."""


@dataclass(frozen=True)
class RunResult:
    """How a run ended."""

    folder: Path
    algorithm: str
    steps: int
    """Steps taken, all environments together: the number asked for, rounded up to a step of every environment, or to a
    whole rollout of environments of tensors."""
    episodes: int
    return_mean: float
    """Mean undiscounted return of the last 50 episodes; NaN before any."""
    cost_mean: float
    """Mean undiscounted cost of the same."""
    cost_rate: float
    """Episodes that ended with a cost, per step."""
    seconds: float
    """Time taken, over all interruptions."""
    resumed_from: int | None
    """The step that this call went on from; None for a run begun by it."""
    already_finished: bool
    """Whether there was nothing left to do."""
    warnings: tuple[str, ...]
    """What could not work, such as a limit that never binds."""

    @property
    def policy(self) -> Any:
        """The trained policy."""
        return load_policy(self.folder)


def run(
    algorithm: str,
    env: VectorEnv | TensorEnv,
    *,
    steps: int,
    seed: int,
    folder: str | Path,
    config: Any = None,
    preset: str = "default",
    context: Mapping[str, Any] | None = None,
    progress: bool = False,
    checkpoint_seconds: float = 20.0,
    threads: int = 1,
    device: str = "cpu",
    begin_with: str | Path | None = None,
    graphs: bool = False,
) -> RunResult:
    """Train, and leave config.yaml, metrics.csv, episodes.csv, TensorBoard, checkpoints and policy.safetensors in
    `folder`.

    Interrupted at any moment, the same call goes on from the last checkpoint and ends with the same numbers; a
    finished run is recognised and returned at once.

    Args:
        algorithm: A name in `thalweg.algos.registry.ALGORITHMS`, in any case.
        env: A Gymnasium vector environment with vectors for observations and `info["cost"]` [N], or one of tensors; it
            is not closed.
        steps: At least so many, all environments together.
        seed: 0 or more; of the environment and of the algorithm; the global random generators are neither used nor set.
        folder: Made if it does not exist.
        config: The algorithm's config, or a mapping of some of its keys, which are set on top of the preset; of more
            than 64 environments the others follow their number, see `thalweg.algos.presets`.
        preset: `default`, or `paper`: what the study ran, quirks included.
        context: Plain data kept in the policy's file and in config.yaml, such as the encoder's name.
        progress: Whether a progress bar is shown.
        checkpoint_seconds: Least time between two checkpoints, 0 for one after every update; it has no influence on
            the numbers.
        threads: Of acting and learning; small networks are slower with more than one.
        device: Where it learns, see `thalweg.core.device`; an environment of tensors must be there already.
        begin_with: A run's folder or a policy file: the policy begins as that one, such as PPO's for an algorithm with
            a limit, or one of an easier river; critics and all else begin anew.
        graphs: Whether gradient steps of DDPGLag, TD3Lag and SACLag are recorded and replayed on a GPU, which is then
            asked for many operations at once.

    Raises `AlgorithmError`, `TrainingError` or `DeviceError` before anything runs for a wrong name, key, number, space,
    folder or device, and `NotFiniteError` as soon as a number that learning depends on is NaN; the last good checkpoint
    stays.
    """
    entry = algorithm_named(algorithm)
    resolved = entry.configure(config, preset, getattr(env, "num_envs", 1))  # what has none is refused below
    for name, number, least in (("steps", steps, 1), ("threads", threads, 1), ("seed", seed, 0)):
        if number < least:
            raise TrainingError(f"{name} must {f'be at least {least}' if least else 'not be negative'}, got {number}")
    place, context = torch.device(resolve_device(device)), dict(context or {})
    if graphs:
        _check_graphs(entry, place)
    collector = collector_for(env, resolved.frame_stack, place, threads)
    task = Task(collector.obs_size, env.single_action_space, env.num_envs, seed, context, place, graphs)
    with torch_threads(1):  # the last bits of orthogonal weights would depend on their number
        learner = entry.make(resolved, task)
    identity = {
        "algorithm": entry.name,
        "preset": preset,
        "config": to_plain(resolved),
        "steps": steps,
        "seed": seed,
        "num_envs": env.num_envs,
        "obs_size": collector.obs_size,
        "actions": learner.policy.actions.as_data(),
        "autoreset_mode": collector.mode.name,
        "context": context,
    } | ({} if place.type == "cpu" else {"device": place.type} | ({"graphs": True} if graphs else {}))
    if begin_with is not None:
        identity["begin_with"] = _begin_as(learner, policy_file(begin_with))
    folder = Path(folder)
    status = _claim(folder, identity, threads)
    if status.get("state") == "finished":
        return _result(folder, status, resumed_from=None, already_finished=True)
    saved = load_checkpoint(folder)
    if saved is not None:
        record.require_same(folder, saved[1]["identity"], identity)
    training = Training(collector, learner, steps, seed, threads)
    log = RunLog(folder) if saved is None else RunLog(folder, kept=saved[1]["bytes"], step=saved[0])
    report = _Report(folder, entry.name, training)
    try:
        training.begin(None if saved is None else saved[1])
        report.status("running")
        with Progress(f"{entry.name}, seed {seed}", steps, shown=progress) as bar:
            _learn(training, log, bar, report, identity, checkpoint_seconds)
        learner.policy.save(folder / record.POLICY)
        status = report.status("finished")
    except KeyboardInterrupt:
        report.status("interrupted")
        raise
    except Exception as error:
        report.status("failed", error)
        raise
    finally:
        log.close()
    return _result(folder, status, resumed_from=saved[0] if saved else None, already_finished=False)


def _check_graphs(entry: Entry, place: torch.device) -> None:
    """Raise `AlgorithmError` or `DeviceError` where no gradient step could be recorded."""
    if not issubclass(entry.config, OffPolicyConfig):
        raise AlgorithmError(f"graphs are for DDPGLag, TD3Lag and SACLag; steps of {entry.name} are not recorded")
    if place.type != "cuda":
        raise DeviceError(f"graphs are recorded on a GPU only, not on {place}")


def load_policy(path: str | Path, device: str = "cpu") -> Any:
    """The policy in a run's folder or a policy file, on a device; raises `AlgorithmError` if there is none, naming how
    the run stands."""
    return policies.load_policy(policy_file(path), torch.device(resolve_device(device)))


def policy_file(path: str | Path) -> Path:
    """The policy file of a run's folder, or the path itself; raises `AlgorithmError` for a folder without one."""
    path = Path(path)
    if path.is_dir() and not (path / record.POLICY).exists():
        state = record.read_status(path).get("state", "not a run")
        raise AlgorithmError(f"there is no {record.POLICY} in {path} ({state}): it is written when a run finishes")
    return path / record.POLICY if path.is_dir() else path


def _begin_as(learner: Learner, file: Path) -> dict[str, str]:
    """Let a learner's policy begin as that of a file; returns what tells this policy from others."""
    other, own = policies.load_policy(file, CPU), learner.policy
    if not isinstance(own, policies.Policy):
        raise AlgorithmError(f"{own.about.algorithm} plans, and can't begin with another policy")
    own.initialise_from(other)
    return {"algorithm": other.about.algorithm, "content": file_hash(file)}


def _learn(
    training: Training, log: RunLog, bar: Progress, report: "_Report", identity: dict, checkpoint_seconds: float
) -> None:
    """Step and update until the steps are done; checkpoints lie between updates only."""
    clock = _Clock(training)
    saved_at, pause = float("-inf"), checkpoint_seconds
    while not training.done:
        for episode in training.step():
            log.episode(episode)
        bar.show(training)
        if not training.ready:
            continue
        metrics = training.update()
        if metrics:
            row = {"steps": training.book.steps, "update": training.updates} | training.book.metrics() | metrics
            log.update(training.book.steps, row | clock.lap())
        before = time.perf_counter()
        if training.done or before - saved_at >= pause:
            state = training.state() | {"identity": identity, "bytes": log.sync()}
            save_checkpoint(report.folder, training.book.steps, state)
            report.status("running")
            saved_at = time.perf_counter()
            pause = max(checkpoint_seconds, CHECKPOINT_SHARE * (saved_at - before)) if checkpoint_seconds else 0.0


class _Clock:
    """Where the time between two updates went."""

    def __init__(self, training: Training) -> None:
        self.training = training
        self._at, self._steps = time.perf_counter(), training.book.steps
        self._stages = self._now()

    def lap(self) -> dict[str, float]:
        """Steps a second and seconds of each stage since the last lap; `time_other` is files, bookkeeping and
        checkpoints."""
        now, stages = time.perf_counter(), self._now()
        wall, steps = now - self._at, self.training.book.steps - self._steps
        spent = {f"time_{name}": stages[name] - self._stages[name] for name in stages}
        self.training.seconds += wall
        self._at, self._steps, self._stages = now, self.training.book.steps, stages
        other = wall - sum(spent.values())
        return {"steps_per_second": steps / wall, **spent, "time_other": other, "seconds": self.training.seconds}

    def _now(self) -> dict[str, float]:
        """Seconds so far, the encoder's told from the environment's if it stands between them."""
        stages = dict(self.training.stages)
        encode = getattr(self.training.collector.env, "stage_seconds", {}).get("encode", 0.0)
        return stages | {"env": stages["env"] - encode, "encode": encode}


class _Report:
    """Keeps status.json."""

    def __init__(self, folder: Path, algorithm: str, training: Training) -> None:
        self.folder, self.algorithm, self.training = folder, algorithm, training

    def status(self, state: str, error: BaseException | None = None) -> dict[str, Any]:
        """Write how the run stands; returns it."""
        training, metrics = self.training, self.training.book.metrics()
        status = {
            "state": state,
            "algorithm": self.algorithm,
            "steps": training.book.steps,
            "episodes": training.book.count,
            "return_mean": metrics["return_mean_50"],
            "cost_mean": metrics["cost_mean_50"],
            "cost_rate": metrics["cost_rate"],
            "seconds": training.seconds,
            "warnings": training.warned,
        }
        if error is not None:
            status["error"] = f"{type(error).__name__}: {error}"
        record.write_status(self.folder, status)
        return status


def _claim(folder: Path, identity: dict[str, Any], threads: int) -> dict[str, Any]:
    """Make sure that the folder is this run's, new or begun; returns its status."""
    description = record.describe(identity, threads)
    begun = record.read_config(folder)
    if begun is None:
        record.write_config(folder, description)
        return {}
    record.require_same(folder, begun["run"], identity)
    status = record.read_status(folder)
    there = begun["versions"] | {"threads": begun["machine"]["learning_threads"]}
    here = record.package_versions() | {"threads": threads}
    if status.get("state") != "finished" and there != here:
        warnings.warn(
            f"{folder} was begun with {there} and goes on with {here}: "
            "the numbers may differ from those of an unbroken run",
            ResumeWarning,
            stacklevel=3,
        )
    return status


def _result(folder: Path, status: dict[str, Any], resumed_from: int | None, already_finished: bool) -> RunResult:
    names = ("algorithm", "steps", "episodes", "return_mean", "cost_mean", "cost_rate", "seconds")
    said: dict[str, Any] = {name: math.nan if status[name] is None else status[name] for name in names}
    return RunResult(
        folder=folder,
        **said,
        resumed_from=resumed_from,
        already_finished=already_finished,
        warnings=tuple(status["warnings"].values()),
    )
