"""Observations of critics alone: `info["critic_obs"]` of environments that say so by `single_critic_space`, read and
checked.

It belongs to the state that the observation shows; where an environment resets itself in the same step, that of the
last state of the episode is in `final_info["critic_obs"]`.
"""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from torch import Tensor

from thalweg.algos.common.errors import NotFiniteError
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.env_attributes import env_attribute

KEY = "critic_obs"


def critic_size(env: Any) -> int:
    """Return C, how many numbers an environment tells critics beyond the observation; 0 if it tells none.

    Gymnasium's vectors of single environments tell what these do, which say so by `critic_space`. Raises
    `TrainingError` for a space that is not a Box of numbers.
    """
    base = getattr(env, "unwrapped", env)
    space = getattr(env, "single_critic_space", getattr(base, "single_critic_space", None))
    if space is None:
        space = env_attribute(env, "critic_space")
    if space is None:
        return 0
    if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
        raise TrainingError(f"what critics see must be a vector of numbers, but single_critic_space is {space}")
    return int(space.shape[0])


def refuse_unannounced(info: Mapping[str, Any]) -> None:
    """Raise `TrainingError` for a critic_obs in the info of an environment without `single_critic_space`."""
    if KEY in info:
        raise TrainingError(
            f"info has {KEY!r}, but the environment does not say of how many numbers: it needs single_critic_space, a"
            " Box of C numbers"
        )


def critic_tensor(info: Mapping[str, Tensor], num_envs: int, size: int) -> Tensor:
    """Return the critic_obs [N, C] float32 of environments of tensors; raises `TrainingError` if it is missing or of
    another shape."""
    value = info.get(KEY)
    if value is None:
        raise _missing(info, num_envs, size)
    if tuple(value.shape) != (num_envs, size):
        raise _misshapen(tuple(value.shape), num_envs, size)
    return value.float()


class CriticInfo:
    """Reads critic_obs from the info of a vector environment in any autoreset mode."""

    def __init__(self, env: Any, mode: AutoresetMode) -> None:
        """Raises `TrainingError` for a `single_critic_space` that is not a Box of numbers."""
        self.num_envs, self.mode, self.size = env.num_envs, mode, critic_size(env)
        self.now: np.ndarray | None = np.zeros((self.num_envs, self.size), np.float32) if self.size else None
        """[N, C] float32, what critics see beside the current observation; None if the environment tells nothing."""

    def reset(self, info: Mapping[str, Any], rows: np.ndarray, moment: str) -> None:
        """Read the info of a reset of the environments `rows` [N] bool.

        This and `step` raise `TrainingError` if it is missing or has another shape, and `NotFiniteError`; `moment` says
        when.
        """
        if self.now is None:
            refuse_unannounced(info)
            return
        self.now = np.where(rows[:, None], self._read(info, rows, moment), self.now)

    def step(
        self, info: Mapping[str, Any], finished: np.ndarray, truncated: np.ndarray, moment: str
    ) -> np.ndarray | None:
        """Read the info of a step in which the environments `finished` [F] int64 ended their episode, and of these the
        `truncated` [N] bool by a limit; returns what critics see of their last states [F, C] float32."""
        if self.now is None:
            return None
        last = self._last(info, finished, truncated, moment) if self.mode is AutoresetMode.SAME_STEP else None
        self.now = self._read(info, np.ones(self.num_envs, dtype=bool), moment)
        return self.now[finished] if last is None else last

    def _last(self, info: Mapping[str, Any], finished: np.ndarray, truncated: np.ndarray, moment: str) -> np.ndarray:
        """Return what `final_info` says [F, C]; zeros for an episode that ended by itself without it, for nothing comes
        after it."""
        ended = np.zeros(self.num_envs, dtype=bool)
        ended[finished] = True
        final = info.get("final_info")
        final = final if isinstance(final, Mapping) else {}
        told = ended & np.asarray(final.get(f"_{KEY}", True), dtype=bool) & (final.get(KEY) is not None)
        needed = told | truncated
        if not needed.any():
            return np.zeros((len(finished), self.size), np.float32)
        values = self._read(final, needed, moment, "final_info of ")
        return np.where(told[:, None], values, np.float32(0.0))[finished]

    def _read(self, info: Mapping[str, Any], rows: np.ndarray, moment: str, part: str = "") -> np.ndarray:
        """Return critic_obs [N, C] float32, of which `rows` [N] bool are needed; raises as `reset`."""
        value, told = info.get(KEY), np.asarray(info.get(f"_{KEY}", rows), dtype=bool)
        if value is None or not told[rows].all():
            missing = [] if value is None else np.flatnonzero(rows & ~told).tolist()[:8]
            where = f"in rows {missing} of {part}{moment}" if missing else f"in {part}{moment}"
            raise _missing(info, self.num_envs, self.size, f" {where}")
        try:
            array = np.array(value, dtype=np.float32)
        except (TypeError, ValueError):
            raise _misshapen("other things than numbers", self.num_envs, self.size) from None
        if array.shape != (self.num_envs, self.size):
            raise _misshapen(array.shape, self.num_envs, self.size)
        wrong = np.flatnonzero(rows & ~np.isfinite(array).all(1)).tolist()
        if wrong:
            raise NotFiniteError(f"{KEY} is not finite in rows {wrong[:8]} of {part}{moment}")
        return array


def _missing(info: Mapping[str, Any], num_envs: int, size: int, where: str = "") -> TrainingError:
    keys = ", ".join(repr(key) for key in info if not key.startswith("_")) or "nothing"
    return TrainingError(
        f"info[{KEY!r}] {(num_envs, size)} is missing{where}: an environment with single_critic_space gives it at every"
        f" reset and step, and of last states in final_info; info has {keys}"
    )


def _misshapen(found: Any, num_envs: int, size: int) -> TrainingError:
    return TrainingError(f"info[{KEY!r}] must have shape {(num_envs, size)}, as single_critic_space says, got {found}")
