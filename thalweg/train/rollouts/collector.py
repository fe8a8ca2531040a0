"""Who takes the steps that a learner learns from? One asks for an action at a time, until there are enough."""

import time
import warnings
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from thalweg.algos.interface import Learner, Rollout
from thalweg.algos.policy.policy import to_tensors
from thalweg.core.torch_threads import torch_threads
from thalweg.train.errors import ResumeWarning, TrainingError
from thalweg.train.rollouts.episodes import Episode, EpisodeBook
from thalweg.train.rollouts.rollout import RolloutBuffer
from thalweg.train.rollouts.stream import Stream


class Collector(Protocol):
    """Environments of some kind at work."""

    env: Any
    obs_size: int
    """D, of one frame."""
    mode: AutoresetMode
    """How the environment begins its episodes."""
    book: EpisodeBook
    """What is known of the episodes so far."""

    @property
    def stages(self) -> dict[str, float]:
        """Seconds spent so far on actions, `act`, and on what they led to, `env`."""
        ...

    def begin(self, seed: int) -> None:
        """Reset all environments; their running episodes count for nothing."""
        ...

    def step(self, learner: Learner) -> list[Episode]:
        """One action in each environment; returns the episodes that have been found to be over."""
        ...

    @property
    def waiting(self) -> int:
        """Steps of each environment that nothing was learnt from yet, up to `Learner.rollout_steps`."""
        ...

    def rollout(self) -> Rollout:
        """Those steps, on the learner's device; to be used before the next one."""
        ...

    def clear(self) -> None:
        """They were learnt from."""
        ...

    def state(self) -> dict[str, Any]:
        """What the next step depends on; while none is waiting."""
        ...

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        """The inverse of `state`. An environment that can't be brought back begins new episodes, with a
        `ResumeWarning`; then the seed counts."""
        ...


class HostCollector:
    """A Gymnasium vector environment: its steps are arrays, which go to the learner's device when there are enough."""

    def __init__(self, env: VectorEnv, stream: Stream, device: torch.device, threads: int) -> None:
        """`threads` are those of acting."""
        self.env, self.stream, self.device, self.threads = env, stream, device, threads
        self.obs_size, self.mode = stream.obs_size, stream.mode
        self.book = EpisodeBook(stream.num_envs, world_names(env), reason_names(env))
        self.stages = {"act": 0.0, "env": 0.0}
        self.obs = np.zeros((stream.num_envs, 0), dtype=np.float32)
        """[N, K * D] what the next action will see; nothing before `begin`."""
        self.fresh = np.ones(stream.num_envs, dtype=bool)
        self._buffer: RolloutBuffer | None = None

    def begin(self, seed: int) -> None:
        self.book.abandon()
        self.obs = self.stream.reset(env_seeds(seed, self.book.steps, self.stream.num_envs))
        self.fresh = np.ones(self.stream.num_envs, dtype=bool)

    def step(self, learner: Learner) -> list[Episode]:
        before = time.perf_counter()
        with torch_threads(self.threads):
            raw = learner.act(*to_tensors(self.obs, self.fresh, self.device))
            actions = learner.policy.actions.to_numpy(raw)
        acted = time.perf_counter()
        step = self.stream.step(actions)
        after = time.perf_counter()
        costs = learnt_costs(learner, step.cost, step.costs)
        if self._buffer is None:
            self._buffer = RolloutBuffer(learner.rollout_steps, self.obs, raw, costs, self.device)
        self._buffer.add(self.obs, self.fresh, raw, step, costs)
        self.obs, self.fresh = step.next_obs, step.fresh
        self.stages["act"] += acted - before
        self.stages["env"] += after - acted
        return self.book.add(step)

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
        return environment | {"stream": self.stream.state(), "obs": self.obs.copy(), "fresh": self.fresh.copy()}

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        if "environment" in state and hasattr(self.env, "set_state"):
            self.env.set_state(state["environment"])  # pyright: ignore[reportAttributeAccessIssue]
            self.stream.load_state(state["stream"])
            self.obs, self.fresh = np.array(state["obs"], dtype=np.float32), np.array(state["fresh"], dtype=bool)
            return
        warn_of_new_episodes()
        self.begin(seed)


def warn_of_new_episodes() -> None:
    """Say that an environment can't be brought back."""
    warnings.warn(
        "the environment has no get_state and set_state: the run goes on with new episodes, and will not end with the "
        "same numbers as an unbroken one",
        ResumeWarning,
        stacklevel=6,
    )


def learnt_costs(learner: Learner, cost: Any, costs: Any) -> Any:
    """[N, M] what a learner is told of a step's costs, from their sum [N] and, if they are told apart, both [N, 2]."""
    if not learner.separate_costs:
        return cost[:, None]
    if costs is None:
        raise TrainingError(
            "cost_limits are limits of tight and loose costs, but the environment does not tell them apart: "
            "info['costs'] [N, 2] is needed at every step"
        )
    return costs


def env_seeds(seed: int, steps: int, count: int) -> list[int]:
    """One seed for each environment of a run that begins new episodes after so many steps.

    A single number would be counted up from environment to environment (Gymnasium's convention), and runs of
    neighbouring seeds would share all their environments but one. 31 bits, since not every environment takes more.
    """
    return [int(word) >> 1 for word in np.random.SeedSequence([seed, steps]).generate_state(count)]


def world_names(env: Any) -> list[str]:
    """[N] the name and seed of the world of each environment; empty strings if it has none."""
    base: Any = getattr(env, "unwrapped", env)
    worlds, index = getattr(base, "worlds", None), getattr(base, "world_index", None)
    if worlds is None or index is None:
        return [""] * env.num_envs
    return [f"{worlds[i].name}-{worlds[i].seed}" for i in index]


def reason_names(env: Any) -> Mapping[int, str]:
    """The environment's own names for the codes of `info["done_reason"]`; none if it has none."""
    base: Any = getattr(env, "unwrapped", env)
    one = base.envs[0].unwrapped if isinstance(base, SyncVectorEnv) else base
    return getattr(one, "done_reasons", {})
