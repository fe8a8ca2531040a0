"""Is there memory for so many environments on a device? Told by what one takes, before any is made."""

from typing import Any

import numpy as np

from thalweg.core import gpu
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.task.course_arrays import Courses
from thalweg.env.task.rules import empty_outcome, empty_state
from thalweg.world.generate import memory

BESIDE = 256
"""Bytes of an environment's actions, seeds, looks, and of what a step returns."""


def bytes_each(courses: Courses, config: EnvConfig, frames: int) -> int:
    """What an environment takes that keeps so many of its frames."""
    held = (*empty_state(np.zeros(1, np.int64), courses), *empty_outcome(1))
    seen = 0 if config.observation == "none" else 4 * config.camera.height_px * config.camera.width_px
    return sum(array.nbytes for array in held) + BESIDE + frames * seen


def free_bytes(device: Any) -> int | None:
    """Memory that is free on a torch device; None where the system does not tell."""
    return memory.free_bytes() if device.type == "cpu" else gpu.free_bytes(device)


def check_room(num_envs: int, each: int, beside: int, free: int | None) -> None:
    """Raise `ConfigError` unless so many environments of `each` bytes fit into the free ones, and `beside` them what is
    needed once."""
    if free is None or num_envs * each + beside <= free:
        return
    fitting = max(0, (free - beside) // each)
    raise ConfigError(
        f"num_envs = {num_envs:,} takes {(num_envs * each + beside) / 1e9:.2f} GB of the device's memory, of which"
        f" {free / 1e9:.2f} GB are free: at most {fitting:,} fit, and what encodes and learns takes room beside them"
    )
