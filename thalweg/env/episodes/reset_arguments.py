"""Arguments of a vector environment's reset, checked before anything changes: seeds, reset mask, poses."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from thalweg.core.config import refuse_unknown
from thalweg.env.config import ConfigError, EnvConfig, integer_at_least
from thalweg.env.initial_poses import check_pose
from thalweg.env.rivers.assignment import DrawnRivers, Rivers

RESET_OPTIONS = ("pose", "reset_mask")


def autoreset_mode_of(given: AutoresetMode | str) -> AutoresetMode:
    """Return an autoreset mode from itself or its name; raises `ConfigError` for an unknown one."""
    for mode in AutoresetMode:
        if given is mode or (isinstance(given, str) and given.lower() in (mode.value.lower(), mode.name.lower())):
            return mode
    raise ConfigError(f"unknown autoreset_mode {given!r}; known: {', '.join(mode.name for mode in AutoresetMode)}")


def first_seed(seed: int | Sequence[int | None] | None) -> int | None:
    """Return the seed if one is given for all environments, None if a list or nothing is; raises `ConfigError`."""
    if seed is None:
        return None
    if isinstance(seed, str) or not hasattr(seed, "__len__") or getattr(seed, "shape", None) == ():
        return integer_at_least("seed", seed, 0)
    return None


def seeds_of(seed: int | Sequence[int | None] | None, num_envs: int) -> Sequence[int | None]:
    """Return one seed or None per environment: seed + i, or those listed; raises `ConfigError` for anything else."""
    if seed is None:
        return [None] * num_envs
    if (first := first_seed(seed)) is not None:
        return [first + row for row in range(num_envs)]
    assert not isinstance(seed, int)
    if not (isinstance(seed, Sequence) or hasattr(seed, "shape")) or isinstance(seed, bytes):
        raise ConfigError(f"seed must be a number or a list of one for each environment, not {seed!r:.60}")
    if len(seed) != num_envs:
        raise ConfigError(f"{len(seed)} seeds for {num_envs} environments")
    return [None if one is None else integer_at_least("each seed", one, 0) for one in seed]


def rows_and_poses(
    options: Mapping[str, Any] | None, started: np.ndarray, config: EnvConfig, rivers: Rivers
) -> tuple[list[int], np.ndarray | None]:
    """Return the rows to reset and their poses [N, 4] or None; started [N] bool: those that had a reset before.

    Raises `ConfigError`, `UnsafePoseError` and `gymnasium.error.ResetNeeded`.
    """
    options = {} if options is None else options
    if not isinstance(options, Mapping):
        raise ConfigError(f"options must be a mapping such as {{'pose': [x, y, z, yaw]}}, not {options!r:.60}")
    refuse_unknown("reset option", options, RESET_OPTIONS, ConfigError)
    rows = _rows(options.get("reset_mask"), started)
    poses = options.get("pose")
    return rows, None if poses is None else _poses(poses, rows, config, rivers)


def _rows(mask: Any, started: np.ndarray) -> list[int]:
    """Return the rows to reset by a mask [N] bool or None, which is all."""
    mask = np.asarray(np.ones_like(started) if mask is None else mask)
    if mask.dtype != bool or mask.shape != started.shape:
        raise ConfigError(f"reset_mask must be [{len(started)}] bool, got {list(mask.shape)} {mask.dtype}")
    if not mask.any():
        raise ConfigError(f"reset_mask must have at least one True, got {len(mask)} times False")
    if not (started | mask).all():
        raise gymnasium.error.ResetNeeded("the first reset must include every environment")
    return np.flatnonzero(mask).tolist()


def _poses(given: Any, rows: Sequence[int], config: EnvConfig, rivers: Rivers) -> np.ndarray:
    """Return poses [N, 4] from one or N of them, of which those of `rows` are safe."""
    if isinstance(rivers, DrawnRivers):
        raise ConfigError("options['pose'] needs environments that stay in one river: a pose lies in one river")
    num_envs = len(rivers.slot)
    try:
        poses = np.asarray(given, dtype=np.float64)
    except (ValueError, TypeError) as error:  # nested lists of different lengths, or no numbers
        raise ConfigError(f"pose is {given!r:.60}, no array of numbers: {error}") from None
    if poses.shape not in ((4,), (num_envs, 4)):
        raise ConfigError(f"pose has shape {poses.shape}; needed: (4,) or ({num_envs}, 4)")
    poses = np.broadcast_to(poses, (num_envs, 4))
    for row in rows:
        check_pose(rivers.courses, int(rivers.slot[row]), config, poses[row])
    return poses
