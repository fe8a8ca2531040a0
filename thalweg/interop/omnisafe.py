"""Adapter for OmniSafe: importing this module registers Thalweg's ids as its environments.

OmniSafe's policies see vectors and take continuous actions. Gaussian policies may leave the range of the actions; the
adapter clips them, as Safety-Gymnasium does.
"""

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor

from thalweg.interop.errors import InteropError, not_installed
from thalweg.interop.safety_gymnasium import SafetyEnv, SafetyVectorEnv
from thalweg.interop.vector_envs import vector_env

try:
    from omnisafe.envs.core import CMDP, env_register, support_envs  # pyright: ignore[reportMissingImports]
except ModuleNotFoundError as error:
    raise not_installed(error, "OmniSafe", "docs/other-libraries.md says how to install it") from error

IDS = tuple(name for name in gymnasium.registry if name.startswith("thalweg/"))
"""Ids of Gymnasium that the package has registered."""
PRIVILEGED, IMAGES = "privileged", "rgb+mask"
"""Default observation without an encoder, and with one."""
_REGISTERED: dict[str, tuple[str, dict[str, Any]]] = {}
"""Id of Gymnasium and options of each id that was registered here."""


@env_register
class RiverCMDP(CMDP):
    """One environment, or N over the native vector environment, as a `CMDP` of OmniSafe.

    Its options are those of `gymnasium.make`, or of `gymnasium.make_vec` for more than one, and `encoder`: the name or
    the file of an encoder whose codes are observations. Without an encoder, the privileged observation is used.
    `register` gives an id to some options, since few algorithms of OmniSafe take them as `env_cfgs`.
    """

    _support_envs: ClassVar[list[str]] = [*IDS]
    need_time_limit_wrapper = False
    need_auto_reset_wrapper = False

    def __init__(
        self,
        env_id: str,
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        encoder: str | Path | None = None,
        **options: Any,
    ) -> None:
        """Create the environments; raises `InteropError` for observations or actions that OmniSafe cannot take."""
        super().__init__(env_id)
        if env_id in _REGISTERED:
            env_id, given = _REGISTERED[env_id]
            encoder, options = encoder or given.get("encoder"), {**given, **options}
            options.pop("encoder", None)
        options = {"action": "continuous", "observation": PRIVILEGED if encoder is None else IMAGES, **options}
        self._num_envs, self._device = num_envs, torch.device(device)
        self.need_auto_reset_wrapper = num_envs == 1  # the native vector environment resets by itself
        made = _vector(env_id, num_envs, encoder, options) if num_envs > 1 else _single(env_id, encoder, options)
        self._env: Any = made
        self._observation_space: Any = getattr(made, "single_observation_space", made.observation_space)
        self._action_space = getattr(made, "single_action_space", made.action_space)
        self._metadata = made.metadata
        _check_spaces(self._observation_space, self._action_space)

    @property
    def max_episode_steps(self) -> int | None:
        """Step limit of an episode, if `max_steps` was set; None for the default limit of the river."""
        env = self._env.unwrapped
        return (env if self._num_envs > 1 else env.vector).config.max_steps

    def step(self, action: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Take one action [4], or [N, 4]; returns observation, reward, cost, terminated, truncated and info.

        Of many environments, `info["final_observation"]` [N, D] has the last observations of episodes that ended, zeros
        for others, and `info["_final_observation"]` [N] says which; both are absent where no episode ended.
        """
        obs, *rest, info = self._env.step(action.detach().cpu().numpy().clip(-1.0, 1.0))
        if "final_observation" in info:
            ended = info["_final_observation"]
            final = np.zeros((self._num_envs, *self._observation_space.shape), np.float32)
            final[ended] = np.stack(list(info["final_observation"][ended]))
            info["final_observation"] = self._tensor(final)
            info["_final_observation"] = torch.as_tensor(ended, device=self._device)
        reward, cost, terminated, truncated = (self._tensor(value) for value in rest)
        return self._tensor(obs), reward, cost, terminated, truncated, info

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Tensor, dict[str, Any]]:
        """Start new episodes; returns observation [D], or [N, D], and info."""
        obs, info = self._env.reset(seed=seed, options=options)
        return self._tensor(obs), info

    def set_seed(self, seed: int) -> None:
        """Start new episodes, of which that of environment i has the seed `seed` + i."""
        self.reset(seed=seed)

    def render(self) -> Any:
        """Return the frame of the current state [H, W, 3] uint8; for many environments a tuple of them."""
        return self._env.render()

    def close(self) -> None:
        """Close the environments."""
        self._env.close()

    def _tensor(self, value: Any) -> Tensor:
        return torch.as_tensor(value, dtype=torch.float32, device=self._device)


def register(name: str, env_id: str, **options: Any) -> None:
    """Register an id of OmniSafe for an id of Gymnasium with some options of `RiverCMDP`.

    Raises `InteropError` for an id that is taken, or an unknown one of Gymnasium.
    """
    if name in support_envs():
        raise InteropError(f"OmniSafe has an environment {name!r} already: choose another name")
    if env_id not in IDS:
        raise InteropError(f"unknown id {env_id!r}; known: {', '.join(IDS)}")
    _REGISTERED[name] = env_id, options
    RiverCMDP._support_envs.append(name)


def _single(env_id: str, encoder: str | Path | None, options: dict[str, Any]) -> SafetyEnv:
    """Return a single environment, with codes as observations if an encoder is given."""
    env = gymnasium.make(env_id, **options)
    if encoder is not None:
        from thalweg.interop.latent import LatentEnv

        env = LatentEnv(env, encoder)
    return SafetyEnv(env)


def _vector(env_id: str, num_envs: int, encoder: str | Path | None, options: dict[str, Any]) -> SafetyVectorEnv:
    """Return N environments, with codes as observations if an encoder is given."""
    return SafetyVectorEnv(vector_env(env_id, num_envs, encoder, options))


def _check_spaces(observations: gymnasium.Space, actions: gymnasium.Space) -> None:
    """Raise `InteropError` unless observations are vectors and actions continuous."""
    if not isinstance(actions, Box):
        raise InteropError(f"OmniSafe takes continuous actions, not {actions}: leave action= out, or 'continuous'")
    if not isinstance(observations, Box) or len(observations.shape) != 1:
        raise InteropError(
            f"OmniSafe sees vectors, not {observations}: choose observation='privileged', or an encoder, whose codes"
            " are then observed"
        )
