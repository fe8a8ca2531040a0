"""How does one episode run? The Gymnasium environment: a vector of one, so that both obey the same code."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from thalweg.env.actions import row_of_one
from thalweg.env.config import DEFAULT_CONFIG, REASON_NAMES, EnvConfig, whole
from thalweg.env.observation import one_of
from thalweg.env.vector_env import RiverVectorEnv
from thalweg.world.record import World

INFO = {"cost": float, "done_reason": int, "progress": float}
"""What is a plain number in the info of one environment; the rest are arrays."""


class RiverEnv(gymnasium.Env):
    """One environment in one world; `info` has the keys of `RiverVectorEnv` without the leading dimension."""

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 1.0 / DEFAULT_CONFIG.step_s,
    }
    done_reasons = REASON_NAMES

    def __init__(
        self, world: World, config: EnvConfig = DEFAULT_CONFIG, *, renderer: Any = None, render_mode: str | None = None
    ) -> None:
        """`renderer` as for `RiverVectorEnv`."""
        self.vector = RiverVectorEnv(
            [world], 1, config, renderer=renderer, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode
        )
        self.metadata = {**self.metadata, "render_fps": self.vector.metadata["render_fps"]}
        self.render_mode = render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(self, *, seed: int | None = None, options: Mapping[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode, at `options["pose"]` [4] if given; returns observation and info."""
        rows, poses = self.vector.checked_options(options)
        super().reset(seed=None if seed is None else whole("seed", seed, 0))
        first = self.vector.generators[0] is None
        self.vector.generators[0] = self.np_random
        if first or seed is not None:
            self.vector.draw_look(0, "environment")
        observations, info = self.vector.begin(rows, poses)
        return one_of(observations, 0), _single(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One action [4]: observation, reward, terminated, truncated, info."""
        observations, rewards, terminated, truncated, info = self.vector.step(row_of_one(action))
        return one_of(observations, 0), float(rewards[0]), bool(terminated[0]), bool(truncated[0]), _single(info)

    def render(self) -> np.ndarray | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The frame now seen [H, W, 3] uint8; None without a render mode."""
        frames = self.vector.render()
        return None if frames is None else frames[0]

    def observe(self) -> Any:
        """The observation of the present state; for use after `set_state`."""
        return one_of(self.vector.observe(), 0)

    def pilot_action(self) -> np.ndarray:
        """The action [4] of the scripted pilot for the present state."""
        return self.vector.pilot_actions()[0]

    def get_state(self) -> dict[str, np.ndarray]:
        """The state as `RiverVectorEnv.get_state` gives it, with N = 1."""
        return self.vector.get_state()

    def set_state(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a state of `get_state`."""
        self.vector.set_state(state)
        if self.vector.generators[0] is not None:
            self.np_random = self.vector.generators[0]


def _single(info: Mapping[str, Any]) -> dict[str, Any]:
    """The info of a vector of one without its leading dimension and its marks."""
    return {
        key: INFO[key](value[0]) if key in INFO else value[0].copy()
        for key, value in info.items()
        if not key.startswith("_")
    }
