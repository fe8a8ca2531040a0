"""What did an action lead to? One answer for every Gymnasium vector environment, whichever way it resets itself.

SAME_STEP hides an episode's last observation in `final_obs`, and its cost perhaps in `final_info`; NEXT_STEP spends
a step on the reset, in which nothing happened; DISABLED waits to be reset. After this file nobody needs to know.
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
from thalweg.train.rollouts.episodes import Account

PATIENCE = 10_000
"""Vector steps without a finished episode after which an environment that has never named a cost is refused."""


@dataclass(frozen=True)
class Step(Account):
    """What one action of each environment led to. N environments, F of them finished their episode."""

    next_obs: np.ndarray
    """[N, K * D] float32, what the next action will see: K frames side by side."""
    fresh: np.ndarray
    """[N] bool, whether that begins an episode."""
    final_obs: np.ndarray
    """[F, K * D] float32, what their episodes ended with."""


class Stream:
    """Steps through a vector environment; raises `TrainingError` at once for one that can't be trained on."""

    def __init__(self, env: VectorEnv, frames: int = 1) -> None:
        """`frames`: K, how many of the last observations are seen side by side."""
        if not hasattr(env, "single_observation_space"):
            raise TrainingError(
                f"training takes a Gymnasium VectorEnv, as gymnasium.make_vec makes it, not {type(env).__name__}"
            )
        space = env.single_observation_space
        if not isinstance(space, gym.spaces.Box) or len(space.shape) != 1:
            raise TrainingError(
                f"observations must be vectors of numbers, not {space}: images go through LatentVectorEnv"
            )
        self.env, self.num_envs, self.obs_size = env, env.num_envs, int(space.shape[0])
        self.mode = _autoreset_mode(env)
        self._stack = FrameStack(self.num_envs, self.obs_size, frames)
        self.pending = np.zeros(self.num_envs, dtype=bool)
        """[N] environments whose next step only resets them (NEXT_STEP)."""
        self._steps, self._cost_seen = 0, False

    def reset(self, seed: int | list[int]) -> np.ndarray:
        """The first observations [N, K * D] float32; `seed` as Gymnasium's vector environments take it.

        Of a list, an environment that takes but one seed, as Gymnasium's own CartPole, gets the first.
        """
        try:
            obs, _ = self.env.reset(seed=seed)  # pyright: ignore[reportArgumentType]
        except (TypeError, gym.error.Error):
            if isinstance(seed, int):
                raise
            obs, _ = self.env.reset(seed=seed[0])
        self.pending[:] = False
        first = self._obs(obs, f"the reset after vector step {self._steps}")
        return self._pushed(first, np.ones(self.num_envs, dtype=bool))

    def step(self, actions: np.ndarray) -> Step:
        """What the actions [N, ...] led to.

        Raises `NotFiniteError` for NaN or infinity in observations, rewards or costs, and `TrainingError` for an
        environment that names no cost, or no `final_obs` of an episode cut off.
        """
        obs, reward, terminated, truncated, info = self.env.step(actions)
        next_obs, valid = self._obs(obs), ~self.pending
        terminated = np.asarray(terminated, dtype=bool) & valid
        truncated = np.asarray(truncated, dtype=bool) & valid & ~terminated
        done = terminated | truncated
        finished = np.flatnonzero(done)
        cost = np.where(valid, self._cost(info, done, len(finished) > 0), 0.0)
        reward = np.where(valid, np.asarray(reward, dtype=np.float64), 0.0)
        costs = _named(info, "costs", done, (self.num_envs, 2))
        costs = None if costs is None else np.where(valid[:, None], costs, 0.0)
        self._require_finite(reward=reward, cost=cost)
        if costs is not None:
            self._require_finite(costs=costs)
        last = torch.from_numpy(self._final_obs(next_obs, finished, truncated, info))
        final_obs = self._stack.peek(last, torch.from_numpy(finished)).numpy()
        fresh = done if self.mode is not AutoresetMode.NEXT_STEP else ~valid
        if self.mode is AutoresetMode.NEXT_STEP:
            self.pending = done
        elif self.mode is AutoresetMode.DISABLED and len(finished):
            first, _ = self.env.reset(options={"reset_mask": done})
            next_obs = np.where(done[:, None], self._obs(first), next_obs)
        self._steps += 1
        return Step(
            next_obs=self._pushed(next_obs, fresh),
            fresh=fresh,
            reward=reward,
            cost=cost,
            costs=costs,
            terminated=terminated,
            truncated=truncated,
            valid=valid,
            finished=finished,
            reasons=_reasons(info),
            final_obs=final_obs,
        )

    def state(self) -> dict[str, Any]:
        """What the next step depends on beside the environment's own state."""
        return {
            "pending": self.pending,
            "steps": self._steps,
            "cost_seen": self._cost_seen,
            "frames": self._stack.state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self.pending = np.array(state["pending"], dtype=bool)
        self._steps, self._cost_seen = int(state["steps"]), bool(state["cost_seen"])
        self._stack.load_state(state["frames"])

    def _pushed(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        return self._stack.push(torch.from_numpy(obs), torch.from_numpy(fresh)).numpy()

    def _obs(self, obs: Any, moment: str = "") -> np.ndarray:
        array = np.array(obs, dtype=np.float32)
        if array.shape != (self.num_envs, self.obs_size):
            raise TrainingError(f"observations of {(self.num_envs, self.obs_size)} were announced, got {array.shape}")
        self._require_finite(moment, observation=array)
        return array

    def _cost(self, info: dict[str, Any], done: np.ndarray, any_done: bool) -> np.ndarray:
        cost = _named(info, "cost", done, (self.num_envs,))
        self._cost_seen |= cost is not None
        if cost is not None:
            return cost
        if any_done or (self._steps >= PATIENCE and not self._cost_seen):
            raise TrainingError(
                "the environment names no cost: info['cost'] [N] is needed at every step, or at least in "
                f"info['final_info'] of a finished episode; info has {', '.join(map(repr, info)) or 'nothing'}"
            )
        return np.zeros(self.num_envs)

    def _final_obs(
        self, next_obs: np.ndarray, finished: np.ndarray, truncated: np.ndarray, info: dict[str, Any]
    ) -> np.ndarray:
        if self.mode is not AutoresetMode.SAME_STEP or not len(finished):
            return next_obs[finished]
        final = info.get("final_obs")
        if final is None or any(final[i] is None for i in finished):
            # After a termination nothing is asked of the last observation; after a truncation everything depends on it.
            if truncated.any():
                raise TrainingError("an episode was cut off, but info['final_obs'] does not say where")
            return np.zeros((len(finished), self.obs_size), dtype=np.float32)
        rows = np.stack([np.asarray(final[i], dtype=np.float32) for i in finished])
        if rows.shape[1:] != (self.obs_size,):
            raise TrainingError(f"final_obs must be vectors of {self.obs_size} numbers, got shape {rows.shape[1:]}")
        self._require_finite(final_obs=rows)
        return rows

    def _require_finite(self, moment: str = "", **arrays: np.ndarray) -> None:
        moment = moment or f"vector step {self._steps + 1}"
        for name, array in arrays.items():
            if not np.isfinite(array).all():
                where = sorted({int(row) for row in np.argwhere(~np.isfinite(array))[:, 0]})
                raise NotFiniteError(f"{name} is not finite in rows {where[:8]} of {moment}")


def _autoreset_mode(env: VectorEnv) -> AutoresetMode:
    named = env.metadata.get("autoreset_mode")
    for mode in AutoresetMode:
        if named in (mode, mode.value, mode.name):
            return mode
    raise TrainingError(
        f"env.metadata['autoreset_mode'] must be one of {', '.join(AutoresetMode.__members__)}, got {named!r}: "
        "without it nobody can tell a first observation from a last one"
    )


def _reasons(info: dict[str, Any]) -> Any:
    """[N] what the environment says of why episodes ended; None if nothing."""
    final = info.get("final_info")
    codes = final.get("done_reason") if isinstance(final, dict) else None
    return info.get("done_reason") if codes is None else codes


def _named(info: dict[str, Any], key: str, done: np.ndarray, shape: tuple[int, ...]) -> np.ndarray | None:
    """`info[key]` as float64 of the given shape, finished environments' rows taken from `final_info` if they are there.
    None if it stands nowhere."""
    final = info.get("final_info")
    last = final.get(key) if isinstance(final, dict) else None
    if key not in info and last is None:
        return None
    values = _array(info[key], key, shape) if key in info else np.zeros(shape)
    if last is not None and isinstance(final, dict):
        told = done & np.asarray(final.get(f"_{key}", done), dtype=bool)
        told = told.reshape(-1, *[1] * (len(shape) - 1))
        values = np.where(told, _array(last, f"final_info[{key!r}]", shape), values)
    return values


def _array(value: Any, name: str, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise TrainingError(f"info[{name!r}] must have shape {shape}, got {array.shape}")
    return array
