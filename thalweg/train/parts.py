"""Parts of observations: the image that an encoder sees, and the numbers that a policy sees beside its code.

An observation is one image or one vector, or a dictionary: its `rgb` and `mask` are the channels of one image, and all
other parts are vectors of numbers.
"""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from torch import Tensor

from thalweg.train.errors import TrainingError

IMAGE_PARTS = ("rgb", "mask")
"""Parts that are channels of the image, in order."""


class ObservationParts:
    """The image and the numbers of the observations of a space, for arrays and for tensors."""

    def __init__(self, space: gym.Space) -> None:
        """Raises `TrainingError` for a space of anything but images uint8 and vectors."""
        parts = space.spaces if isinstance(space, gym.spaces.Dict) else {"": space}
        found = {name: _shape(part) for name, part in parts.items()}
        images = [name for name in found if len(found[name]) == 3]
        self._named = isinstance(space, gym.spaces.Dict)
        self._images = [name for name in IMAGE_PARTS if name in images] if self._named else images
        # Numbers of an ideal eye come first, as they do where they are all there is.
        self._numbers = sorted((name for name in found if len(found[name]) == 1), key=lambda name: name != "privileged")
        strange = sorted(set(found) - {*self._images, *self._numbers})
        if strange:
            raise TrainingError(
                f"a policy sees an image (rgb, mask) and vectors of numbers; the observations also have"
                f" {', '.join(strange)}: leave that out of {space}"
            )
        self.image_shape: tuple[int, ...] | None = None
        """H, W, C of the image; None without one."""
        if self._images:
            first = found[self._images[0]]
            self.image_shape = (*first[:2], sum(found[name][2] for name in self._images))
        self.size = sum(found[name][0] for name in self._numbers)
        """Number of numbers."""

    def image(self, obs: Any) -> Any:
        """Return the image [..., H, W, C] of observations."""
        return obs if not self._named else joined([obs[name] for name in self._images])

    def numbers(self, obs: Any) -> Any:
        """Return the numbers [..., `size`] of observations that have some."""
        return obs if not self._named else joined([obs[name] for name in self._numbers])


def joined(arrays: list[Any]) -> Any:
    """Return arrays or tensors [..., K] side by side."""
    if len(arrays) == 1:
        return arrays[0]
    return torch.cat(arrays, -1) if isinstance(arrays[0], Tensor) else np.concatenate(arrays, -1)


def vector_space(size: int) -> gym.spaces.Box:
    """Return a space of vectors of so many numbers."""
    return gym.spaces.Box(-np.inf, np.inf, (int(size),), np.float32)


def _shape(space: gym.Space) -> tuple[int, ...]:
    """Return the shape of an image or a vector; empty for anything else."""
    if not isinstance(space, gym.spaces.Box):
        return ()
    return space.shape if len(space.shape) == 1 or (len(space.shape) == 3 and space.dtype == np.uint8) else ()
