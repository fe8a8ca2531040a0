"""How does an algorithm of vectors fly by sight? A frozen encoder between the environment's frames and its
observations."""

import time
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from thalweg.train.errors import TrainingError

PASSED = ("get_state", "set_state", "pilot_actions")
"""What an environment may have beyond Gymnasium's interface: here exactly when it has it."""


class FrameEncoder(Protocol):
    """Frames to latents."""

    @property
    def latent(self) -> int:
        """Z."""
        ...

    def __call__(self, frames: np.ndarray, /) -> np.ndarray:
        """Latents float32 [K, Z] of frames uint8 [K, H, W, C]."""
        ...


class LatentVectorEnv(VectorWrapper):
    """A vector environment whose observations are latents float32 [N, Z], also in `final_obs`.

    One call of the encoder serves a step: the frames of all environments and the last frames of those that finished.
    `info`, `get_state`, `set_state` and `pilot_actions` are the environment's own.
    """

    def __init__(self, env: VectorEnv, encoder: FrameEncoder) -> None:
        """Raises `TrainingError` if the observations are not images."""
        super().__init__(env)
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 3:
            raise TrainingError(f"an encoder needs images [H, W, C], the environment's observations are {space}")
        self.encoder, size = encoder, int(encoder.latent)
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        # Frames of a step, then last frames of the finished: at most as many again.
        self._frames = np.empty((2 * env.num_envs, *space.shape), dtype=space.dtype)
        self.stage_seconds = {"encode": 0.0, "env": 0.0}
        """Time spent so far in the encoder, and in the environment itself."""

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """First latents [N, Z] and the environment's info."""
        started = time.perf_counter()
        frames, info = self.env.reset(seed=seed, options=options)
        self.stage_seconds["env"] += time.perf_counter() - started
        return self._encode(np.asarray(frames)), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """As the environment's, with latents for frames."""
        started = time.perf_counter()
        frames, reward, terminated, truncated, info = self.env.step(actions)
        self.stage_seconds["env"] += time.perf_counter() - started
        final = info.get("final_obs")
        if final is None:
            return self._encode(np.asarray(frames)), reward, terminated, truncated, info
        ended = np.flatnonzero(np.asarray(terminated) | np.asarray(truncated))
        ended = [int(env) for env in ended if final[env] is not None]
        count = self.num_envs
        self._frames[:count] = frames
        for place, env in enumerate(ended):
            self._frames[count + place] = final[env]
        latents = self._encode(self._frames[: count + len(ended)])
        final_latents = np.full(count, None, dtype=object)
        for place, env in enumerate(ended):
            final_latents[env] = latents[count + place]
        return latents[:count], reward, terminated, truncated, {**info, "final_obs": final_latents}

    def __getattr__(self, name: str) -> Any:
        if name in PASSED:
            return getattr(self.env, name)
        raise AttributeError(f"{type(self).__name__} has no {name}")

    def _encode(self, frames: np.ndarray) -> np.ndarray:
        started = time.perf_counter()
        latents = self.encoder(frames)
        self.stage_seconds["encode"] += time.perf_counter() - started
        return latents
