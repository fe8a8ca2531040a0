"""Adapter for PufferLib: a native `PufferEnv` over the native vector environment, which draws all frames in one call.

Single environments need no adapter: PufferLib's `GymnasiumPufferEnv` takes them, dictionaries of observations included.
"""

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv

from thalweg.interop.errors import InteropError, not_installed
from thalweg.interop.vector_envs import vector_env
from thalweg.interop.vector_infos import check_same_step, values_of_step

try:
    from pufferlib import PufferEnv  # pyright: ignore[reportMissingImports]
except ModuleNotFoundError as error:
    raise not_installed(error, "PufferLib", "docs/other-libraries.md says how to install it") from error

TOLD = ("episode_return", "episode_length", "episode_cost", "done_reason")
"""What the info of an episode that ended tells."""


class RiverPufferEnv(PufferEnv):  # pyright: ignore[reportGeneralTypeIssues]  # this module has its name
    """N environments of a Gymnasium id as one `PufferEnv`, whose steps write into PufferLib's buffers.

    A new episode begins in the step in which one ends. The info of a step is a list with a dictionary for each episode
    that ended: `episode_return`, `episode_length`, `episode_cost`, the sum of its costs, and `done_reason`, its code.
    """

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        buf: Any = None,
        seed: int | None = None,
        *,
        encoder: str | Path | None = None,
        **options: Any,
    ) -> None:
        """Create the environments.

        Args:
            env_id: such as "thalweg/Medium-v0".
            num_envs: N, the number of environments.
            buf: PufferLib's buffers, which its vector environments give; new ones by default.
            seed: environment i has the seed `seed` * N + i in the first reset without one; random by default. Instances
                with the seeds 0, 1, 2, ..., as PufferLib gives them, thus share none.
            encoder: an encoder that comes with the package, or a file: observations are its codes, float32 [N, Z].
            options: those of `gymnasium.make_vec` for the id.

        Raises `InteropError` for observations that are dictionaries and for another autoreset mode than SAME_STEP, and
        the errors of the id's options and of the encoder.
        """
        self.envs = vector_env(env_id, num_envs, encoder, options)
        """The vector environment."""
        self._seed = seed
        self._sums = np.zeros((3, num_envs))  # return, length and cost of the episodes that go on
        try:
            check_same_step(self.envs, type(self).__name__)
            self.single_observation_space = _array_space(self.envs)
            self.single_action_space = self.envs.single_action_space
            self.num_agents = num_envs
            super().__init__(buf)
        except BaseException:
            self.envs.close()
            raise

    def reset(self, seed: int | None = None) -> tuple[np.ndarray, list[dict[str, float]]]:
        """Begin new episodes, environment i with the seed `seed` * N + i if one is given.

        Returns observations [N, ...], which are the buffer, and an empty list.
        """
        seed = self._seed if seed is None else seed
        obs, _ = self.envs.reset(seed=None if seed is None else seed * self.num_agents)
        self._seed = None
        self._sums[:] = 0
        self.observations[:] = obs
        self.rewards[:], self.terminals[:], self.truncations[:], self.masks[:] = 0, False, False, True
        return self.observations, []

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[dict[str, float]]]:
        """Take one action per environment [N, 4]; returns observations [N, ...], rewards, terminals and truncations
        [N], which are the buffers, and the infos of the episodes that ended."""
        self.actions[:] = actions
        obs, rewards, terminated, truncated, info = self.envs.step(self.actions.astype(self.single_action_space.dtype))
        self.observations[:], self.rewards[:] = obs, rewards
        self.terminals[:], self.truncations[:] = terminated, truncated
        done = terminated | truncated
        cost, reason = (values_of_step(info, key, done) for key in ("cost", "done_reason"))
        self._sums += np.stack([rewards, np.ones(self.num_agents), cost])
        ended, rows = np.flatnonzero(done), [*self._sums, reason]
        infos = [{name: float(values[row]) for name, values in zip(TOLD, rows, strict=True)} for row in ended]
        self._sums[:, ended] = 0
        return self.observations, self.rewards, self.terminals, self.truncations, infos

    def render(self) -> Any:
        """Return N frames uint8 [H, W, 3] with `render_mode="rgb_array"`, None without a render mode."""
        return self.envs.render()

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()


def _array_space(envs: VectorEnv) -> Box:
    """Return the space of an observation; raises `InteropError` for observations that are not one array."""
    space = envs.single_observation_space
    if not isinstance(space, Box):
        raise InteropError(
            f"a PufferEnv has observations that are one array, not a {type(space).__name__}: choose another"
            " observation=, or give gymnasium.make's environments to PufferLib's GymnasiumPufferEnv"
        )
    return space
