"""Collectors of rollouts: the interface, and the one for Gymnasium vector environments."""

import time
import warnings
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv

from thalweg.algos.interface import Learner, Rollout
from thalweg.algos.policy.player import to_tensors
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.rollouts.env_attributes import env_attribute
from thalweg.train.rollouts.env_stepper import EnvStepper
from thalweg.train.rollouts.episodes import Episode, EpisodeStatistics
from thalweg.train.rollouts.rollout_buffer import RolloutBuffer


class Collector(Protocol):
    """Steps environments with a learner's actions until there is a rollout to learn from."""

    env: Any
    obs_size: int
    """D, size of one observation."""
    image: tuple[int, int, int] | None
    """H, W, C of the images that observations are rows of; None for observations of numbers."""
    critic_size: int
    """C, how many numbers critics see beyond the observation; 0 if they are not read or there are none."""
    mode: AutoresetMode
    """Autoreset mode of the environment."""
    statistics: EpisodeStatistics
    """Statistics of the episodes so far."""

    @property
    def stages(self) -> dict[str, float]:
        """Seconds spent so far on actions, `act`, and in the environment, `env`."""
        ...

    def reset(self, seed: int) -> None:
        """Reset all environments; their running episodes are discarded."""
        ...

    def step(self, learner: Learner) -> list[Episode]:
        """Take one action in each environment; returns the episodes that are now known to have ended."""
        ...

    @property
    def waiting(self) -> int:
        """Steps of each environment that wait to be learned from, up to `Learner.rollout_steps`."""
        ...

    def rollout(self) -> Rollout:
        """Return those steps on the learner's device; valid until the next step."""
        ...

    def clear(self) -> None:
        """Discard those steps after an update."""
        ...

    def state(self) -> dict[str, Any]:
        """Return what the next step depends on; valid while no step is waiting."""
        ...

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        """Restore a state of `state`.

        An environment without `set_state` starts new episodes from the seed, with a `ResumeWarning`.
        """
        ...


class HostCollector:
    """Steps a Gymnasium vector environment; a complete rollout is copied to the learner's device."""

    def __init__(self, env: VectorEnv, stepper: EnvStepper, device: torch.device, threads: int) -> None:
        """`stepper` steps `env`; `threads` is for acting."""
        self.env, self.stepper, self.device, self.threads = env, stepper, device, threads
        self.obs_size, self.critic_size, self.mode = stepper.obs_size, stepper.critic_size, stepper.mode
        self.image = None if stepper.images is None else stepper.images.image
        self.statistics = EpisodeStatistics(stepper.num_envs, world_names(env), done_reason_names(env))
        self.stages = {"act": 0.0, "env": 0.0}
        self.obs = np.zeros((stepper.num_envs, 0), dtype=np.float32)
        """[N, K * D] observation for the next action; empty before `reset`."""
        self.fresh = np.ones(stepper.num_envs, dtype=bool)
        self._buffer: RolloutBuffer | None = None

    def reset(self, seed: int) -> None:
        self.statistics.discard_running()
        self.obs = self.stepper.reset(env_seeds(seed, self.statistics.steps, self.stepper.num_envs))
        self.fresh = np.ones(self.stepper.num_envs, dtype=bool)

    def step(self, learner: Learner) -> list[Episode]:
        before = time.perf_counter()
        with torch_threads(self.threads):
            raw = learner.act(*to_tensors(self.obs, self.fresh, self.device, self.image is not None))
            actions = learner.policy.actions.to_numpy(raw)
        acted, critic_obs = time.perf_counter(), self.stepper.critic_obs
        step = self.stepper.step(actions)
        after = time.perf_counter()
        # Gymnasium leaves out of `info` what no environment reports, such as costs where all only reset themselves.
        by_kind = step.costs if step.costs is not None or step.valid.any() else np.zeros((len(step.cost), 2))
        costs = costs_to_learn(learner, step.cost, by_kind)
        if self._buffer is None:
            self._buffer = RolloutBuffer(learner.rollout_steps, self.obs, raw, costs, self.device, critic_obs)
        self._buffer.add(self.obs, self.fresh, raw, step, costs, critic_obs)
        self.obs, self.fresh = step.next_obs, step.fresh
        self.stages["act"] += acted - before
        self.stages["env"] += after - acted
        return self.statistics.add(step)

    @property
    def waiting(self) -> int:
        return 0 if self._buffer is None else self._buffer.filled

    def rollout(self) -> Rollout:
        if self._buffer is None:
            raise TrainingError("there are no steps to learn from")
        return self._buffer.rollout()

    def clear(self) -> None:
        if self._buffer is not None:
            self._buffer.clear()

    def state(self) -> dict[str, Any]:
        getter = getattr(self.env, "get_state", None)
        environment = {} if getter is None else {"environment": dict(getter())}
        return environment | {"stream": self.stepper.state(), "obs": self.obs.copy(), "fresh": self.fresh.copy()}

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        if "environment" in state and hasattr(self.env, "set_state"):
            self.env.set_state(state["environment"])  # pyright: ignore[reportAttributeAccessIssue]
            self.stepper.load_state(state["stream"])
            kind = np.float32 if self.image is None else np.uint8
            self.obs, self.fresh = np.array(state["obs"], dtype=kind), np.array(state["fresh"], dtype=bool)
            return
        warn_of_new_episodes()
        self.reset(seed)


def warn_of_new_episodes() -> None:
    """Warn that an environment cannot be restored from a checkpoint."""
    warnings.warn(
        "the environment has no get_state and set_state: the run resumes with new episodes and will not end with the "
        "same numbers as an uninterrupted one",
        ResumeWarning,
        stacklevel=7,
    )


def costs_to_learn(learner: Learner, cost: Any, costs: Any) -> Any:
    """Return the costs [N, M] that a learner uses, from their sum [N] and, if the environment reports them, the costs
    by kind [N, K]; raises `TrainingError` if the learner needs tight and loose ones and they are missing or not all."""
    if not learner.separate_costs:
        return cost[:, None]
    if costs is None:
        raise TrainingError(
            "cost_limits are limits of tight and loose costs, but the environment does not report them separately: "
            "info['costs'] [N, 2] is needed at every step"
        )
    if costs.shape[1] != 2:
        raise TrainingError(
            f"cost_limits are limits of tight and loose costs, but this task has {costs.shape[1]} kinds of cost: give"
            " cost_limit, that of their sum"
        )
    return costs


def env_seeds(seed: int, steps: int, count: int) -> list[int]:
    """Return one seed for each environment of a run that starts new episodes after `steps` steps.

    Gymnasium seeds environment i with seed + i if it is given a single number, so that runs of consecutive seeds would
    share all environments but one. The seeds have 31 bits, because some environments do not accept more.
    """
    return [int(word) >> 1 for word in np.random.SeedSequence([seed, steps]).generate_state(count)]


def world_names(env: Any) -> list[str]:
    """Return the name and seed of the world of each environment [N], or empty strings.

    If the environments change river, they are those of all rivers, see `StepRecord.rivers`.
    """
    base: Any = getattr(env, "unwrapped", env)
    if names := getattr(base, "river_names", None):
        return names
    worlds, index = getattr(base, "worlds", None), getattr(base, "world_index", None)
    if worlds is None or index is None:
        return [""] * env.num_envs
    return [worlds[i].label for i in index]


def done_reason_names(env: Any) -> Mapping[int, str]:
    """Return the environment's names for the codes of `info["done_reason"]`; empty if it has none."""
    return env_attribute(env, "done_reasons", {})
