"""Gymnasium environment of one episode, implemented as a vector environment of one."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, EnvConfig, integer_at_least
from thalweg.env.spaces import batch_of_one, observation_at
from thalweg.env.vector_env import RiverVectorEnv
from thalweg.render.records.camera import Distortion
from thalweg.render.records.pinhole import CameraMatrices
from thalweg.world.record import World


class RiverEnv(gymnasium.Env):
    """One environment in one world; `info` has the keys of `RiverVectorEnv` without the leading dimension."""

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 1.0 / DEFAULT_CONFIG.step_s,
    }
    done_reasons = REASON_NAMES
    critic_space: gymnasium.spaces.Box
    """Space of `info["critic_obs"]`; absent without it."""

    def __init__(
        self, world: World, config: EnvConfig = DEFAULT_CONFIG, *, renderer: Any = None, render_mode: str | None = None
    ) -> None:
        """Create the environment; arguments and errors as for `RiverVectorEnv`."""
        self.vector = RiverVectorEnv(
            [world], 1, config, renderer=renderer, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode
        )
        self.metadata = {**self.metadata, "render_fps": self.vector.metadata["render_fps"]}
        self.render_mode = render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space
        self.cost_kinds = self.vector.cost_kinds
        """Names of the K kinds of `info["costs"]`."""
        if config.critic_info:
            self.critic_space = self.vector.single_critic_space

    @property
    def camera_matrices(self) -> CameraMatrices:
        """Matrices K [3, 3], R [3, 3] and t [3] of the camera in the current state, in OpenCV's convention; see
        `thalweg.render.records.pinhole`."""
        return CameraMatrices(*(matrices[0] for matrices in self.vector.camera_matrices))

    @property
    def camera_distortion(self) -> Distortion:
        """Distortion of the camera, coefficients [D]; see `RiverVectorEnv.camera_distortion`."""
        model, coefficients = self.vector.camera_distortion
        return Distortion(model, coefficients[0])

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start a new episode, at `options["pose"]` [4] if given; returns observation and info."""
        rows, poses = self.vector.validate_options(options)
        super().reset(seed=None if seed is None else integer_at_least("seed", seed, 0))
        first = self.vector.generators[0] is None
        self.vector.generators[0] = self.np_random
        if first or seed is not None:
            self.vector.frames.draw_look(0, "environment", self.np_random)
        observations, info = self.vector.start_episodes(rows, poses)
        return observation_at(observations, 0), _single(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one action [4]; returns observation, reward, terminated, truncated and info; see
        `RiverVectorEnv.step`."""
        observations, rewards, terminated, truncated, info = self.vector.step(batch_of_one(action))
        return (
            observation_at(observations, 0),
            float(rewards[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            _single(info),
        )

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the frame of the current state [H, W, 3] uint8, or None without a render mode."""
        frames = self.vector.render()
        return None if frames is None else frames[0]

    def observe(self) -> Any:
        """Return the observation of the current state; for use after `set_state`."""
        return observation_at(self.vector.observe(), 0)

    def pilot_action(self, pilot: str = "scripted") -> np.ndarray:
        """Return the action [4] of a pilot in the current state; see `RiverVectorEnv.pilot_actions`."""
        return self.vector.pilot_actions(pilot)[0]

    def get_state(self) -> dict[str, np.ndarray]:
        """Return the state as `RiverVectorEnv.get_state` does, with N = 1."""
        return self.vector.get_state()

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a state of `get_state`."""
        self.vector.set_state(state)
        if self.vector.generators[0] is not None:
            self.np_random = self.vector.generators[0]


def _single(info: Mapping[str, Any]) -> dict[str, Any]:
    """Return the info of a vector of one without the leading dimension and without Gymnasium's masks.

    Numbers are NumPy's scalars, of which other libraries read the type.
    """
    return {key: value[0].copy() for key, value in info.items() if not key.startswith("_")}
