"""Steps of Gymnasium vector environments in one form for all three autoreset modes.

SAME_STEP returns the last observation of an episode in `final_obs`, and may return its cost in `final_info`. NEXT_STEP
spends a step on the reset, which is not part of any episode. DISABLED must be reset. Callers of this module need not
distinguish them.
"""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv

from thalweg.algos.common.errors import NotFiniteError
from thalweg.algos.policy.memory import FrameStack
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.critic_info import CriticInfo
from thalweg.train.rollouts.env_attributes import env_attribute
from thalweg.train.rollouts.episodes import StepRecord
from thalweg.train.rollouts.images import ImageStack

MAX_STEPS_WITHOUT_COST = 10_000
"""Vector steps without a finished episode after which an environment that never reported a cost is refused."""


@dataclass(frozen=True)
class EnvStep(StepRecord):
    """Result of one action in each of N environments, of which F finished their episode."""

    next_obs: np.ndarray
    """[N, K * D] float32, observation for the next action: K frames side by side; rows uint8 [N, D] of images."""
    fresh: np.ndarray
    """[N] bool, whether that observation starts an episode."""
    final_obs: np.ndarray
    """[F, K * D], last observation of each finished episode."""
    critic_obs: np.ndarray | None = None
    """[N, C] float32, what critics see beside `next_obs`, if it is read and the environment tells any."""
    final_critic_obs: np.ndarray | None = None
    """[F, C] float32, the same beside `final_obs`."""


class EnvStepper:
    """Resets and steps a vector environment in any autoreset mode."""

    def __init__(self, env: VectorEnv, frames: int = 1, critics: bool = False, images: bool = False) -> None:
        """Check the environment: raises `TrainingError` if it cannot be trained on.

        `frames` is K, the number of observations that a policy sees side by side; `critics`, whether what only critics
        see is read from `info`; `images`, whether observations must be images, which become rows of bytes.
        """
        if not hasattr(env, "single_observation_space"):
            raise TrainingError(
                f"training takes a Gymnasium VectorEnv, as gymnasium.make_vec makes it, not {type(env).__name__}"
            )
        self.images = ImageStack(env) if images else None
        self.env, self.num_envs = env, env.num_envs
        self.obs_size = _vector_size(env.single_observation_space) if self.images is None else self.images.size
        self.mode = _autoreset_mode(env)
        self._stack = FrameStack(self.num_envs, self.obs_size if self.images is None else 0, frames)
        self.pending = np.zeros(self.num_envs, dtype=bool)
        """[N] environments whose next step only resets them (NEXT_STEP)."""
        self._critics = CriticInfo(env, self.mode) if critics else None
        self._steps, self._cost_seen = 0, False
        self._kinds = len(env_attribute(env, "cost_kinds", ("tight", "loose")))
        # Somebody else's environment may mean something else by info["river"].
        self._changes_river = bool(getattr(getattr(env, "unwrapped", env), "river_names", None))

    @property
    def critic_size(self) -> int:
        """C, how many numbers critics see beyond the observation; 0 if they are not read or there are none."""
        return 0 if self._critics is None else self._critics.size

    @property
    def critic_obs(self) -> np.ndarray | None:
        """[N, C] float32, what critics see beside the current observation, if it is read and the environment tells
        any."""
        return None if self._critics is None else self._critics.now

    def reset(self, seed: int | list[int]) -> np.ndarray:
        """Start new episodes; returns their first observations [N, K * D] float32.

        `seed` is as Gymnasium's vector environments take it. An environment that takes a single seed, such as
        Gymnasium's CartPole, receives the first of a list.
        """
        try:
            obs, info = self.env.reset(seed=seed)  # pyright: ignore[reportArgumentType]
        except (TypeError, gym.error.Error):
            if isinstance(seed, int):
                raise
            obs, info = self.env.reset(seed=seed[0])
        self.pending[:] = False
        first, every = self._obs(obs, self._reset_moment), np.ones(self.num_envs, dtype=bool)
        if self._critics is not None:
            self._critics.reset(info, every, self._reset_moment)
        return self._stacked(first, every)

    def step(self, actions: np.ndarray) -> EnvStep:
        """Take actions [N, ...] and return their result.

        Raises `NotFiniteError` for NaN or infinity in observations, rewards or costs, and `TrainingError` for arrays of
        another shape, and for an environment without cost, or without the `final_obs` of a truncated episode.
        """
        obs, reward, terminated, truncated, info = self.env.step(actions)
        if self.images is not None:
            self.images.act(actions)
        next_obs, valid = self._obs(obs), ~self.pending
        terminated = self._of_step("terminated", terminated, bool) & valid
        truncated = self._of_step("truncated", truncated, bool) & valid & ~terminated
        done = terminated | truncated
        finished = np.flatnonzero(done)
        cost = np.where(valid, self._cost(info, done, len(finished) > 0), 0.0)
        reward = np.where(valid, self._of_step("rewards", reward, np.float64), 0.0)
        costs = _info_value(info, "costs", done, (self.num_envs, self._kinds))
        costs = None if costs is None else np.where(valid[:, None], costs, 0.0)
        self._require_finite(reward=reward, cost=cost)
        if costs is not None:
            self._require_finite(costs=costs)
        final_obs = self._stacked_at_end(self._final_obs(next_obs, finished, truncated, info), finished)
        final_critic_obs = None
        if self._critics is not None:
            final_critic_obs = self._critics.step(info, finished, truncated, self._step_moment)
        fresh = done if self.mode is not AutoresetMode.NEXT_STEP else ~valid
        if self.mode is AutoresetMode.NEXT_STEP:
            self.pending = done
        elif self.mode is AutoresetMode.DISABLED and len(finished):
            first, begun = self.env.reset(options={"reset_mask": done})
            which = done.reshape(-1, *[1] * (next_obs.ndim - 1))
            next_obs = np.where(which, self._obs(first), next_obs)
            if self._critics is not None:
                self._critics.reset(begun, done, f"the reset in {self._step_moment}")
        self._steps += 1
        return EnvStep(
            next_obs=self._stacked(next_obs, fresh),
            fresh=fresh,
            reward=reward,
            cost=cost,
            costs=costs,
            terminated=terminated,
            truncated=truncated,
            valid=valid,
            finished=finished,
            reasons=_codes(info, "done_reason"),
            rivers=_codes(info, "river") if self._changes_river else None,
            final_obs=final_obs,
            critic_obs=self.critic_obs,
            final_critic_obs=final_critic_obs,
        )

    def state(self) -> dict[str, Any]:
        """Return what the next step depends on, except for the state of the environment."""
        critics = {} if self.critic_obs is None else {"critic_obs": self.critic_obs.copy()}
        return {
            "pending": self.pending,
            "steps": self._steps,
            "cost_seen": self._cost_seen,
            "frames": self._stack.state(),
            **critics,
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore a state of `state`."""
        self.pending = np.array(state["pending"], dtype=bool)
        self._steps, self._cost_seen = int(state["steps"]), bool(state["cost_seen"])
        self._stack.load_state(state["frames"])
        if self._critics is not None and self._critics.now is not None:
            self._critics.now = np.array(state["critic_obs"], dtype=np.float32)

    @property
    def _step_moment(self) -> str:
        """When the current step takes place, for messages."""
        return f"vector step {self._steps + 1}"

    @property
    def _reset_moment(self) -> str:
        return f"the reset after vector step {self._steps}"

    def _stacked(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return observations [N, K * D] with the frames, or the action, before; `fresh` [N] starts an episode."""
        if self.images is not None:
            return self.images.push(obs, fresh)
        return self._stack.push(torch.from_numpy(obs), torch.from_numpy(fresh)).numpy()

    def _stacked_at_end(self, last: np.ndarray, finished: np.ndarray) -> np.ndarray:
        """Return the last observations [F, ...] of the episodes of the environments `finished` as `_stacked` does."""
        if self.images is not None:
            return self.images.last_of(last, finished)
        return self._stack.peek(torch.from_numpy(last), torch.from_numpy(finished)).numpy()

    @property
    def _shape(self) -> tuple[int, ...]:
        """Shape of a single environment's observation."""
        return (self.obs_size,) if self.images is None else self.images.image

    @property
    def _kind(self) -> type:
        """Type of the numbers of an observation."""
        return np.float32 if self.images is None else np.uint8

    def _obs(self, obs: Any, moment: str = "") -> np.ndarray:
        """Return observations [N, ...] as float32, or images as bytes; raises `TrainingError` for another shape, and
        `NotFiniteError`."""
        array = np.array(obs, dtype=self._kind)
        if array.shape != (self.num_envs, *self._shape):
            expected = (self.num_envs, *self._shape)
            raise TrainingError(f"observations have shape {array.shape}, but the observation space says {expected}")
        self._require_finite(moment, observation=array)
        return array

    def _of_step(self, name: str, values: Any, kind: type) -> np.ndarray:
        """Return values [N] of a step as numbers of a kind; raises `TrainingError` for another shape."""
        array = np.asarray(values, dtype=kind)
        if array.shape != (self.num_envs,):
            raise TrainingError(f"{name} of a step must have shape {(self.num_envs,)}, got {array.shape}")
        return array

    def _cost(self, info: dict[str, Any], done: np.ndarray, any_done: bool) -> np.ndarray:
        """Return the cost [N] of a step; raises `TrainingError` once it is clear that the environment reports none."""
        cost = _info_value(info, "cost", done, (self.num_envs,))
        self._cost_seen |= cost is not None
        if cost is not None:
            return cost
        if any_done or (self._steps >= MAX_STEPS_WITHOUT_COST and not self._cost_seen):
            raise TrainingError(
                "the environment reports no cost: info['cost'] [N] is needed at every step, or at least in "
                f"info['final_info'] of a finished episode; info has {', '.join(map(repr, info)) or 'nothing'}"
            )
        return np.zeros(self.num_envs)

    def _final_obs(
        self, next_obs: np.ndarray, finished: np.ndarray, truncated: np.ndarray, info: dict[str, Any]
    ) -> np.ndarray:
        """Return the last observation [F, ...] of each finished episode; zeros where one ended by itself and the
        environment tells none."""
        if self.mode is not AutoresetMode.SAME_STEP or not len(finished):
            return next_obs[finished]
        final, rows = info.get("final_obs"), np.zeros((len(finished), *self._shape), dtype=self._kind)
        for row, i in enumerate(finished):
            if final is None or final[i] is None:
                # It does not matter after a termination, but a truncated episode is bootstrapped from it.
                if truncated[i]:
                    raise TrainingError("an episode was truncated, but info['final_obs'] has no observation of it")
                continue
            if (last := np.asarray(final[i], dtype=self._kind)).shape != self._shape:
                needed = f"vectors of {self.obs_size} numbers" if self.images is None else f"images {self._shape}"
                raise TrainingError(f"final_obs must be {needed}, got shape {last.shape}")
            rows[row] = last
        self._require_finite(final_obs=rows)
        return rows

    def _require_finite(self, moment: str = "", **arrays: np.ndarray) -> None:
        """Raise `NotFiniteError` with the name, the rows and the moment of an array with NaN or infinity."""
        moment = moment or self._step_moment
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                where = sorted({int(row) for row in np.argwhere(~np.isfinite(array))[:, 0]})
                raise NotFiniteError(f"{name} is not finite in rows {where[:8]} of {moment}")


def _vector_size(space: gym.Space) -> int:
    """Return D of a space of vectors; raises `TrainingError` for another one."""
    if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
        raise TrainingError(
            f"observations must be vectors of numbers, not {space}: wrap environments of images in LatentVectorEnv, or"
            " use policy=cnn"
        )
    return int(space.shape[0])


def _autoreset_mode(env: VectorEnv) -> AutoresetMode:
    """Return the mode in the metadata of an environment; raises `TrainingError` if it has none."""
    named = env.metadata.get("autoreset_mode")
    for mode in AutoresetMode:
        if named in (mode, mode.value, mode.name):
            return mode
    raise TrainingError(
        f"env.metadata['autoreset_mode'] must be one of {', '.join(AutoresetMode.__members__)}, got {named!r}: "
        "without it first and last observations of episodes cannot be distinguished"
    )


def _codes(info: dict[str, Any], key: str) -> Any:
    """Return codes [N] that belong to the action just taken, such as the reason why episodes ended, or None."""
    final = info.get("final_info")
    codes = final.get(key) if isinstance(final, dict) else None
    return info.get(key) if codes is None else codes


def _info_value(info: dict[str, Any], key: str, done: np.ndarray, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return `info[key]` as float64 of the given shape, or None if it is missing.

    Rows of finished environments are taken from `final_info` if it has them.
    """
    final = info.get("final_info")
    last = final.get(key) if isinstance(final, dict) else None
    if key not in info and last is None:
        return None
    values = _array(info[key], key, shape) if key in info else np.zeros(shape)
    if last is not None and isinstance(final, dict):
        given = done & np.asarray(final.get(f"_{key}", done), dtype=bool)
        given = given.reshape(-1, *[1] * (len(shape) - 1))
        values = np.where(given, _array(last, f"final_info[{key!r}]", shape), values)
    return values


def _array(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    """Return an entry of info as float64; raises `TrainingError` for another shape."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise TrainingError(f"info[{name!r}] must have shape {shape}, got {array.shape}")
    return array
