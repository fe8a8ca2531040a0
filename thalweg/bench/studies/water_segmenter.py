"""Training of the network that finds water in the colours of reconstructions, for the encoder study.

The study compares the water in a reconstruction with that in the frame by IoU (`thalweg.encoder.water.mean_iou`). Where
a reconstruction has a mask, its water is where the mask is at least a half. Where it has colours, this network finds
the water in them, so that encoders that see no mask can be compared too.
"""

import math

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch import nn

from thalweg.encoder import EncoderInputError
from thalweg.encoder.training import resolve_precision
from thalweg.encoder.water import SIDES, WaterSegmenter, colours_of

EPOCHS, BATCH, RATE = 16, 32, 3e-3
"""Epochs, batch size and maximum learning rate of training (AdamW, one cycle)."""


def train_segmenter(
    images: np.ndarray, seed: int = 0, epochs: int = EPOCHS, *, precision: str = "float32", progress: bool = False
) -> WaterSegmenter:
    """Train a segmenter on images uint8 [K, H, W, 4], whose fourth channel is the truth.

    Batches are mirrored at random.

    `precision` is "float32" or "bfloat16", that of the convolutions in training, or "auto"; the result is in float32.

    Raises `EncoderInputError` for another precision, and for images of another kind or with other sides.
    """
    height, width = images.shape[1:3] if images.ndim == 4 and images.shape[3] == 4 else (0, 0)
    if images.dtype != np.uint8 or not height or height % SIDES or width % SIDES:
        raise EncoderInputError(
            f"images must be uint8 [K, H, W, 4], H and W multiples of {SIDES}, not {images.dtype} {list(images.shape)}"
        )
    half = resolve_precision(precision) == "bfloat16"
    generator = np.random.default_rng([seed, 2])  # 0 and 1 are those of `thalweg.encoder.training`
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        segmenter = WaterSegmenter()
    batches = math.ceil(len(images) / BATCH)
    optimiser = torch.optim.AdamW(segmenter.parameters(), RATE)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=epochs * batches)
    for _ in track(range(epochs), "training the water segmenter", disable=not progress, console=Console(stderr=True)):
        for chosen in np.array_split(generator.permutation(len(images)), batches):
            part = images[chosen, :, :: generator.choice([1, -1])]
            truth = torch.from_numpy(part[..., 3] > 0).float()
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                logits = segmenter(colours_of(part))
            loss = nn.functional.binary_cross_entropy_with_logits(logits.float(), truth)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            rate.step()
    return segmenter.eval()
