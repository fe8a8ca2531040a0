"""Is the river still in the picture? The overlap of the water in a reconstruction with that in the frame.

IoU is the number of pixels that are water in both by the number that are in either, of each image by itself, and then
the mean over images; an image without water in either counts 1. Where a reconstruction has a mask, its water is where
the mask is at least a half. Where it has colours, a small network that was trained to find water in the colours of
frames looks for it there: so encoders that see no mask can be judged too.
"""

import math

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.encoder.measure import CHUNK
from thalweg.encoder.vae import EncoderInputError

WIDTH, DILATIONS = 16, (1, 2, 4, 8)
"""Channels of the finder's layers, and how far apart the pixels are that each layer's 3 x 3 weights look at: a pixel
is judged by those within 15 of it."""
EPOCHS, BATCH, RATE = 4, 32, 3e-3


def mean_iou(found: np.ndarray, truth: np.ndarray) -> float:
    """Mean over images of the IoU of two masks, bool [K, H, W]; raises `EncoderInputError` for anything else."""
    if found.shape != truth.shape or found.ndim != 3 or found.dtype != bool or truth.dtype != bool:
        kinds = " and ".join(f"{mask.dtype} {list(mask.shape)}" for mask in (found, truth))
        raise EncoderInputError(f"masks must be bool [K, H, W], both, not {kinds}")
    both, either = (found & truth).sum((1, 2)), (found | truth).sum((1, 2))
    return float(np.where(either > 0, both / np.maximum(either, 1), 1.0).mean())


class Finder(nn.Module):
    """Where is water? A logit for each pixel, from colours alone."""

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 3
        for dilation in DILATIONS:
            layers += [nn.Conv2d(channels, WIDTH, 3, padding=dilation, dilation=dilation), nn.ReLU()]
            channels = WIDTH
        self.layers = nn.Sequential(*layers, nn.Conv2d(channels, 1, 1))

    def forward(self, colours: Tensor) -> Tensor:
        """Logits [N, H, W] of colours [N, 3, H, W] in 0..1."""
        return self.layers(colours - 0.5).squeeze(1)


def train_finder(images: np.ndarray, seed: int = 0, epochs: int = EPOCHS) -> Finder:
    """A finder for images uint8 [K, H, W, 4], whose fourth channel is the truth."""
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        finder = Finder()
    optimiser = torch.optim.Adam(finder.parameters(), RATE)
    for _ in range(epochs):
        order = torch.randperm(len(images), generator=generator).numpy()
        for chosen in np.array_split(order, math.ceil(len(order) / BATCH)):
            part = images[chosen]
            truth = torch.from_numpy(part[..., 3] > 0).float()
            loss = nn.functional.binary_cross_entropy_with_logits(finder(colours_of(part)), truth)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
    return finder.eval()


@torch.inference_mode()
def water_in(finder: Finder, colours: np.ndarray) -> np.ndarray:
    """Water bool [K, H, W] in colours [K, H, W, 3], uint8 or 0..1."""
    parts = [
        (finder(colours_of(colours[start : start + CHUNK])) > 0).numpy() for start in range(0, len(colours), CHUNK)
    ]
    return np.concatenate(parts)


def colours_of(images: np.ndarray) -> Tensor:
    """[N, 3, H, W] in 0..1 of images [N, H, W, 3 or more], uint8 or 0..1."""
    colours = torch.from_numpy(np.ascontiguousarray(images[..., :3])).permute(0, 3, 1, 2)
    return colours.float() / 255 if colours.dtype == torch.uint8 else colours.float()
