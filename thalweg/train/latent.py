"""Wrappers that replace the frames of environments by the latents of a frozen encoder, for arrays and for tensors.

Where observations are dictionaries, their numbers, such as proprioception, follow the latents.
"""

import time
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.core.compute.device import DeviceError
from thalweg.train.errors import TrainingError
from thalweg.train.numbers import FORWARDED, attribute_of
from thalweg.train.parts import ObservationParts, joined, vector_space
from thalweg.train.rollouts.stage_timer import StageTimer


class FrameEncoder(Protocol):
    """An encoder of frames in arrays."""

    @property
    def latent(self) -> int:
        """Z, size of a latent."""
        ...

    def __call__(self, frames: np.ndarray, /) -> np.ndarray:
        """Return latents float32 [K, Z] of frames uint8 [K, H, W, C]."""
        ...


class TensorEncoder(Protocol):
    """An encoder of frames in tensors on its device."""

    @property
    def device(self) -> torch.device: ...
    @property
    def latent(self) -> int:
        """Z, size of a latent."""
        ...

    def of_tensor(self, frames: Tensor) -> Tensor:
        """Return latents float32 [N, Z] of frames uint8 [N, H, W, C]."""
        ...


def _parts_of(env: Any) -> ObservationParts:
    """Return the parts of observations that have an image; raises `TrainingError` for any other."""
    parts = ObservationParts(env.single_observation_space)
    if parts.image_shape is None:
        raise TrainingError(
            f"an encoder needs images [H, W, C], the environment's observations are {env.single_observation_space}"
        )
    return parts


class LatentVectorEnv(VectorWrapper):
    """A vector environment whose observations are latents float32 [N, Z], also in `final_obs`.

    With P numbers beside its images they are [N, Z + P]: latents, then the numbers as they are. One call of the encoder
    per step encodes the frames of all environments and the last frames of finished episodes. `info`, `get_state`,
    `set_state`, `pilot_actions` and `single_critic_space` are those of the environment.
    """

    def __init__(self, env: VectorEnv, encoder: FrameEncoder) -> None:
        """Wrap an environment; raises `TrainingError` if its observations are not images."""
        super().__init__(env)
        self._parts, self.encoder = _parts_of(env), encoder
        self.single_observation_space = vector_space(encoder.latent + self._parts.size)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        # The frames of a step, followed by the last frames of at most as many finished episodes.
        self._frames = np.empty((2 * env.num_envs, *(self._parts.image_shape or ())), dtype=np.uint8)
        self.stage_seconds = {"encode": 0.0, "env": 0.0}
        """Seconds spent so far in the encoder and in the environment."""

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset the environment; returns latents [N, Z] and info."""
        started = time.perf_counter()
        obs, info = self.env.reset(seed=seed, options=options)
        self.stage_seconds["env"] += time.perf_counter() - started
        return self._latents(obs), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environment; returns latents in place of frames."""
        started = time.perf_counter()
        obs, reward, terminated, truncated, info = self.env.step(actions)
        self.stage_seconds["env"] += time.perf_counter() - started
        final = info.get("final_obs")
        if final is None:
            return self._latents(obs), reward, terminated, truncated, info
        ended = np.flatnonzero(np.asarray(terminated) | np.asarray(truncated))
        ended = [int(env) for env in ended if final[env] is not None]
        count = self.num_envs
        self._frames[:count] = self._parts.image(obs)
        for index, env in enumerate(ended):
            self._frames[count + index] = self._parts.image(final[env])
        latents = self._encode(self._frames[: count + len(ended)])
        if self._parts.size:
            numbers = np.stack([*self._parts.numbers(obs), *(self._parts.numbers(final[env]) for env in ended)])
            latents = joined([latents, numbers])
        final_latents = np.full(count, None, dtype=object)
        for index, env in enumerate(ended):
            final_latents[env] = latents[count + index]
        return latents[:count], reward, terminated, truncated, {**info, "final_obs": final_latents}

    def __getattr__(self, name: str) -> Any:
        if name in FORWARDED:
            return getattr(self.env, name)
        raise AttributeError(f"{type(self).__name__} has no {name}")

    def _latents(self, obs: Any) -> np.ndarray:
        """Return the latents of observations, followed by their numbers if they have any."""
        latents = self._encode(np.asarray(self._parts.image(obs)))
        return joined([latents, self._parts.numbers(obs)]) if self._parts.size else latents

    def _encode(self, frames: np.ndarray) -> np.ndarray:
        """Return the latents [K, Z] of frames, and add the time to that of the encoder."""
        started = time.perf_counter()
        latents = self.encoder(frames)
        self.stage_seconds["encode"] += time.perf_counter() - started
        return latents


class LatentTensorEnv:
    """Environments of tensors whose observations are latents float32 [N, Z] of their frames, then their numbers if
    they have any.

    All other attributes, such as `get_state`, are those of the environments.
    """

    def __init__(self, env: Any, encoder: TensorEncoder) -> None:
        """Wrap environments; raises `TrainingError` if their observations are not images, and `DeviceError` for an
        encoder on another device."""
        self._parts = _parts_of(env)
        if encoder.device != env.device:
            raise DeviceError(f"the encoder is on {encoder.device}, the environment's tensors on {env.device}")
        self.env, self.encoder = env, encoder
        self.single_observation_space = vector_space(encoder.latent + self._parts.size)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._timer = StageTimer(env.device, "encode", "env")

    @property
    def stage_seconds(self) -> dict[str, float]:
        """Seconds spent so far in the encoder and in the environment."""
        return self._timer.seconds

    def reset(self, *, seed: int) -> tuple[Tensor, dict[str, Tensor]]:
        """Reset the environments; returns latents [N, Z] and info."""
        with self._timer.measure("env"):
            obs, info = self.env.reset(seed=seed)
        return self._latents(obs), info

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Tensor]]:
        """Step the environments; returns latents in place of frames."""
        with self._timer.measure("env"):
            obs, *rest = self.env.step(actions)
        return self._latents(obs), *rest

    def __getattr__(self, name: str) -> Any:
        return attribute_of(self, name)

    def _latents(self, obs: Any) -> Tensor:
        with self._timer.measure("encode"):
            latents = self.encoder.of_tensor(self._parts.image(obs))
        return joined([latents, self._parts.numbers(obs)]) if self._parts.size else latents
