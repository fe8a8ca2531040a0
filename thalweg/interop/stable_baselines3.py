"""Adapter for Stable-Baselines3: a `VecEnv` over the native vector environment, which draws all frames in one call.

Single environments need no adapter: `PPO("CnnPolicy", gymnasium.make("thalweg/Easy-v0", observation="rgb"))` runs.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

from thalweg.core.extras import how_to_install
from thalweg.interop.errors import InteropError, not_installed
from thalweg.interop.vector_envs import vector_env
from thalweg.interop.vector_infos import check_same_step, info_of_each

try:
    from stable_baselines3.common.vec_env import VecEnv, VecMonitor  # pyright: ignore[reportMissingImports]
except ModuleNotFoundError as error:
    raise not_installed(error, "Stable-Baselines3", how_to_install("sb3")) from error

SHARED = ("render_mode", "spec", "metadata", "config", "camera", "cost_kinds", "done_reasons", "river_names")
"""Attributes that all environments have in common, which `RiverVecEnv.get_attr` returns."""
Indices = int | Iterable[int] | None
"""Indices of the environments that a call concerns; None for all."""


def make_vec_env(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = None,
    *,
    encoder: str | Path | None = None,
    monitor_file: str | None = None,
    **options: Any,
) -> VecMonitor:
    """Return N environments of a Gymnasium id for Stable-Baselines3, with its monitor of returns and costs.

    Args:
        env_id: such as "thalweg/Medium-v0".
        n_envs: N, the number of environments.
        seed: environment i has the seed `seed` + i; random by default.
        encoder: an encoder that comes with the package, or a file: observations are its codes, float32 [N, Z].
        monitor_file: where the monitor writes return, length and last cost of each episode; nowhere by default.
        options: those of `gymnasium.make_vec` for the id.

    Raises the errors of `RiverVecEnv`, of the id's options, and of the encoder.
    """
    vec_env = RiverVecEnv(vector_env(env_id, n_envs, encoder, options))
    vec_env.seed(seed)
    return VecMonitor(vec_env, monitor_file, info_keywords=("cost", "done_reason"))


class RiverVecEnv(VecEnv):
    """A `VecEnv` over a Gymnasium vector environment of SAME_STEP, such as the native one.

    `infos[i]` is the info of a single environment, `cost` included, with `terminal_observation` and
    `TimeLimit.truncated` as Stable-Baselines3 defines them. Rewards are float32, as in all its environments.
    """

    def __init__(self, envs: VectorEnv) -> None:
        """Wrap a vector environment; raises `InteropError` for another autoreset mode."""
        check_same_step(envs, type(self).__name__)
        self.envs = envs
        """The vector environment."""
        self._actions: np.ndarray | None = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = envs.metadata

    def reset(self) -> Any:
        """Start new episodes in all environments, with the seeds and options that were set; returns observations
        [N, ...].

        Raises `InteropError` if an option was set for some environments only.
        """
        obs, info = self.envs.reset(seed=self._seeds, options=self._reset_options_of_all())
        self.reset_infos = info_of_each(info, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return obs

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions [N, ...] for the next `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Step all environments; returns observations [N, ...], rewards [N], ends [N] and infos."""
        obs, reward, terminated, truncated, info = self.envs.step(self._actions)
        infos = info_of_each(info, self.num_envs)
        for row, told in enumerate(infos):
            told["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
        for row in np.flatnonzero(terminated | truncated):
            infos[row]["terminal_observation"] = info["final_obs"][row]
            self.reset_infos[row] = {}  # a step's info has nothing of the reset
        return obs, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return N frames [H, W, 3] uint8, or N times None without a render mode."""
        frames: Any = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute that all environments share, once for each; raises `AttributeError` for others."""
        if attr_name in ("observation_space", "action_space"):
            value = getattr(self.envs, f"single_{attr_name}")
        elif attr_name in SHARED:
            value = getattr(self.envs.unwrapped, attr_name)
        else:
            raise AttributeError(
                f"the environments of {type(self).__name__} are one object and share their attributes;"
                f" get_attr knows {', '.join(SHARED)}, not {attr_name!r}. `envs` is the object"
            )
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Raise `AttributeError`: environments that are one object have no attributes of their own."""
        raise AttributeError(
            f"the environments of {type(self).__name__} are one object: {attr_name!r} cannot be set for some of them."
            " Give it as an option when they are made"
        )

    def env_method(self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any) -> list[Any]:
        """Return what `pilot_action` of each environment returns; raises `AttributeError` for other methods."""
        if method_name != "pilot_action":
            raise AttributeError(
                f"the environments of {type(self).__name__} are one object; env_method knows pilot_action, not"
                f" {method_name!r}. `envs` is the object"
            )
        actions = self.envs.unwrapped.pilot_actions(*args, **kwargs)  # pyright: ignore[reportAttributeAccessIssue]
        return [actions[row] for row in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """Return False for each environment: wrappers of single environments cannot be applied here."""
        return [False for _ in self._get_indices(indices)]

    def _reset_options_of_all(self) -> dict[str, Any] | None:
        """Return the options of the next reset, for all environments at once, or None.

        Raises `InteropError` if their keys differ between environments.
        """
        keys = {key for options in self._options for key in options or {}}
        for key in keys:
            lacking = [row for row, options in enumerate(self._options) if key not in (options or {})]
            if lacking:
                raise InteropError(f"the option {key!r} must be set for all environments; it is not for {lacking}")
        return {key: np.stack([np.asarray(options[key]) for options in self._options]) for key in keys} or None
