"""Variational autoencoder of frames, in the paper's architecture or a lean one.

The model knows nothing of rivers, files or training loops. Dimension letters: N frames, C channels (3 of colour, 1 of
the water mask, or 4 of both), H x W pixels, Z latent. Images are in 0..1.

Sources: Kingma and Welling 2014 (the bound, and the KL of two Gaussians in its appendix B); the layers, the weight of
the KL and the sizes of `paper` as in Wang and Mahmoudian 2024.
"""

from dataclasses import dataclass
from typing import Annotated, Self

import torch
from pydantic import Field, model_validator
from torch import nn

from thalweg.core.compute.torch_layers import uninitialised
from thalweg.core.config import FiniteNonNegative, FinitePositive, frozen_config
from thalweg.encoder.frame_size import FrameSize, halved, sides

CHANNELS = {"rgb": (0, 1, 2), "mask": (3,), "rgb+mask": (0, 1, 2, 3)}
"""Which channels of a frame [H, W, 4] each kind of input takes."""


@dataclass(frozen=True)
class Architecture:
    """The layers of one kind of encoder and decoder, as data."""

    encoder: tuple[int, ...]
    """Channels after each convolution of 3x3 and stride 2."""
    decoder: tuple[int, ...]
    """Channels at the decoder's start, and after each of its steps that doubles the size."""
    shuffled: bool
    """True: a step is a convolution and a pixel shuffle; False: a transposed convolution of stride 2."""
    last: int
    """Factor by which the last step enlarges, to the image's channels."""

    @property
    def growth(self) -> int:
        """Pixels of the frame to one pixel of the decoder's smallest map."""
        return 2 ** (len(self.decoder) - 1) * self.last


ARCHITECTURES = {
    "lean": Architecture(encoder=(16, 32, 64, 128, 128, 128), decoder=(128, 128, 64, 32, 16), shuffled=True, last=2),
    "paper": Architecture(
        encoder=(32, 64, 128, 256, 512, 1024), decoder=(1024, 512, 256, 128, 64, 32), shuffled=False, last=2
    ),
}
CodeSize = Annotated[int, Field(ge=1, le=4096)]
"""Number of dimensions of a code; the largest that was tried is 1024."""
LEAK = 0.01
"""Slope of the leaky ReLU below zero: the usual value; the source names none."""


class EncoderInputError(ValueError):
    """Error for invalid frames, codes or settings of an encoder; the message names the values."""


@frozen_config(EncoderInputError)
class VAEConfig:
    """Inputs, code size, architecture and training settings of the autoencoder."""

    inputs: str = "rgb+mask"
    """Channels that are encoded: "rgb", "mask" or "rgb+mask"."""
    latent: CodeSize = 16
    """Z, the number of dimensions of a code."""
    architecture: str = "lean"
    """"lean" (fast on a CPU) or "paper" (the layers of the paper)."""
    size_px: FrameSize = 128
    """Height and width of a frame: a number for a square, or both."""
    kl_weight: FiniteNonNegative = 0.00025
    """Weight of the KL divergence relative to the mean squared error."""
    learning_rate: FinitePositive = 1e-3
    """Step size of Adam."""

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        check_architecture(self.inputs, self.architecture)
        return self

    @property
    def channels(self) -> tuple[int, ...]:
        """The channels of a frame [H, W, 4] that are encoded."""
        return CHANNELS[self.inputs]


def check_architecture(inputs: str, architecture: str) -> None:
    """Raise `ValueError` for unknown inputs or architectures."""
    if inputs not in CHANNELS:
        raise ValueError(f"unknown inputs {inputs!r}; known: {', '.join(CHANNELS)}")
    if architecture not in ARCHITECTURES:
        raise ValueError(f"unknown architecture {architecture!r}; known: {', '.join(ARCHITECTURES)}")


class VAE(nn.Module):
    """Variational autoencoder: `encode` to mean and log variance, `decode` to an image, or `forward` with noise."""

    def __init__(self, config: VAEConfig):
        super().__init__()
        self.config = config
        shape = ARCHITECTURES[config.architecture]
        features = features_of(config.size_px, shape)
        self.encoder = encoder_layers(len(config.channels), shape)
        self.mean = nn.Linear(features, config.latent)
        self.log_variance = nn.Linear(features, config.latent)
        start = tuple(-(-side // shape.growth) for side in sides(config.size_px))
        self.expand = nn.Linear(config.latent, shape.decoder[0] * start[0] * start[1])
        self.unflatten = nn.Unflatten(1, (shape.decoder[0], *start))
        self.decoder = _decoder_layers(len(config.channels), shape)
        self.to(torch.float32, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]

    def encode(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the mean and log variance, float32 [N, Z] each, of the code of images [N, C, H, W] in 0..1."""
        features = self.encoder(images).flatten(1)
        return self.mean(features).float(), self.log_variance(features).float()

    def decode(self, codes: torch.Tensor) -> torch.Tensor:
        """Return the images [N, C, H, W] float32 in 0..1 from codes [N, Z]."""
        start = self.unflatten(self.expand(codes)).contiguous(memory_format=torch.channels_last)
        images, (height, width) = self.decoder(start), sides(self.config.size_px)
        if images.shape[2:] != (height, width):  # the decoder's sizes are multiples of its growth
            images = images[:, :, :height, :width]
        return torch.sigmoid(images.float())

    def forward(self, images: torch.Tensor, noise: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return reconstruction, mean and log variance from images [N, C, H, W] and standard normal noise [N, Z]."""
        mean, log_variance = self.encode(images)
        return self.decode(mean + noise * torch.exp(0.5 * log_variance)), mean, log_variance

    def dense_layers(self) -> nn.Linear:
        """Return a copy of the layer behind the convolutions that gives the mean of a code."""
        head = uninitialised(nn.Linear, self.mean.in_features, self.mean.out_features).requires_grad_(False)
        head.load_state_dict(self.mean.state_dict())
        return head


def kl_divergence(mean: torch.Tensor, log_variance: torch.Tensor) -> torch.Tensor:
    """Return KL(N(mean, variance) || N(0, 1)) in nats, summed over the code and averaged over the batch.

    −½ Σ_z (1 + log σ² − μ² − σ²), Kingma and Welling 2014, appendix B.
    """
    return -0.5 * (1 + log_variance - mean.square() - log_variance.exp()).sum(1).mean()


def vae_loss(
    images: torch.Tensor, reconstruction: torch.Tensor, mean: torch.Tensor, log_variance: torch.Tensor, weight: float
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the loss, mean squared error and KL (scalars): MSE over [N, C, H, W] + weight × KL over codes [N, Z]."""
    error = nn.functional.mse_loss(reconstruction, images)
    divergence = kl_divergence(mean, log_variance)
    return error + weight * divergence, error, divergence


def features_of(size: int | tuple[int, int], shape: Architecture) -> int:
    """Return how many numbers the convolutions of an encoder make of a frame of a size."""
    height, width = halved(size, len(shape.encoder))
    return shape.encoder[-1] * height * width


def encoder_layers(channels: int, shape: Architecture) -> nn.Sequential:
    """Return the convolutions of an encoder, each with its batch norm and activation."""
    layers: list[nn.Module] = []
    for width in shape.encoder:
        # No bias: the batch norm that follows would remove it.
        layers += [nn.Conv2d(channels, width, 3, 2, 1, bias=False), nn.BatchNorm2d(width), nn.LeakyReLU(LEAK, True)]
        channels = width
    return nn.Sequential(*layers)


def _decoder_layers(channels: int, shape: Architecture) -> nn.Sequential:
    layers: list[nn.Module] = []
    for narrow, width in zip(shape.decoder[:-1], shape.decoder[1:], strict=True):
        layers += [*_enlarge(narrow, width, 2, shape.shuffled, False), nn.BatchNorm2d(width), nn.LeakyReLU(LEAK, True)]
    return nn.Sequential(*layers, *_enlarge(shape.decoder[-1], channels, shape.last, shape.shuffled, True))


def _enlarge(before: int, after: int, factor: int, shuffled: bool, bias: bool) -> list[nn.Module]:
    if shuffled:
        return [nn.Conv2d(before, after * factor**2, 3, padding=1, bias=bias), nn.PixelShuffle(factor)]
    return [nn.ConvTranspose2d(before, after, 3, factor, 1, output_padding=factor - 1, bias=bias)]
