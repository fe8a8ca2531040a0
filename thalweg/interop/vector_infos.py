"""Functions on vector environments that adapters share: check of the autoreset mode, and info of each environment."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv

from thalweg.interop.errors import InteropError

FINAL = ("final_obs", "final_info")
"""Keys of an info for the last states of episodes that ended."""


def check_same_step(envs: VectorEnv, adapter: str) -> None:
    """Raise `InteropError` unless a new episode begins in the step in which one ends, Gymnasium's SAME_STEP."""
    mode = envs.metadata.get("autoreset_mode")
    if mode != AutoresetMode.SAME_STEP:
        raise InteropError(
            f"{adapter} needs a vector environment whose autoreset_mode is SAME_STEP, not"
            f" {getattr(mode, 'name', mode)}: leave autoreset_mode= of gymnasium.make_vec out"
        )


def info_of_each(info: Mapping[str, Any], num_envs: int) -> list[dict[str, Any]]:
    """Return the info of each environment, without masks and the `FINAL` keys.

    An environment has a key unless the mask of the key excludes it. Where an episode ended, the values are
    those of `final_info`, which belong to its last state.
    """
    each = [{} for _ in range(num_envs)]
    _spread(info, np.ones(num_envs, dtype=bool), each)
    if "final_info" in info:
        ended = np.asarray(info["_final_info"], dtype=bool)
        _spread(info["final_info"], ended, each)
    return each


def _spread(info: Mapping[str, Any], rows: np.ndarray, each: list[dict[str, Any]]) -> None:
    """Write values [N, ...] of a vector's info into the infos of its environments `rows` [N] bool."""
    for key, value in info.items():
        if key.startswith("_") or key in FINAL:
            continue
        told = rows & np.asarray(info.get(f"_{key}", rows), dtype=bool)
        for row in np.flatnonzero(told):
            if isinstance(value, Mapping):
                inner = [{} for _ in each]
                _spread(value, told, inner)
                each[row][key] = inner[row]
            else:
                each[row][key] = value[row].copy() if isinstance(value[row], np.ndarray) else value[row]
