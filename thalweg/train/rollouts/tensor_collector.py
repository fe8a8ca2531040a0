"""Collector for environments of tensors: steps stay on their device.

The rewards, costs and ends of a rollout are copied to the host once, when it is complete, for the statistics of its
episodes.
"""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import torch
from gymnasium import Space
from gymnasium.vector import AutoresetMode
from torch import Tensor

from thalweg.algos.common.errors import NotFiniteError
from thalweg.algos.common.state import array_of, tensor_of
from thalweg.algos.interface import Learner, Rollout
from thalweg.algos.policy.memory import FrameStack
from thalweg.core.compute.device import DeviceError
from thalweg.core.compute.torch_threads import torch_threads
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.collector import (
    Collector,
    HostCollector,
    costs_to_learn,
    done_reason_names,
    env_seeds,
    warn_of_new_episodes,
    world_names,
)
from thalweg.train.rollouts.critic_info import KEY, critic_size, critic_tensor, refuse_unannounced
from thalweg.train.rollouts.env_stepper import EnvStepper
from thalweg.train.rollouts.episodes import Episode, EpisodeStatistics, StepRecord
from thalweg.train.rollouts.rollout_buffer import TensorRolloutBuffer
from thalweg.train.rollouts.stage_timer import StageTimer


class TensorEnv(Protocol):
    """N environments on one device, which reset in the step after the last one of an episode
    (`AutoresetMode.NEXT_STEP`).

    `info` has `cost` [N], and may have `costs` [N, K] (tight, loose, others) and `done_reason` [N] int64. With
    `single_critic_space`, a Box of C numbers, it has `critic_obs` [N, C] of the state that the observations show, at
    resets too. Returned tensors must not change until the second step after. With `get_state` and `set_state`, as in
    `TensorRiverEnv`, an interrupted run resumes with the same numbers; without, with new episodes.
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
        """Start new episodes; returns observations [N, D] and info."""
        ...

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Tensor]]:
        """Take actions [N, ...], as a Gymnasium environment takes them; returns observations [N, D], rewards [N],
        terminated [N], truncated [N] and info."""
        ...


class TensorCollector:
    """Steps environments of tensors; the statistics of episodes are updated once per rollout."""

    mode = AutoresetMode.NEXT_STEP
    image: tuple[int, int, int] | None = None

    def __init__(self, env: TensorEnv, frames: int, threads: int, critics: bool = False) -> None:
        """Check the environment: raises `TrainingError` if it cannot be trained on.

        `frames` is K, the number of observations that a policy sees side by side; `threads` is for acting; `critics`,
        whether what only critics see is read from `info`.
        """
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
            raise TrainingError(
                f"observations must be vectors of numbers, not {space}: wrap environments of images in LatentTensorEnv"
            )
        if env.metadata.get("autoreset_mode") is not self.mode:
            raise TrainingError(
                "the metadata['autoreset_mode'] of an environment of tensors must be AutoresetMode.NEXT_STEP, not"
                f" {env.metadata.get('autoreset_mode')!r}"
            )
        self.env, self.threads, self.num_envs, self.obs_size = env, threads, env.num_envs, int(space.shape[0])
        self.statistics = EpisodeStatistics(env.num_envs, world_names(env), done_reason_names(env))
        self._timer = StageTimer(env.device, "act", "env")
        self._stack = FrameStack(env.num_envs, self.obs_size, frames, env.device)
        self._obs = torch.zeros(env.num_envs, frames * self.obs_size, dtype=torch.float32, device=env.device)
        """[N, K * D] observation for the next action."""
        self._fresh = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
        self._pending = ~self._fresh
        """[N] environments whose next step only resets them."""
        self._reads_critics, self.critic_size = critics, critic_size(env) if critics else 0
        self._critic_obs: Tensor | None = None
        """[N, C] what critics see beside that observation, if it is read and there is any."""
        self._buffer: TensorRolloutBuffer | None = None

    @property
    def stages(self) -> dict[str, float]:
        return self._timer.seconds

    def reset(self, seed: int) -> None:
        self.statistics.discard_running()
        (first,) = env_seeds(seed, self.statistics.steps, 1)
        obs, info = self.env.reset(seed=first)
        obs = obs.float()
        if self._reads_critics and not self.critic_size:
            refuse_unannounced(info)
        self._critic_obs = self._of_critics(info)
        self._fresh, self._pending = torch.ones_like(self._fresh), torch.zeros_like(self._pending)
        self._obs = self._stack.push(obs, self._fresh)

    def step(self, learner: Learner) -> list[Episode]:
        with self._timer.measure("act"), torch_threads(self.threads):
            raw = learner.act(self._obs, self._fresh)
            actions = learner.policy.actions.env_actions(raw)
        with self._timer.measure("env"):
            obs, reward, terminated, truncated, info = self.env.step(actions)
        valid = ~self._pending
        terminated, truncated = terminated & valid, truncated & valid & ~terminated
        records = _records(info, reward, valid)
        samples = {
            "actions": raw,
            "rewards": records["reward"],
            "costs": torch.where(valid[:, None], costs_to_learn(learner, records["cost"], info.get("costs")), 0.0),
            "terminated": terminated,
            "truncated": truncated,
            "valid": valid,
        }
        if self._buffer is None:
            self._buffer = TensorRolloutBuffer(
                learner.rollout_steps, self._obs, self._fresh, raw, samples["costs"], self._critic_obs
            )  # fmt: skip
        if not self._buffer.filled:
            self._buffer.start(self._obs, self._fresh, self._critic_obs)
        self._obs, self._fresh = self._stack.push(obs.float(), ~valid), ~valid
        self._critic_obs = self._of_critics(info)
        self._pending = terminated | truncated
        self._buffer.add(self._obs, self._fresh, samples, records, self._critic_obs)
        return self._finished_episodes(set(records)) if self._buffer.filled == self._buffer.steps else []

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
        tensors = {"obs": self._obs, "fresh": self._fresh, "pending": self._pending}
        tensors |= {} if self._critic_obs is None else {KEY: self._critic_obs}
        return {
            **({} if getter is None else {"environment": dict(getter())}),
            **{name: array_of(tensor) for name, tensor in tensors.items()},
            "frames": self._stack.state(),
        }

    def load_state(self, state: dict[str, Any], seed: int) -> None:
        if "environment" not in state or not hasattr(self.env, "set_state"):
            warn_of_new_episodes()
            self.reset(seed)
            return
        self.env.set_state(state["environment"])  # pyright: ignore[reportAttributeAccessIssue]
        self._obs, self._fresh, self._pending = (
            tensor_of(state[name], self.env.device) for name in ("obs", "fresh", "pending")
        )
        self._critic_obs = tensor_of(state[KEY], self.env.device) if self.critic_size else None
        self._stack.load_state(state["frames"])

    def _of_critics(self, info: dict[str, Tensor]) -> Tensor | None:
        """Return what critics see [N, C] in the info of a step or reset, if it is read and there is any."""
        return critic_tensor(info, self.num_envs, self.critic_size) if self.critic_size else None

    def _finished_episodes(self, names: set[str]) -> list[Episode]:
        """Return the episodes that ended in a complete rollout, after updating the statistics with its records."""
        assert self._buffer is not None
        records = {name: array_of(tensor) for name, tensor in self._buffer.records.items() if name in names}
        flags = {name: array_of(self._buffer.samples[name]) for name in ("terminated", "truncated", "valid")}
        for name in ("reward", "cost"):
            _check_finite(name, records[name][: self._buffer.filled])
        seen = {"observation": self._buffer.obs, KEY: self._buffer.critic_obs}
        rows = {name: values[: self._buffer.filled + 1] for name, values in seen.items() if values is not None}
        rows["costs"] = self._buffer.samples["costs"][: self._buffer.filled]
        for name, values in rows.items():
            _check_finite(name, np.where(array_of(torch.isfinite(values).all(2)), 0.0, np.nan))
        episodes = []
        for t in range(self._buffer.filled):
            separate = np.stack([records["tight"][t], records["loose"][t]], 1) if "tight" in records else None
            now = {name: values[t] for name, values in flags.items()}
            record = StepRecord(
                reward=records["reward"][t],
                cost=records["cost"][t],
                costs=separate,
                finished=np.flatnonzero(now["terminated"] | now["truncated"]),
                reasons=records["reasons"][t] if "reasons" in records else None,
                **now,
            )
            episodes += self.statistics.add(record)
        return episodes


def _records(info: dict[str, Tensor], reward: Tensor, valid: Tensor) -> dict[str, Tensor]:
    """Return what the statistics of episodes need of a step [N], zero where only a reset happened; raises
    `TrainingError` for an info without cost."""
    if "cost" not in info:
        keys = ", ".join(map(repr, info)) or "nothing"
        raise TrainingError(
            f"the environment reports no cost: info['cost'] [N] is needed at every step, info has {keys}"
        )
    records = {name: torch.where(valid, value, 0.0) for name, value in (("reward", reward), ("cost", info["cost"]))}
    if info.get("costs") is not None:
        tight, loose = torch.where(valid[:, None], info["costs"][:, :2], 0.0).unbind(1)  # NaN times 0 is NaN
        records |= {"tight": tight, "loose": loose}
    if "done_reason" in info:
        records["reasons"] = info["done_reason"]
    return records


def _check_finite(name: str, values: np.ndarray) -> None:
    """Raise `NotFiniteError` with the first step and its rows where values [T, N] are NaN or infinite."""
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        rows = wrong[wrong[:, 0] == wrong[0, 0], 1].tolist()
        raise NotFiniteError(f"{name} is not finite in rows {rows[:8]} of step {wrong[0, 0] + 1} of the rollout")


def make_collector(
    env: Any, frames: int, device: torch.device, threads: int, critics: bool = False, images: bool = False
) -> Collector:
    """Return a collector for an environment of arrays or tensors, for a learner on a device; `critics` is whether it
    reads what only critics see, `images` whether observations are images, which become rows of bytes.

    Raises `TrainingError` for an environment that cannot be trained on, and `DeviceError` for tensors of another
    device, and for images anywhere but on the CPU.
    """
    if images and device.type != "cpu":
        raise DeviceError(f"policy=cnn learns on the CPU only, not on {device}: leave the device out")
    if not isinstance(getattr(env, "device", None), torch.device):
        return HostCollector(env, EnvStepper(env, frames, critics, images), device, threads)
    if images:
        raise TrainingError("policy=cnn takes a Gymnasium VectorEnv of images, not an environment of tensors")
    if env.device != device:
        raise DeviceError(f"device = {str(device)!r}, but the environment's tensors are on {env.device}")
    return TensorCollector(env, frames, threads, critics)
