"""U-Net that finds water in colours, and its file.

The network is a U-Net [Ronneberger et al. 2015, https://arxiv.org/abs/1505.04597] on blocks of 2 x 2 pixels. Water
mirrors sky and trees, so that a pixel can be classified only from a large area around it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.encoder.files import FORMAT, EncoderFileError, read_tensors, write_tensors
from thalweg.encoder.reconstruction import CHUNK
from thalweg.encoder.vae import EncoderInputError

BLOCK = 2
"""Side in pixels of the blocks that are the network's first layer."""
WIDTHS = (24, 48, 64, 96)
"""Channels of each level, from blocks of 2 x 2 pixels to those of 16 x 16."""
SIDES = BLOCK * 2 ** (len(WIDTHS) - 1)
"""The sides of an image must be multiples of this number of pixels; `water_in` pads others."""
KIND = "finder of water"
PACKAGED_WATER = Path(__file__).with_name("water.safetensors")
"""File of the network that comes with the package; it was trained on frames under all looks."""


class WaterSegmenter(nn.Module):
    """U-Net from colours to a logit of water for each pixel; an image's sides are multiples of `SIDES`."""

    def __init__(self) -> None:
        super().__init__()
        pairs = list(zip((3 * BLOCK**2, *WIDTHS), WIDTHS, strict=False))
        self.down = nn.ModuleList([_block(before, after) for before, after in pairs])
        self.up = nn.ModuleList([_block(near + far, near) for near, far in pairs[:0:-1]])
        self.last = nn.Conv2d(WIDTHS[0], BLOCK**2, 1)
        self.float()

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


def save_segmenter(path: Path, segmenter: WaterSegmenter, about: dict[str, Any] | None = None) -> None:
    """Write a segmenter to a file, atomically; with `about`, the record of its training, in half precision."""
    tensors = segmenter.state_dict()
    if about is not None:
        tensors = {name: value.half() if value.is_floating_point() else value for name, value in tensors.items()}
    write_tensors(path, tensors, {**(about or {}), "kind": KIND, "format": FORMAT})


def load_segmenter(path: Path = PACKAGED_WATER) -> WaterSegmenter:
    """Return the segmenter of a file; raises `EncoderFileError` for any other file."""
    with torch.random.fork_rng(devices=[]):  # its initial weights, of no use, are not drawn from the caller's numbers
        segmenter = WaterSegmenter()
    try:
        tensors = read_tensors(path, KIND)[0]
        segmenter.load_state_dict(
            {name: value.float() if value.is_floating_point() else value for name, value in tensors.items()}
        )
    except RuntimeError as error:
        raise EncoderFileError(f"{path}: another network's tensors ({error})") from error
    return segmenter.eval()


@torch.inference_mode()
def water_in(segmenter: WaterSegmenter, colours: np.ndarray) -> np.ndarray:
    """Return the water mask bool [K, H, W] of colours [K, H, W, 3], uint8 or 0..1.

    Sides that are no multiples of `SIDES` are continued below and on the right by the values of the edge for the
    network; its mask there is cut off. Raises `EncoderInputError` for colours of another shape; none [0, H, W, 3] have
    an empty mask.
    """
    if colours.ndim != 4 or colours.shape[3] < 3 or 0 in colours.shape[1:3]:
        raise EncoderInputError(f"colours must be [K, H, W, 3], not {list(colours.shape)}")
    height, width = colours.shape[1:3]
    beyond = (0, -height % SIDES), (0, -width % SIDES)
    colours = np.pad(colours, ((0, 0), *beyond, (0, 0)), mode="edge")
    water = np.empty(colours.shape[:3], bool)
    for start in range(0, len(colours), CHUNK):
        water[start : start + CHUNK] = (segmenter(colours_of(colours[start : start + CHUNK])) > 0).numpy()
    return water[:, :height, :width]


def mean_iou(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean over images of the IoU of two masks, bool [K, H, W]; without water in either it is 1.

    Raises `EncoderInputError` for masks of other shapes or types.
    """
    if found.shape != truth.shape or found.ndim != 3 or found.dtype != bool or truth.dtype != bool:
        kinds = " and ".join(f"{mask.dtype} {list(mask.shape)}" for mask in (found, truth))
        raise EncoderInputError(f"masks must be bool [K, H, W], both, not {kinds}")
    both, either = (found & truth).sum((1, 2)), (found | truth).sum((1, 2))
    return float(np.where(either > 0, both / np.maximum(either, 1), 1.0).mean())


def colours_of(images: np.ndarray) -> Tensor:
    """Return colours float32 [N, 3, H, W] in 0..1 of images [N, H, W, 3 or more], uint8 or 0..1."""
    colours = torch.from_numpy(np.ascontiguousarray(images[..., :3])).permute(0, 3, 1, 2)
    return colours.float() / 255 if colours.dtype == torch.uint8 else colours.float()
