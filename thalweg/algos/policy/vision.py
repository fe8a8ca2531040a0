"""Eyes of a policy: convolutions that turn an image, and the action taken before it, into features.

A policy with eyes takes observations as rows of bytes: the pixels of the image in the order of `Eyes.image`, then one
byte for each branch of the last action, its option + 1, or 0 where there is none. Letters: B rows, A branches, F
features.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from thalweg.algos.common.errors import AlgorithmError
from thalweg.core.compute.torch_layers import uninitialised

FIRST_STRIDE, KERNEL = 4, 3
"""The first convolution sees patches of 4x4 pixels that do not overlap; the others see 3x3 and halve the image."""
BLOCK_IMAGES = 64
"""Images of a block in `Convolutions.in_blocks`: what the convolutions make of so many stays in the processor's cache,
which is up to twice as fast as a batch of 256."""
FEW_OPTIONS = 3
"""Options of a branch that are -1, 0 and 1 as numbers; those of more are scaled."""
NO_OPTION = -1
"""Stands for the last action at the beginning of an episode."""


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


class LastOptions(nn.Module):
    """Last actions, bytes [B, A] as in rows but of any type, to numbers float32 [B, A] in -1..1.

    Of up to three options they are -1, 0, 1, and 0 where there is none; of more, they begin above -1, which stands for
    none, and lie apart by equal steps.
    """

    factor: Tensor
    shift: Tensor
    none: Tensor

    def __init__(self, sizes: Sequence[int], device: torch.device) -> None:
        """`sizes` are the options of each branch."""
        super().__init__()
        self.scaled = max(sizes, default=0) > FEW_OPTIONS
        """Whether a branch has so many options that their numbers are scaled."""
        numbers = [(2.0 / size, -1.0, -1.0) if size > FEW_OPTIONS else (1.0, -2.0, 0.0) for size in sizes]
        parts = torch.tensor(numbers, dtype=torch.float32, device=device).T
        for name, part in zip(("factor", "shift", "none"), parts, strict=True):
            self.register_buffer(name, part, persistent=False)

    def unscale(self) -> None:
        """Take the numbers of any branch for what they are of three options: -1, 0, 1, 2 and so on."""
        self.scaled = False
        for part, value in ((self.factor, 1.0), (self.shift, -2.0), (self.none, 0.0)):
            part.fill_(value)

    def forward(self, last: Tensor) -> Tensor:
        last = last.float()
        return torch.where(last > 0, last * self.factor + self.shift, self.none)


class Convolutions(nn.Module):
    """Images and last actions, as rows uint8 [B, pixels + A], to features float32 [B, F + A]."""

    def __init__(self, eyes: Eyes, sizes: Sequence[int], generator: torch.Generator) -> None:
        """Initialise the weights as torch does its own layers, but from the generator alone, on its device; `sizes`
        [A] are the options of each branch."""
        super().__init__()
        self.eyes, self.branches = eyes, len(sizes)
        self.last_options = LastOptions(sizes, generator.device)
        height, width, before = eyes.image
        layers: list[nn.Module] = []
        for depth, after in enumerate(eyes.filters):
            shape = (FIRST_STRIDE, FIRST_STRIDE, 0) if depth == 0 else (KERNEL, 2, 1)
            layers += [uninitialised(nn.Conv2d, before, after, *shape, device=generator.device), nn.ReLU()]
            height, width = ((size + 2 * shape[2] - shape[0]) // shape[1] + 1 for size in (height, width))
            before = after
        self.convolutions = nn.Sequential(*layers).to(memory_format=torch.channels_last)  # pyright: ignore
        inputs = before * height * width
        self.linear = uninitialised(nn.Linear, inputs, eyes.features, device=generator.device)
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

    def in_blocks(self, rows: Tensor) -> Tensor:
        """Return what `forward` does, block by block; up to two blocks are taken as one, as imitations learn from."""
        if len(rows) <= 2 * BLOCK_IMAGES:
            return self(rows)
        return torch.cat([self(block) for block in rows.split(BLOCK_IMAGES)])

    def forward(self, rows: Tensor) -> Tensor:
        """Return features [B, F + A] of rows [B, pixels + A]."""
        pixels = self.eyes.pixels
        images = rows[:, :pixels].reshape(-1, *self.eyes.image).permute(0, 3, 1, 2)
        seen = self.convolutions(images.float().mul_(1.0 / 128.0).sub_(1.0))
        features = functional.relu(self.linear(seen.flatten(1)))
        return torch.cat([features, self.last_options(rows[:, pixels:])], -1)


def rows_of(images: np.ndarray, last_options: np.ndarray) -> np.ndarray:
    """Return rows uint8 [..., pixels + A] of images uint8 [..., H, W, C] and the options [..., A] that were taken
    before, -1 where there is none."""
    rows = np.empty((*last_options.shape[:-1], math.prod(images.shape[-3:]) + last_options.shape[-1]), np.uint8)
    write_rows(rows, images, last_options)
    return rows


def write_rows(rows: np.ndarray, images: np.ndarray, last_options: np.ndarray) -> None:
    """Write what `rows_of` returns into an array of its shape."""
    pixels = math.prod(images.shape[-3:])
    rows[..., :pixels] = images.reshape(*images.shape[:-3], pixels)
    rows[..., pixels:] = last_options + 1


MOST_OPTIONS = 255
"""Options that a branch may have: a row holds the number of one and 1, or 0 for none, as a byte."""


class ImageRows:
    """Makes rows of the images of N environments, and remembers the options that were taken in them last."""

    def __init__(self, num_envs: int, image: tuple[int, int, int], branches: int) -> None:
        """`image` is H, W, C of an image, `branches` is A."""
        self.image = image
        self.last = np.full((num_envs, branches), NO_OPTION)
        """[N, A] options that were taken last."""

    def note(self, options: np.ndarray) -> None:
        """Remember the options [N, A] that are taken now."""
        self.last = np.array(options, np.int64)

    def rows(self, images: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return rows uint8 [N, pixels + A] of images uint8 [N, H, W, C], of which `fresh` [N] begin an episode, before
        which nothing was taken."""
        self._check(images)
        return rows_of(images, np.where(fresh[:, None], NO_OPTION, self.last))

    def rows_at_end(self, images: np.ndarray, envs: np.ndarray) -> np.ndarray:
        """Return rows uint8 [F, pixels + A] of the last images uint8 [F, H, W, C] of the episodes of environments
        [F]."""
        self._check(images)
        return rows_of(images, self.last[envs])

    def _check(self, images: np.ndarray) -> None:
        """Raise `AlgorithmError` for images of another shape, or other numbers than bytes."""
        if images.shape[1:] != self.image or images.dtype != np.uint8:
            expected = f"images uint8 [N, {', '.join(map(str, self.image))}]"
            raise AlgorithmError(f"this policy takes {expected}, got {images.dtype} {list(images.shape)}")
