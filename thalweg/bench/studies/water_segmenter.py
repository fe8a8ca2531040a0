"""U-Net that segments water in frames, and the IoU of the water in a reconstruction with that in the frame.

IoU is the number of pixels that are water in both by the number that are in either, of each image by itself, and then
the mean over images; an image without water in either counts 1. Where a reconstruction has a mask, its water is where
the mask is at least a half. Where it has colours, a network that was trained to find water in the colours of frames
looks for it there: so encoders that see no mask can be judged too.

The network is a U-Net [Ronneberger et al. 2015, https://arxiv.org/abs/1505.04597] on blocks of 2 x 2 pixels: water
mirrors sky and trees, so what a pixel is can only be told from far around it.
"""

import math
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from thalweg.encoder import EncoderFileError, EncoderInputError
from thalweg.encoder.files import FORMAT, read_tensors, write_tensors
from thalweg.encoder.reconstruction import CHUNK
from thalweg.encoder.training import resolve_precision

BLOCK = 2
"""Side in pixels of the blocks that are the network's first layer."""
WIDTHS = (24, 48, 64, 96)
"""Channels, from blocks of 2 x 2 pixels to those of 16 x 16."""
SIDES = BLOCK * 2 ** (len(WIDTHS) - 1)
"""The sides of an image must be multiples of this number of pixels."""
EPOCHS, BATCH, RATE = 16, 32, 3e-3
"""Epochs, batch size and maximum learning rate of training (AdamW, one cycle)."""
KIND = "finder of water"


def mean_iou(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean over images of the IoU of two masks, bool [K, H, W]; raises `EncoderInputError` for others."""
    if found.shape != truth.shape or found.ndim != 3 or found.dtype != bool or truth.dtype != bool:
        kinds = " and ".join(f"{mask.dtype} {list(mask.shape)}" for mask in (found, truth))
        raise EncoderInputError(f"masks must be bool [K, H, W], both, not {kinds}")
    both, either = (found & truth).sum((1, 2)), (found | truth).sum((1, 2))
    return float(np.where(either > 0, both / np.maximum(either, 1), 1.0).mean())


class WaterSegmenter(nn.Module):
    """U-Net from colours to a logit of water for each pixel; an image's sides are multiples of `SIDES`."""

    def __init__(self) -> None:
        super().__init__()
        pairs = list(zip((3 * BLOCK**2, *WIDTHS), WIDTHS, strict=False))
        self.down = nn.ModuleList([_block(before, after) for before, after in pairs])
        self.up = nn.ModuleList([_block(near + far, near) for near, far in pairs[:0:-1]])
        self.last = nn.Conv2d(WIDTHS[0], BLOCK**2, 1)

    def forward(self, colours: Tensor) -> Tensor:
        """Return logits [N, H, W] of colours [N, 3, H, W] in 0..1."""
        here = nn.functional.pixel_unshuffle(colours - 0.5, BLOCK)
        skips: list[Tensor] = []
        for block in self.down:
            here = block(nn.functional.max_pool2d(here, 2) if skips else here)
            skips.append(here)
        for block, near in zip(self.up, skips[-2::-1], strict=True):
            here = block(torch.cat([nn.functional.interpolate(here, scale_factor=2), near], 1))
        return nn.functional.pixel_shuffle(self.last(here), BLOCK).squeeze(1)


def _block(before: int, after: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for channels in (before, after):
        layers += [nn.Conv2d(channels, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers)


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
                logits = segmenter(_colours_of(part))
            loss = nn.functional.binary_cross_entropy_with_logits(logits.float(), truth)
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            rate.step()
    return segmenter.eval()


def save_segmenter(path: Path, segmenter: WaterSegmenter) -> None:
    """Write a segmenter to a file, atomically."""
    write_tensors(path, segmenter.state_dict(), {"kind": KIND, "format": FORMAT})


def load_segmenter(path: Path) -> WaterSegmenter:
    """Return the segmenter of a file; raises `EncoderFileError` for any other file."""
    segmenter = WaterSegmenter()
    try:
        segmenter.load_state_dict(read_tensors(path, KIND)[0])
    except RuntimeError as error:
        raise EncoderFileError(f"{path}: another network's tensors ({error})") from error
    return segmenter.eval()


@torch.inference_mode()
def water_in(segmenter: WaterSegmenter, colours: np.ndarray) -> np.ndarray:
    """Return the water mask bool [K, H, W] of colours [K, H, W, 3], uint8 or 0..1."""
    predictions = [
        (segmenter(_colours_of(colours[start : start + CHUNK])) > 0).numpy() for start in range(0, len(colours), CHUNK)
    ]
    return np.concatenate(predictions)


def _colours_of(images: np.ndarray) -> Tensor:
    """Return [N, 3, H, W] in 0..1 of images [N, H, W, 3 or more], uint8 or 0..1."""
    colours = torch.from_numpy(np.ascontiguousarray(images[..., :3])).permute(0, 3, 1, 2)
    return colours.float() / 255 if colours.dtype == torch.uint8 else colours.float()
