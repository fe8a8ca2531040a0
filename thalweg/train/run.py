"""Training runs: `run` trains an algorithm on an environment and writes a folder, from which it also resumes."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import torch
from gymnasium.vector import VectorEnv

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Learner, Task
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.policy import policy as policies
from thalweg.algos.registry import Entry, algorithm_named
from thalweg.core.cache import file_hash
from thalweg.core.compute.device import DeviceError, resolve_device
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.config import to_plain
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.folder import run_record
from thalweg.train.folder.checkpoint import load_checkpoint
from thalweg.train.folder.loggers import RunLog
from thalweg.train.folder.progress_bar import ProgressBar
from thalweg.train.loop import StatusFile, training_loop
from thalweg.train.rollouts.collector import Collector
from thalweg.train.rollouts.tensor_collector import TensorEnv, make_collector
from thalweg.train.trainer import Trainer


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


class ExecutionOptions(TypedDict, total=False):
    """Keyword arguments of `run` for how and where it executes; defaults are those of `Execution`."""

    progress: bool
    checkpoint_seconds: float
    threads: int
    device: str
    begin_with: str | Path | None
    graphs: bool


@dataclass(frozen=True)
class Execution:
    """How and where a run executes, and with which policy it starts; see `run`."""

    progress: bool = False
    checkpoint_seconds: float = 20.0
    threads: int = 1
    device: str = "cpu"
    begin_with: str | Path | None = None
    graphs: bool = False


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
    **execution: Unpack[ExecutionOptions],
) -> RunResult:
    """Train, and write settings, metrics, checkpoints and the policy to `folder`.

    If a run is interrupted at any moment, the same call resumes from the last checkpoint and ends with the same
    numbers. A finished run is returned at once.

    Args:
        algorithm: A name in `thalweg.algos.registry.ALGORITHMS`, in upper or lower case.
        env: A Gymnasium vector environment with vectors as observations and `info["cost"]` [N], or an environment of
            tensors; it is not closed.
        steps: Minimum number of steps, all environments together.
        seed: Seed of the environment and the algorithm, 0 or more; global random generators are not used.
        folder: Folder of the run; created if it does not exist.
        config: The algorithm's config, or a mapping of some of its keys on top of the preset. Defaults follow the
            number of environments above 64, see `thalweg.algos.presets`.
        preset: `default`, or `paper` for the settings of the study.
        context: Plain data to store in the policy file and config.yaml.
        progress: Whether to show a progress bar; not by default.
        checkpoint_seconds: Minimum time between two checkpoints, 20 s by default; 0 writes one after every update.
        threads: Number of PyTorch threads for acting and learning, 1 by default; small networks are slower with more.
        device: Device of the learner and of an environment of tensors, "cpu" by default; see `core.compute.device`.
        begin_with: Folder of a run or policy file from which the policy is initialised; critics start anew, and learn
            alone during the config's `critic_warmup_steps`.
        graphs: Whether to record gradient steps of DDPGLag, TD3Lag and SACLag as CUDA graphs; not by default.

    Raises:
        AlgorithmError, TrainingError, DeviceError: Before anything runs, for an invalid argument or folder.
        NotFiniteError: As soon as a number that learning depends on is NaN; the last good checkpoint remains.
        TypeError: For an unknown keyword argument.
    """
    how = _execution(execution)
    entry = algorithm_named(algorithm)
    resolved = entry.configure(config, preset, getattr(env, "num_envs", 1))  # other environments are refused below
    _check_numbers(steps=(steps, 1), threads=(how.threads, 1), seed=(seed, 0))
    device, context = torch.device(resolve_device(how.device)), dict(context or {})
    if how.graphs:
        _check_graphs(entry, device)
    collector = make_collector(env, resolved.frame_stack, device, how.threads, has_asymmetric_critics(resolved))
    task = Task(collector.obs_size, env.single_action_space, env.num_envs, seed, context, device)
    task = replace(task, graphs=how.graphs, critic_size=collector.critic_size)
    with torch_threads(1):  # the last bits of orthogonal weights depend on the number of threads
        learner = entry.make(resolved, task)
    settings = {"algorithm": entry.name, "preset": preset, "config": to_plain(resolved), "steps": steps, "seed": seed}
    identity = settings | _task_identity(task, learner, collector)
    if how.begin_with is not None:
        _check_warmup(getattr(resolved, "critic_warmup_steps", 0), steps, learner.rollout_steps * task.num_envs)
        identity["begin_with"] = _initialise_policy(learner, policy_file(how.begin_with))
    status = _open_folder(folder := Path(folder), identity, how.threads)
    if status.get("state") == "finished":
        return _result(folder, status, resumed_from=None, already_finished=True)
    trainer = Trainer(collector, learner, steps, seed, how.threads)
    return _train(folder, entry.name, trainer, identity, how)


def has_asymmetric_critics(config: Any) -> bool:
    """Return whether the critics of an algorithm with a config see more than the observation; planners have none that
    do."""
    return bool(getattr(config, "asymmetric_critics", False))


def _execution(options: ExecutionOptions) -> Execution:
    """Return the execution options with their defaults; raises `TypeError` for an unknown keyword of `run`."""
    unknown = sorted(set(options) - {field.name for field in fields(Execution)})
    if unknown:
        raise TypeError(f"run() got an unexpected keyword argument {unknown[0]!r}")
    return Execution(**options)


def _check_numbers(**numbers: tuple[int, int]) -> None:
    """Raise `TrainingError` for a (number, minimum) below its minimum."""
    for name, (number, minimum) in numbers.items():
        if number < minimum:
            required = f"be at least {minimum}" if minimum else "not be negative"
            raise TrainingError(f"{name} must {required}, got {number}")


def _check_graphs(entry: Entry, device: torch.device) -> None:
    """Raise `AlgorithmError` or `DeviceError` if gradient steps cannot be recorded as CUDA graphs."""
    if not issubclass(entry.config, OffPolicyConfig):
        raise AlgorithmError(f"graphs are for DDPGLag, TD3Lag and SACLag; steps of {entry.name} are not recorded")
    if device.type != "cuda":
        raise DeviceError(f"graphs are recorded on a GPU only, not on {device}")


def _check_warmup(warmup: int, steps: int, rollout: int) -> None:
    """Raise `TrainingError` if no rollout begins after the critics' warm-up; `rollout`: steps of one, all environments
    together."""
    most = (steps - 1) // rollout * rollout
    if warmup > most:
        raise TrainingError(
            f"critic_warmup_steps must be at most {most} in a run of {steps} steps that begins with another policy, "
            f"got {warmup}: only the critics learn during the warm-up, so that the policy would never change"
        )


def _task_identity(task: Task, learner: Learner, collector: Collector) -> dict[str, Any]:
    """Return what distinguishes the environment of a run from others, as config.yaml has it."""
    identity: dict[str, Any] = {
        "num_envs": task.num_envs,
        "obs_size": collector.obs_size,
        "actions": learner.policy.actions.as_data(),
        "autoreset_mode": collector.mode.name,
        "context": task.context,
    }
    if task.critic_size:
        identity["critic_size"] = task.critic_size
    if task.device.type != "cpu":
        identity |= {"device": task.device.type} | ({"graphs": True} if task.graphs else {})
    return identity


def _train(folder: Path, algorithm: str, trainer: Trainer, identity: dict[str, Any], how: Execution) -> RunResult:
    """Start or resume a run in its folder, and write its policy at the end."""
    checkpoint = load_checkpoint(folder)
    if checkpoint is None:
        step, state, log = None, None, RunLog(folder)
    else:
        step, state = checkpoint
        run_record.require_same(folder, state["identity"], identity)
        log = RunLog(folder, kept_bytes=state["bytes"], step=step)
    status_file = StatusFile(folder, algorithm, trainer)
    try:
        trainer.start(state)
        status_file.write("running")
        with ProgressBar(f"{algorithm}, seed {trainer.seed}", trainer.steps, shown=how.progress) as bar:
            training_loop(trainer, log, bar, status_file, identity, how.checkpoint_seconds)
        trainer.learner.policy.save(folder / run_record.POLICY)
        status = status_file.write("finished")
    except KeyboardInterrupt:
        status_file.write("interrupted")
        raise
    except Exception as error:
        status_file.write("failed", error)
        raise
    finally:
        log.close()
    return _result(folder, status, resumed_from=step, already_finished=False)


def load_policy(path: str | Path, device: str = "cpu") -> Any:
    """Return the policy in a run's folder or a policy file, on a device.

    Raises `AlgorithmError` if there is none, with the status of the run.
    """
    return policies.load_policy(policy_file(path), torch.device(resolve_device(device)))


def policy_file(path: str | Path) -> Path:
    """Return the policy file of a run's folder, or the path of a file itself.

    Raises `AlgorithmError` for a folder without a policy.
    """
    path = Path(path)
    if path.is_dir() and not (path / run_record.POLICY).exists():
        state = run_record.read_status(path).get("state", "not a run")
        raise AlgorithmError(f"there is no {run_record.POLICY} in {path} ({state}): it is written when a run finishes")
    return path / run_record.POLICY if path.is_dir() else path


def _initialise_policy(learner: Learner, file: Path) -> dict[str, str]:
    """Initialise a learner's policy from a policy file, so that its critics warm up; returns what identifies the
    file."""
    other, started = policies.load_policy(file, CPU), learner.policy
    if not isinstance(started, policies.Policy):
        raise AlgorithmError(f"{started.about.algorithm} is a planner and can't start from the policy of another run")
    started.initialise_from(other)
    learner.warm_up_critics()
    return {"algorithm": other.about.algorithm, "content": file_hash(file)}


def _open_folder(folder: Path, identity: dict[str, Any], threads: int) -> dict[str, Any]:
    """Create the folder of a run, or check that an existing one is of the same run; returns its status.

    Raises `TrainingError` for the folder of another run, and warns if versions or threads have changed.
    """
    description = run_record.describe(identity, threads)
    existing = run_record.read_config(folder)
    if existing is None:
        run_record.write_config(folder, description)
        return {}
    run_record.require_same(folder, existing["run"], identity)
    status = run_record.read_status(folder)
    before = existing["versions"] | {"threads": existing["machine"]["learning_threads"]}
    now = run_record.package_versions() | {"threads": threads}
    if status.get("state") != "finished" and before != now:
        warnings.warn(
            f"{folder} was started with {before} and resumes with {now}: "
            "the numbers may differ from those of an uninterrupted run",
            ResumeWarning,
            stacklevel=3,
        )
    return status


def _result(folder: Path, status: dict[str, Any], resumed_from: int | None, already_finished: bool) -> RunResult:
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
