"""Memory of `TensorRiverEnv` on a device: the demand of N environments, checked before any is created."""

from typing import Any

import numpy as np

from thalweg.core.compute import gpu
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.forces.arrays import empty_forces
from thalweg.env.task.course_arrays import CourseArrays
from thalweg.env.task.rules import empty_outcome, empty_state
from thalweg.render.records.props import PROP_COLUMNS
from thalweg.world.generate import memory

OVERHEAD_BYTES = 640
"""Bytes of an environment's actions, seed and look, of the results of a step, of what the ideal eye sees, and of what
the renderer holds of a view."""

FELT_BYTES = 2 * 4 * 8 + 2 * 9 * 4
"""Bytes of what is remembered of an environment's last step, and of its proprioception."""
LAYER_BYTES = 4 + 1
"""Bytes of a pixel's depth and class."""


def bytes_per_env(courses: CourseArrays, config: EnvConfig, frames: int) -> int:
    """Return the bytes of one environment with a number of frames."""
    outcome = empty_outcome(1, len(config.cost_kinds))
    arrays = (*empty_state(np.zeros(1, np.int64), courses), *outcome, *empty_forces(1))
    felt = FELT_BYTES if "proprioception" in config.parts else 0
    props = 4 * PROP_COLUMNS * config.task_record.props
    pixel = config.channels + (LAYER_BYTES if config.draws_layers else 0)
    frame = pixel * config.camera.height_px * config.camera.width_px
    return sum(array.nbytes for array in arrays) + OVERHEAD_BYTES + felt + props + frames * frame


def free_bytes(device: Any) -> int | None:
    """Return the free memory of a torch device, or None if the system does not report it."""
    return memory.free_bytes() if device.type == "cpu" else gpu.free_bytes(device)


def check_memory(num_envs: int, each: int, shared: int, free: int | None) -> None:
    """Raise `ConfigError` unless `num_envs` environments of `each` bytes and `shared` bytes fit into the free bytes."""
    if free is None or num_envs * each + shared <= free:
        return
    fitting = max(0, (free - shared) // each)
    raise ConfigError(
        f"num_envs = {num_envs:,} takes {(num_envs * each + shared) / 1e9:.2f} GB of the device's memory, of which"
        f" {free / 1e9:.2f} GB are free: at most {fitting:,} fit, and the encoder and the learner need memory as well"
    )
