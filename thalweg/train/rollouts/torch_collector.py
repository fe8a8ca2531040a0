"""How does learning go on where nothing leaves the device? Environments of tensors, and who takes their steps.

What a rollout brought is copied to the host once, when it is complete, for the records of its episodes.
"""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import torch
from gymnasium import Space
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.algos.common.errors import NotFiniteError
from thalweg.algos.common.state import array_of, tensor_of
from thalweg.algos.interface import Learner, Rollout
from thalweg.algos.policy.memory import FrameStack
from thalweg.core.device import DeviceError
from thalweg.core.torch_threads import torch_threads
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.collector import (
    Collector,
    HostCollector,
    env_seeds,
    learnt_costs,
    reason_names,
    warn_of_new_episodes,
    world_names,
)
from thalweg.train.rollouts.episodes import Account, Episode, EpisodeBook
from thalweg.train.rollouts.stopwatch import Stopwatch
from thalweg.train.rollouts.stream import Stream

Step = tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Tensor]]
"""Observations [N, D], rewards [N], terminated [N], truncated [N], info."""


class TensorEnv(Protocol):
    """N environments on one device, which begin a new episode in the step after the last one of the old
    (`AutoresetMode.NEXT_STEP`).

    `info` has `cost` [N], perhaps `costs` [N, 2] (tight, loose) and `done_reason` [N] int64. What is returned must stay
    as it is until the second step after. With `get_state` and `set_state`, as `TensorRiverEnv` has them, a run that was
    interrupted goes on with the same numbers; without, with new episodes.
    """

    @property
    def metadata(self) -> dict[str, Any]: ...
    @property
    def num_envs(self) -> int: ...
    @property
    def device(self) -> torch.device: ...
    @property
    def single_observation_space(self) -> Space:
        """A Box of D numbers."""
        ...

    @property
    def single_action_space(self) -> Space: ...
    def reset(self, *, seed: int) -> tuple[Tensor, dict[str, Tensor]]:
        """First observations [N, D] of new episodes, and info."""
        ...

    def step(self, actions: Tensor) -> Step:
        """What actions [N, ...], as a Gymnasium environment takes them, led to."""
        ...


class TensorEncoder(Protocol):
    """Frames to latents, on their device."""

    @property
    def device(self) -> torch.device: ...
    @property
    def latent(self) -> int:
        """Z."""
        ...

    def of_tensor(self, frames: Tensor) -> Tensor:
        """Latents float32 [N, Z] of frames uint8 [N, H, W, C]."""
        ...


class LatentTensorEnv:
    """Environments of tensors whose observations are latents float32 [N, Z] of their frames.

    What else the environments have, such as `get_state`, is theirs.
    """

    def __init__(self, env: Any, encoder: TensorEncoder) -> None:
        """Raises `TrainingError` if the observations are not images, `DeviceError` for an encoder elsewhere."""
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 3:
            raise TrainingError(f"an encoder needs images [H, W, C], the environment's observations are {space}")
        if encoder.device != env.device:
            raise DeviceError(f"the encoder is on {encoder.device}, the environment's tensors on {env.device}")
        self.env, self.encoder, size = env, encoder, int(encoder.latent)
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._watch = Stopwatch(env.device, "encode", "env")

    @property
    def stage_seconds(self) -> dict[str, float]:
        """Time spent so far in the encoder, and in the environment itself."""
        return self._watch.seconds

    def reset(self, *, seed: int) -> tuple[Tensor, dict[str, Tensor]]:
        """First latents [N, Z] and the environment's info."""
        with self._watch.on("env"):
            frames, info = self.env.reset(seed=seed)
        return self._encoded(frames), info

    def step(self, actions: Tensor) -> Step:
        """As the environment's, with latents for frames."""
        with self._watch.on("env"):
            frames, *rest = self.env.step(actions)
        return self._encoded(frames), *rest

    def __getattr__(self, name: str) -> Any:
        return getattr(self.env, name)

    def _encoded(self, frames: Tensor) -> Tensor:
        with self._watch.on("encode"):
            return self.encoder.of_tensor(frames)


class TensorBuffer:
    """T steps of N environments, written in place on their device."""

    def __init__(self, steps: int, obs: Tensor, fresh: Tensor, actions: Tensor, costs: Tensor) -> None:
        """Room for `steps` steps like the given one: observations [N, K * D], of which `fresh` [N] begin an episode,
        raw actions [N, A], costs [N, M]."""
        count, device = len(obs), obs.device
        self.steps, self.filled = steps, 0
        self.obs, self.fresh = obs.new_zeros(steps + 1, *obs.shape), fresh.new_zeros(steps + 1, count)
        self.learnt = {
            "actions": actions.new_zeros(steps, *actions.shape),
            "rewards": obs.new_zeros(steps, count),
            "costs": obs.new_zeros(steps, *costs.shape),
            **{name: fresh.new_zeros(steps, count) for name in ("terminated", "truncated", "valid")},
        }
        kinds = {"reward": torch.float64, "cost": torch.float64, "tight": torch.float64, "loose": torch.float64}
        self.told = {
            name: torch.zeros(steps, count, dtype=kind, device=device)
            for name, kind in (kinds | {"reasons": torch.int64}).items()
        }
        """What only the records of episodes need: undiscounted, in float64."""

    def begin(self, obs: Tensor, fresh: Tensor) -> None:
        """The first step of a rollout starts from here."""
        self.filled = 0
        self.obs[0], self.fresh[0] = obs, fresh

    def add(self, next_obs: Tensor, fresh: Tensor, learnt: dict[str, Tensor], told: dict[str, Tensor]) -> None:
        """Take in what a step led to, and all that was said of it [N, ...]."""
        for name, tensor in learnt.items():
            self.learnt[name][self.filled] = tensor
        for name, tensor in told.items():
            self.told[name][self.filled] = tensor
        self.filled += 1
        self.obs[self.filled], self.fresh[self.filled] = next_obs, fresh

    def rollout(self) -> Rollout:
        """Views of the steps so far.

        No last observation stands apart: what follows an episode's last step is what it ended with.
        """
        learnt = {name: tensor[: self.filled] for name, tensor in self.learnt.items()}
        none = torch.zeros(0, dtype=torch.int64, device=self.obs.device)
        obs, fresh = self.obs[: self.filled + 1], self.fresh[: self.filled + 1]
        return Rollout(obs=obs, fresh=fresh, **learnt, final_index=none, final_obs=self.obs.new_zeros(0, obs.shape[2]))


class TensorCollector:
    """Environments of tensors: the host learns of episodes once a rollout is complete."""

    mode = AutoresetMode.NEXT_STEP

    def __init__(self, env: TensorEnv, frames: int, threads: int) -> None:
        """`frames`: K, how many of the last observations are seen side by side; `threads` are those of acting.

        Raises `TrainingError` for an environment that can't be trained on.
        """
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
            raise TrainingError(
                f"observations must be vectors of numbers, not {space}: images go through LatentTensorEnv"
            )
        if env.metadata.get("autoreset_mode") is not self.mode:
            raise TrainingError("an environment of tensors begins episodes by AutoresetMode.NEXT_STEP, and says so")
        self.env, self.threads, self.num_envs, self.obs_size = env, threads, env.num_envs, int(space.shape[0])
        self.book = EpisodeBook(env.num_envs, world_names(env), reason_names(env))
        self._watch = Stopwatch(env.device, "act", "env")
        self._stack = FrameStack(env.num_envs, self.obs_size, frames, env.device)
        self._obs = torch.zeros(env.num_envs, frames * self.obs_size, device=env.device)
        """[N, K * D] what the next action will see."""
        self._fresh = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
        self._pending = ~self._fresh
        """[N] environments whose next step only resets them."""
        self._buffer: TensorBuffer | None = None

    @property
    def stages(self) -> dict[str, float]:
        return self._watch.seconds

    def begin(self, seed: int) -> None:
        self.book.abandon()
        (first,) = env_seeds(seed, self.book.steps, 1)
        obs, _ = self.env.reset(seed=first)
        obs = obs.float()
        self._fresh, self._pending = torch.ones_like(self._fresh), torch.zeros_like(self._pending)
        self._obs = self._stack.push(obs, self._fresh)

    def step(self, learner: Learner) -> list[Episode]:
        with self._watch.on("act"), torch_threads(self.threads):
            raw = learner.act(self._obs, self._fresh)
            actions = learner.policy.actions.env_actions(raw)
        with self._watch.on("env"):
            obs, reward, terminated, truncated, info = self.env.step(actions)
        if "cost" not in info:
            named = ", ".join(map(repr, info)) or "nothing"
            raise TrainingError(
                f"the environment names no cost: info['cost'] [N] is needed at every step, info has {named}"
            )
        obs, valid = obs.float(), ~self._pending
        terminated, truncated = terminated & valid, truncated & valid & ~terminated
        reward, cost = (torch.where(valid, paid, 0.0) for paid in (reward, info["cost"]))
        costs = info.get("costs")
        learnt = {
            "actions": raw,
            "rewards": reward,
            "costs": learnt_costs(learner, cost, costs) * valid[:, None],
            "terminated": terminated,
            "truncated": truncated,
            "valid": valid,
        }
        told = {"reward": reward, "cost": cost}
        if costs is not None:
            told |= {"tight": costs[:, 0] * valid, "loose": costs[:, 1] * valid}
        if "done_reason" in info:
            told["reasons"] = info["done_reason"]
        if self._buffer is None:
            self._buffer = TensorBuffer(learner.rollout_steps, self._obs, self._fresh, raw, learnt["costs"])
        if not self._buffer.filled:
            self._buffer.begin(self._obs, self._fresh)
        self._obs, self._fresh = self._stack.push(obs, ~valid), ~valid
        self._pending = terminated | truncated
        self._buffer.add(self._obs, self._fresh, learnt, told)
        return self._settled(set(told)) if self._buffer.filled == self._buffer.steps else []

    @property
    def waiting(self) -> int:
        return 0 if self._buffer is None else self._buffer.filled

    def rollout(self) -> Rollout:
        if self._buffer is None or not self._buffer.filled:
            raise TrainingError("there are no steps to learn from")
        return self._buffer.rollout()

    def clear(self) -> None:
        if self._buffer is not None:
            self._buffer.filled = 0

    def state(self) -> dict[str, Any]:
        getter = getattr(self.env, "get_state", None)
        own = {"obs": self._obs, "fresh": self._fresh, "pending": self._pending}
        return {
            **({} if getter is None else {"environment": dict(getter())}),
            **{name: array_of(tensor) for name, tensor in own.items()},
            "frames": self._stack.state(),
        }

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        if "environment" not in state or not hasattr(self.env, "set_state"):
            warn_of_new_episodes()
            self.begin(seed)
            return
        self.env.set_state(state["environment"])  # pyright: ignore[reportAttributeAccessIssue]
        self._obs, self._fresh, self._pending = (
            tensor_of(state[name], self.env.device) for name in ("obs", "fresh", "pending")
        )
        self._stack.load_state(state["frames"])

    def _settled(self, said: set[str]) -> list[Episode]:
        """The episodes that ended within a complete rollout, and their entries in the book."""
        assert self._buffer is not None
        told = {name: array_of(tensor) for name, tensor in self._buffer.told.items() if name in said}
        ended = {name: array_of(self._buffer.learnt[name]) for name in ("terminated", "truncated", "valid")}
        for name in ("reward", "cost"):
            wrong = np.argwhere(~np.isfinite(told[name][: self._buffer.filled]))
            if len(wrong):
                rows = wrong[wrong[:, 0] == wrong[0, 0], 1].tolist()
                raise NotFiniteError(
                    f"{name} is not finite in rows {rows[:8]} of step {wrong[0, 0] + 1} of the rollout"
                )
        episodes = []
        for at in range(self._buffer.filled):
            apart = np.stack([told["tight"][at], told["loose"][at]], 1) if "tight" in told else None
            over = {name: values[at] for name, values in ended.items()}
            account = Account(
                reward=told["reward"][at],
                cost=told["cost"][at],
                costs=apart,
                finished=np.flatnonzero(over["terminated"] | over["truncated"]),
                reasons=told["reasons"][at] if "reasons" in told else None,
                **over,
            )
            episodes += self.book.add(account)
        return episodes


def collector_for(env: Any, frames: int, device: torch.device, threads: int) -> Collector:
    """Who takes the steps of an environment of either kind for a learner on a device.

    Raises `TrainingError` for an environment that can't be trained on, and `DeviceError` for one of tensors elsewhere.
    """
    if not isinstance(getattr(env, "device", None), torch.device):
        return HostCollector(env, Stream(env, frames), device, threads)
    if env.device != device:
        raise DeviceError(f"device = {str(device)!r}, but the environment's tensors are on {env.device}")
    return TensorCollector(env, frames, threads)
