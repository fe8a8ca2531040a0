"""Functions on vector environments that adapters share: check of the autoreset mode, values of the action just taken,
and info of each environment."""

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


def not_told(info: Mapping[str, Any], key: str) -> InteropError:
    """Return the error of an environment whose info lacks a key."""
    return InteropError(f"the environment tells no {key}: info has {', '.join(sorted(info)) or 'nothing'}, not {key}")


def values_of_step(info: Mapping[str, Any], key: str, ended: np.ndarray) -> np.ndarray:
    """Return the values [N] of the action just taken; raises `InteropError` if the environments tell none.

    Where an episode `ended` [N] bool, they are those of `final_info` if it has them: in Gymnasium's vectors of single
    environments, `info[key]` is then of the reset that followed. An environment that tells nothing has 0.
    """
    final = info.get("final_info", {})
    if key not in info and key not in final:
        raise not_told(info, key)
    values = np.array(info[key] if key in info else np.zeros_like(final[key]))
    if key in final:
        told = ended & np.asarray(final.get(f"_{key}", ended), dtype=bool)
        values[told] = np.asarray(final[key])[told]
    return values


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
