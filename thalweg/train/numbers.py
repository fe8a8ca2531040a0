"""Wrappers that join the numbers of observations that are dictionaries, for arrays and for tensors."""

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from torch import Tensor

from thalweg.train.errors import TrainingError
from thalweg.train.parts import ObservationParts, vector_space

FORWARDED = ("get_state", "set_state", "pilot_actions", "single_critic_space")
"""Attributes beyond Gymnasium's interface that a wrapper has if the environment has them."""


def attribute_of(wrapper: Any, name: str) -> Any:
    """Return an attribute of the environment in a wrapper that has none of that name.

    A copy asks for attributes before its own exist, `env` among them.
    """
    if "env" not in wrapper.__dict__:
        raise AttributeError(f"{type(wrapper).__name__} has no {name} without an environment")
    return getattr(wrapper.env, name)


def _numbers_of(env: Any) -> ObservationParts:
    """Return the parts of observations that are numbers only; raises `TrainingError` for any other."""
    parts = ObservationParts(env.single_observation_space)
    if parts.image_shape is not None or not parts.size:
        raise TrainingError(f"observations must be numbers without an image, not {env.single_observation_space}")
    return parts


class NumbersVectorEnv(VectorWrapper):
    """A vector environment whose observations are the numbers float32 [N, D] of all parts, also in `final_obs`."""

    def __init__(self, env: VectorEnv) -> None:
        """Wrap an environment; raises `TrainingError` if its observations have other parts than vectors."""
        super().__init__(env)
        self._parts = _numbers_of(env)
        self.single_observation_space = vector_space(self._parts.size)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Reset the environment; returns numbers [N, D] and info."""
        obs, info = self.env.reset(seed=seed, options=options)
        return self._parts.numbers(obs), info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environment; returns numbers in place of dictionaries."""
        obs, reward, terminated, truncated, info = self.env.step(actions)
        if "final_obs" in info:
            last = np.full(self.num_envs, None, dtype=object)
            for env in np.flatnonzero([final is not None for final in info["final_obs"]]):
                last[env] = self._parts.numbers(info["final_obs"][env])
            info = {**info, "final_obs": last}
        return self._parts.numbers(obs), reward, terminated, truncated, info

    def __getattr__(self, name: str) -> Any:
        if name in FORWARDED:
            return getattr(self.env, name)
        raise AttributeError(f"{type(self).__name__} has no {name}")


class NumbersTensorEnv:
    """Environments of tensors whose observations are the numbers float32 [N, D] of all parts.

    All other attributes, such as `get_state`, are those of the environments.
    """

    def __init__(self, env: Any) -> None:
        """Wrap environments; raises `TrainingError` if their observations have other parts than vectors."""
        self.env, self._parts = env, _numbers_of(env)
        self.single_observation_space = vector_space(self._parts.size)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, *, seed: int) -> tuple[Tensor, dict[str, Tensor]]:
        """Reset the environments; returns numbers [N, D] and info."""
        obs, info = self.env.reset(seed=seed)
        return self._parts.numbers(obs), info

    def step(self, actions: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Tensor]]:
        """Step the environments; returns numbers in place of dictionaries."""
        obs, *rest = self.env.step(actions)
        return self._parts.numbers(obs), *rest

    def __getattr__(self, name: str) -> Any:
        return attribute_of(self, name)
