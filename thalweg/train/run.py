"""Training runs: `run` trains an algorithm on an environment and writes a folder, from which it also resumes."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import torch
from gymnasium.vector import VectorEnv

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU
from thalweg.algos.constraint.cost_limits import check_cost_episodes
from thalweg.algos.interface import Learner, Task
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.onpolicy.config import settings_like
from thalweg.algos.policy import policy as policies
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.registry import Entry, algorithm_named, plugin_named
from thalweg.core import versions
from thalweg.core.compute.device import DeviceError, resolve_device
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.core.config import to_plain
from thalweg.core.notices import notice
from thalweg.train.episode_bounds import bounds_in_words, with_declared_bounds
from thalweg.train.errors import ShortRunWarning, TrainingError
from thalweg.train.folder import run_record
from thalweg.train.rollouts.collector import Collector
from thalweg.train.rollouts.images import check_rollout_memory
from thalweg.train.rollouts.tensor_collector import TensorEnv, make_collector
from thalweg.train.run_in_folder import (
    RunResult,
    check_numbers,
    check_seconds,
    initialise_policy,
    open_folder,
    policy_file,
    result_of,
    train_to_end,
)
from thalweg.train.trainer import Trainer

FEW_UPDATES = 5
"""Fewest updates of a run that is not warned of."""


class CommonExecution(TypedDict, total=False):
    """Keyword arguments of `run`, and of `RiverTraining.train`, for where it executes and with which policy it
    starts; defaults are those of `Execution`."""

    device: str
    begin_with: str | Path | None
    graphs: bool


class ExecutionOptions(CommonExecution, total=False):
    """Keyword arguments of `run` for how and where it executes."""

    progress: bool
    checkpoint_seconds: float
    threads: int
    copied_option: policies.OptionCopy | None


@dataclass(frozen=True)
class Execution:
    """How and where a run executes, and with which policy it starts; see `run`."""

    progress: bool = False
    checkpoint_seconds: float = 20.0
    threads: int = 1
    device: str = "cpu"
    begin_with: str | Path | None = None
    graphs: bool = False
    copied_option: policies.OptionCopy | None = None


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
        algorithm: A name in `thalweg.algos.registry.ALGORITHMS` or that of a plug-in, in upper or lower case.
        env: A Gymnasium vector environment with vectors as observations, or with policy=cnn images, and `info["cost"]`
            [N], or an environment of tensors; it is not closed.
        steps: Minimum number of steps, all environments together.
        seed: Seed of the environment and the algorithm, 0 or more; global random generators are not used.
        folder: Folder of the run; created if it does not exist.
        config: The algorithm's config, or a mapping of some of its keys on top of the preset. Defaults follow the
            number of environments above 16, see `thalweg.algos.presets`.
        preset: `default`, or `paper` for the settings of the study.
        context: Plain data to store in the policy file and config.yaml.
        progress: Whether to show a progress bar; not by default.
        checkpoint_seconds: Minimum time between two checkpoints, 20 s by default; 0 writes one after every update.
        threads: Number of PyTorch threads for acting and learning, 1 by default; small networks are slower with more.
        device: Device of the learner and of an environment of tensors, "cpu" by default; see `core.compute.device`.
        begin_with: Folder of a run or policy file from which the policy is initialised; critics start anew, and learn
            alone during the config's `critic_warmup_steps`.
        copied_option: Option that means something else here than for the policy to begin with, see `OptionCopy`; none
            by default.
        graphs: Whether to record gradient steps of DDPGLag, TD3Lag and SACLag as CUDA graphs; not by default.

    Raises:
        AlgorithmError, PluginError, TrainingError, DeviceError: Before anything runs, for a bad argument or folder.
        NotFiniteError: As soon as a number that learning depends on is NaN; the last good checkpoint remains.
        TypeError: For an unknown keyword argument.
    """
    how = _execution(execution)
    entry = algorithm_named(algorithm)
    # Environments without a number of them are refused below.
    resolved = configured(entry, config, preset, getattr(env, "num_envs", 1), how.begin_with)
    given, resolved = resolved, with_declared_bounds(resolved, env)
    steps, threads, seed = check_numbers(steps=(steps, 1), threads=(how.threads, 1), seed=(seed, 0))
    check_seconds(checkpoint_seconds=how.checkpoint_seconds)
    how = replace(how, threads=threads)
    context = _whole_context(context, entry)
    device = torch.device(resolve_device(how.device))
    if how.graphs:
        _check_graphs(entry, device)
    images = sees_images(resolved)
    collector = make_collector(env, resolved.frame_stack, device, how.threads, has_asymmetric_critics(resolved), images)
    task = Task(collector.obs_size, env.single_action_space, env.num_envs, seed, context, device)
    task = replace(task, graphs=how.graphs, critic_size=collector.critic_size, image=collector.image)
    with torch_threads(1):  # the last bits of orthogonal weights depend on the number of threads
        learner = entry.make(resolved, task)
    if images:
        check_rollout_memory(learner.rollout_steps, task.num_envs, task.obs_size)
    settings = {"algorithm": entry.name, "preset": preset, "config": to_plain(resolved), "steps": steps, "seed": seed}
    identity = settings | _task_identity(task, learner, collector)
    if how.begin_with is not None:
        check_warmup(resolved, steps, task.num_envs)
        identity["begin_with"] = initialise_policy(learner.policy, policy_file(how.begin_with), how.copied_option)
        learner.warm_up_critics()
    elif how.copied_option is not None:
        raise AlgorithmError(
            f"copied_option = {tuple(how.copied_option)} is for a policy that a run begins with: give begin_with, or"
            " leave it out"
        )
    elif getattr(resolved, "imitation_kl", 0.0):
        raise AlgorithmError(
            f"imitation_kl = {resolved.imitation_kl} weighs the KL from the policy that a run begins with: give"
            " begin_with, or leave it out"
        )
    status = open_folder(folder := Path(folder), identity, how.threads, _version_of(entry), str(task.device))
    if status.get("state") == "finished":
        return result_of(folder, status, resumed_from=None, already_finished=True)
    if found := too_short(resolved, steps, task.num_envs):
        warnings.warn(found, ShortRunWarning, stacklevel=2)
    if how.progress and (line := bounds_in_words(resolved, given)):
        notice(line)
    trainer = Trainer(collector, learner, steps, seed, how.threads)
    return train_to_end(folder, trainer, identity, progress=how.progress, checkpoint_seconds=how.checkpoint_seconds)


def configured(entry: Entry, config: Any, preset: str, num_envs: int, begin_with: str | Path | None = None) -> Any:
    """Return the config of a run, see `Entry.configure`.

    With policy=cnn, settings of the network that are not given follow from the policy that the run begins with. Raises
    `AlgorithmError` for a config that is wrong, and a policy file that cannot be read.
    """
    if begin_with is not None and isinstance(config, Mapping) and config.get("policy") == "cnn":
        shape = getattr(policies.load_policy(policy_file(begin_with), CPU), "shape", None)
        if isinstance(shape, NetworkShape):
            config = settings_like(shape) | dict(config)
    resolved = entry.configure(config, preset, num_envs)
    check_cost_episodes(resolved, num_envs)
    return resolved


def _whole_context(context: Mapping[str, Any] | None, entry: Entry) -> dict[str, Any]:
    """Return a context with the plug-in that the algorithm is, if any; raises `TrainingError` for what is no mapping,
    and see `check_context`."""
    if context is not None and not isinstance(context, Mapping):
        raise TrainingError(f"context must be a mapping, or None for an empty one, got {context!r:.60}")
    whole = {**(context or {}), **made_by(entry)}
    run_record.check_context(whole)
    return whole


def _version_of(entry: Entry) -> dict[str, int]:
    """Return the version of an algorithm of the package by its name; empty for a plug-in, whose is in the context."""
    return {name: version for name, version in versions.ALGORITHMS.items() if name == entry.name}


def made_by(entry: Entry) -> dict[str, Any]:
    """Return the entry of a context that says from which version and source of a plug-in a policy is; empty for an
    algorithm of the package."""
    plugin = plugin_named(entry.name)
    return {} if plugin is None else {run_record.PLUGIN: plugin.as_data()}


def sees_images(config: Any) -> bool:
    """Return whether the policy of an algorithm with a config sees images."""
    return bool(getattr(config, "sees_images", False))


def has_asymmetric_critics(config: Any) -> bool:
    """Return whether the critics of an algorithm with a config see more than the observation; planners have none that
    do."""
    return bool(getattr(config, "told_critics", getattr(config, "asymmetric_critics", False)))


def tells_cost_critics(config: Any) -> bool:
    """Return whether an algorithm with a config has critics of costs, and these see more than the observation."""
    return has_asymmetric_critics(config) and hasattr(config, "cost_limit")


def _execution(options: ExecutionOptions) -> Execution:
    """Return the execution options with their defaults; raises `TypeError` for an unknown keyword of `run`."""
    unknown = sorted(set(options) - {field.name for field in fields(Execution)})
    if unknown:
        raise TypeError(f"run() got an unexpected keyword argument {unknown[0]!r}")
    return Execution(**options)


def _check_graphs(entry: Entry, device: torch.device) -> None:
    """Raise `AlgorithmError` or `DeviceError` if gradient steps cannot be recorded as CUDA graphs."""
    if not issubclass(entry.config, OffPolicyConfig):
        raise AlgorithmError(f"graphs are for DDPGLag, TD3Lag and SACLag; steps of {entry.name} are not recorded")
    if device.type != "cuda":
        raise DeviceError(f"graphs are recorded on a GPU only, not on {device}")


def check_warmup(config: Any, steps: int, num_envs: int) -> None:
    """Raise `TrainingError` if no rollout begins after the warm-up of critics, in a run that begins with another
    policy."""
    warmup, rollout = getattr(config, "warmup_steps", 0), config.rollout_steps(num_envs) * num_envs
    last = (steps - 1) // rollout * rollout
    if warmup > last:
        given = config.critic_warmup_steps
        most = last - (warmup - given)
        if most < 0:
            raise TrainingError(
                f"random_steps must be at most {last} in a run of {steps} steps that begins with another policy, got"
                f" {config.random_steps}: all actions would be random; take more steps, or set random_steps"
            )
        raise TrainingError(
            f"critic_warmup_steps must be at most {most} in a run of {steps} steps that begins with another policy, "
            f"got {given} for {num_envs} environments: only the critics learn during the warm-up, so that the policy "
            "would never change; take more steps, or set critic_warmup_steps"
        )


def too_short(config: Any, steps: int, num_envs: int) -> str:
    """Return a warning of a run with fewer than `FEW_UPDATES` updates, or with random actions alone; empty for a longer
    one."""
    if steps <= (random := getattr(config, "random_steps", 0)):
        return (
            f"all actions of a run of {steps:,} steps are random, since random_steps is {random:,}: nothing is learnt"
            " from what a policy does; take more steps, or set random_steps"
        )
    rollout = config.rollout_steps(num_envs) * num_envs
    updates, enough = -(-steps // rollout), FEW_UPDATES * rollout
    if updates >= FEW_UPDATES:
        return ""
    return (
        f"{steps:,} steps are {updates} update{'s' if updates > 1 else ''} of {rollout:,} steps each, from which hardly"
        f" anything is learnt; take {enough:,} steps or more"
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
    if task.image is not None:
        identity["image"] = list(task.image)
        # Runs of earlier versions lack the key: they did not scale the last options of branches with many.
        if isinstance(learner.policy, policies.Policy) and learner.policy.scales_options:
            identity[policies.LAST_OPTIONS] = policies.SCALED
    if task.critic_size:
        identity["critic_size"] = task.critic_size
    identity |= run_record.device_identity(task.device.type)
    if task.graphs:  # on a GPU only
        identity["graphs"] = True
    return identity
