"""Observations that are images: their space, their rows of bytes with the last action, and the memory of a rollout."""

from typing import Any

import gymnasium as gym
import numpy as np

from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.vision import ImageRows
from thalweg.train.errors import TrainingError
from thalweg.world.generate.memory import free_bytes

COPIES = 3
"""Copies of a rollout's rows in an update: as it was collected, as samples in order, and shuffled."""


def image_of(space: gym.Space) -> tuple[int, int, int]:
    """Return H, W, C of the images of a single environment; raises `TrainingError` for any other observation."""
    if not isinstance(space, gym.spaces.Box) or len(space.shape) != 3 or space.dtype != np.uint8:
        raise TrainingError(f"policy=cnn takes images uint8 [H, W, C] as observations, not {space}")
    height, width, channels = space.shape
    return height, width, channels


class ImageStack:
    """Rows of the images of a vector environment, from its observations and the actions that it is given.

    It has no state to keep: the next step begins with a row that has the last options already.
    """

    def __init__(self, env: Any) -> None:
        """Raises `TrainingError` for an environment whose observations are not images."""
        self.image = image_of(env.single_observation_space)
        actions = actions_of(env.single_action_space)
        self._start = np.array(actions.start or (0,), np.int64)
        self._rows = ImageRows(env.num_envs, self.image, actions.count)
        self.size = int(np.prod(self.image)) + actions.count
        """D, bytes of a row."""

    def act(self, actions: np.ndarray) -> None:
        """Remember the environment's actions [N, ...]."""
        self._rows.note(np.asarray(actions).reshape(len(actions), -1).astype(np.int64) - self._start)

    def push(self, images: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return rows uint8 [N, D] of images [N, H, W, C], of which `fresh` [N] begin an episode."""
        return self._rows.rows(images, fresh)

    def last_of(self, images: np.ndarray, envs: np.ndarray) -> np.ndarray:
        """Return rows uint8 [F, D] of the last images [F, H, W, C] of the episodes of environments [F]."""
        return self._rows.rows_at_end(images, envs)


def check_rollout_memory(steps: int, num_envs: int, row_bytes: int) -> None:
    """Raise `TrainingError` if a rollout of T steps with rows of images does not fit the free memory."""
    needed, free = COPIES * (steps + 1) * num_envs * row_bytes, free_bytes()
    if free is not None and needed > free:
        raise TrainingError(
            f"rollouts of {steps * num_envs:,} steps with {row_bytes / 1e3:.0f} kB of image each take"
            f" {needed / 1e9:.2f} GB, and {free / 1e9:.2f} GB of memory are free: set steps_per_update to at most"
            f" {max(free // (COPIES * row_bytes) - num_envs, 0):,}"
        )
