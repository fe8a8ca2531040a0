"""Thalweg: a photo-realistic river world and a benchmark of safe reinforcement learning on it.

Importing the package registers its Gymnasium ids, and a note of forks; its parts are imported when they are used.
"""

import os
import sys
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register, registry

if TYPE_CHECKING:
    from thalweg.env.tensors import TensorRiverEnv

LEVEL_IDS = {name: f"thalweg/{name}-v0" for name in ("Easy", "Medium", "Hard")}
"""Gymnasium id of each level's fixed river."""


forked_after_kernels = False
"""Whether this process was forked from one in which kernels had run on OpenMP's threads, which do not survive that."""


def _note_fork() -> None:
    """In a child just forked: see whether Numba's threads ran in the parent, and were those of OpenMP."""
    global forked_after_kernels
    numba = sys.modules.get("numba")
    try:
        forked_after_kernels |= numba is not None and numba.threading_layer() == "omp"
    except (AttributeError, ValueError):  # half imported; no kernel has run on several threads yet
        return


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def make_torch(level: str, num_envs: int = 1, **options: Any) -> "TensorRiverEnv":
    """N environments of a level whose observations, rewards and costs are tensors on one device.

    Args:
        level: "Easy", "Medium" or "Hard".
        num_envs: N.
        options: `device` ("auto" by default, see `thalweg.devices`), `world_seeds` or `worlds`, `config`, and fields of
            `thalweg.env.EnvConfig`.
    """
    from thalweg.env.making import make_tensors

    return make_tensors(level, num_envs, **options)


def register_envs() -> None:
    """Register the Gymnasium ids of the levels; a second call changes nothing."""
    for level, name in LEVEL_IDS.items():
        if name not in registry:
            register(
                id=name,
                entry_point="thalweg.env:make_single",
                vector_entry_point="thalweg.env:make_vector",
                kwargs={"level": level},
            )


register_envs()
