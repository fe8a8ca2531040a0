"""Eyes of a policy: convolutions that turn an image, and the action taken before it, into features.

A policy with eyes takes observations as rows of bytes: the pixels of the image in the order of `Eyes.image`, then one
byte for each branch of the last action, its option + 1, or 0 where there is none. Letters: B rows, A branches, F
features.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

FIRST_STRIDE, KERNEL = 4, 3
"""The first convolution sees patches of 4x4 pixels that do not overlap; the others see 3x3 and halve the image."""


@dataclass(frozen=True)
class Eyes:
    """Shape of the convolutions."""

    image: tuple[int, int, int] = (128, 128, 4)
    """H, W, C of an image."""
    filters: tuple[int, ...] = (16, 32, 64, 64)
    """Filters of each convolution."""
    features: int = 256
    """F, numbers that the last, linear layer makes of an image."""

    @property
    def pixels(self) -> int:
        """Bytes of an image."""
        return math.prod(self.image)


class Convolutions(nn.Module):
    """Images and last actions, as rows uint8 [B, pixels + A], to features float32 [B, F + A]."""

    def __init__(self, eyes: Eyes, branches: int, generator: torch.Generator) -> None:
        """Initialise the weights as torch does its own layers, from the generator, on its device."""
        super().__init__()
        self.eyes, self.branches = eyes, branches
        height, width, before = eyes.image
        layers: list[nn.Module] = []
        for depth, after in enumerate(eyes.filters):
            shape = (FIRST_STRIDE, FIRST_STRIDE, 0) if depth == 0 else (KERNEL, 2, 1)
            layers += [nn.Conv2d(before, after, *shape, device=generator.device), nn.ReLU()]
            height, width = ((size + 2 * shape[2] - shape[0]) // shape[1] + 1 for size in (height, width))
            before = after
        self.convolutions = nn.Sequential(*layers).to(memory_format=torch.channels_last)  # pyright: ignore
        self.linear = nn.Linear(before * height * width, eyes.features, device=generator.device)
        with torch.no_grad():
            for layer in (*self.convolutions, self.linear):
                if isinstance(layer, nn.Conv2d | nn.Linear):
                    bound = 1.0 / math.sqrt(layer.weight[0].numel())
                    layer.weight.uniform_(-bound, bound, generator=generator)
                    assert layer.bias is not None
                    layer.bias.uniform_(-bound, bound, generator=generator)

    @property
    def outputs(self) -> int:
        """F + A."""
        return self.eyes.features + self.branches

    def forward(self, rows: Tensor) -> Tensor:
        """Return features [B, F + A] of rows [B, pixels + A]."""
        pixels = self.eyes.pixels
        images = rows[:, :pixels].reshape(-1, *self.eyes.image).permute(0, 3, 1, 2)
        seen = self.convolutions(images.float().mul_(1.0 / 128.0).sub_(1.0))
        features = functional.relu(self.linear(seen.flatten(1)))
        last = rows[:, pixels:].float()
        return torch.cat([features, torch.where(last > 0, last - 2.0, 0.0)], -1)


def rows_of(images: np.ndarray, last_options: np.ndarray) -> np.ndarray:
    """Return rows uint8 [N, pixels + A] of images uint8 [N, H, W, C] and the options [N, A] that were taken before,
    -1 where there is none."""
    flat = np.ascontiguousarray(images).reshape(len(images), -1)
    return np.concatenate([flat, (last_options + 1).astype(np.uint8)], axis=1)
