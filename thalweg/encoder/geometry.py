"""Encoder of geometry: the convolutions of the autoencoder's encoder, trained to predict named quantities of a view.

A code is linear in a hidden layer behind the convolutions, and the predictions are linear in the code, so that a
policy's first layer can read off what was predicted. Each number of a code has mean 0 and variance 1 on the frames of
the training. What the quantities are is data: this module knows their names alone. Dimension letters: N frames, Z
latent, T quantities.
"""

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
import torch
from pydantic import Field, PositiveInt, model_validator
from torch import Tensor, nn

from thalweg.core.compute.torch_layers import uninitialised
from thalweg.core.config import FiniteNonNegative, FinitePositive, TupleOf, frozen_config
from thalweg.encoder.frame_size import FrameSize
from thalweg.encoder.vae import (
    ARCHITECTURES,
    CHANNELS,
    LEAK,
    CodeSize,
    EncoderInputError,
    check_architecture,
    encoder_layers,
    features_of,
)


@frozen_config(EncoderInputError)
class GeometryConfig:
    """Inputs, code size, quantities and training settings of an encoder of geometry."""

    targets: TupleOf[str]
    """Names of the T quantities that are predicted."""
    weights: TupleOf[FiniteNonNegative] = ()
    """Weight of each quantity in the loss; empty: all weigh the same."""
    inputs: str = "rgb+mask"
    """Channels that are encoded: "rgb", "mask" or "rgb+mask"."""
    latent: CodeSize = 32
    """Z, the number of dimensions of a code."""
    architecture: str = "lean"
    """Whose convolutions: "lean" (fast on a CPU) or "paper" (those of the paper)."""
    size_px: FrameSize = 128
    """Height and width of a frame: a number for a square, or both."""
    hidden: Annotated[int, Field(ge=1, le=65536)] = 256
    """Size of the layer between the convolutions and the code."""
    huber: FinitePositive = 1.0
    """Error in standard deviations above which the loss of a quantity grows linearly (Huber 1964)."""
    learning_rate: FinitePositive = 2e-3
    """Step size of Adam; it falls along a half cosine to `least_rate` of it."""
    least_rate: FinitePositive = 0.01
    """Learning rate of the last epoch, as a share of that of the first."""
    batch: PositiveInt = Field(default=64, ge=3)
    """Frames of a gradient step."""

    @model_validator(mode="after")
    def _names_are_known_and_fit(self) -> Self:
        check_architecture(self.inputs, self.architecture)
        if not self.targets or len(set(self.targets)) < len(self.targets):
            raise ValueError(f"targets must be at least one, each once, got {', '.join(self.targets) or 'none'}")
        if self.weights and len(self.weights) != len(self.targets):
            raise ValueError(f"weights must be as many as targets, {len(self.targets)}, got {len(self.weights)}")
        if self.weights and not any(self.weights):
            raise ValueError("weights must not all be 0")
        return self

    @property
    def channels(self) -> tuple[int, ...]:
        """The channels of a frame [H, W, 4] that are encoded."""
        return CHANNELS[self.inputs]


@dataclass(frozen=True)
class Scale:
    """Mean and standard deviation of each quantity, by which predictions are standardised."""

    mean: np.ndarray
    """[T] float64."""
    deviation: np.ndarray
    """[T] float64, above 0."""

    @classmethod
    def of(cls, values: np.ndarray) -> "Scale":
        """Return the scale of quantities [K, T], NaN where one is not defined; 1 where one does not vary.

        Raises `EncoderInputError` for a quantity that is defined nowhere.
        """
        known = np.isfinite(values)
        if not known.any(axis=0).all():
            missing = np.flatnonzero(~known.any(axis=0)).tolist()
            raise EncoderInputError(f"the quantities {missing} are defined for none of {len(values)} views")
        masked = np.where(known, values, np.nan).astype(np.float64)
        deviation = np.nanstd(masked, axis=0)
        return cls(np.nanmean(masked, axis=0), np.where(deviation > 0, deviation, 1.0))


class GeometryNetwork(nn.Module):
    """`encode` to codes, `forward` to predictions in standard deviations, `predict` to predictions in units."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, config: GeometryConfig, scale: Scale | None = None):
        super().__init__()
        self.config = config
        shape, count = ARCHITECTURES[config.architecture], len(config.targets)
        self.encoder = encoder_layers(len(config.channels), shape)
        self.hidden = nn.Linear(features_of(config.size_px, shape), config.hidden)
        # No bias: the norm that follows would remove it.
        self.code = nn.Linear(config.hidden, config.latent, bias=False)
        self.norm = nn.BatchNorm1d(config.latent, affine=False)
        self.read = nn.Linear(config.latent, count)
        scale = scale or Scale(np.zeros(count), np.ones(count))
        self.register_buffer("mean", torch.tensor(scale.mean, dtype=torch.float32))
        self.register_buffer("deviation", torch.tensor(scale.deviation, dtype=torch.float32))
        self.to(torch.float32, memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]

    def encode(self, images: Tensor) -> Tensor:
        """Return codes float32 [N, Z] of images [N, C, H, W] in 0..1."""
        features = self.encoder(images).flatten(1)
        return self.norm(self.code(nn.functional.leaky_relu(self.hidden(features), LEAK)).float())

    def forward(self, images: Tensor) -> Tensor:
        """Return predictions [N, T] in standard deviations from images [N, C, H, W] in 0..1."""
        return self.read(self.encode(images))

    def predict(self, codes: Tensor) -> Tensor:
        """Return predictions float32 [N, T] in the units of the quantities from codes [N, Z]."""
        return self.read(codes) * self.deviation + self.mean

    @torch.no_grad()
    def dense_layers(self) -> nn.Sequential:
        """Return copies of the layers behind the convolutions, with the norm of the code folded into the last."""
        assert self.norm.running_mean is not None and self.norm.running_var is not None
        hidden = uninitialised(nn.Linear, self.hidden.in_features, self.hidden.out_features)
        hidden.load_state_dict(self.hidden.state_dict())
        code = uninitialised(nn.Linear, self.code.in_features, self.code.out_features)
        scale = 1.0 / torch.sqrt(self.norm.running_var.double() + self.norm.eps)
        code.weight.copy_(self.code.weight.double() * scale[:, None])
        code.bias.copy_(-self.norm.running_mean.double() * scale)
        return nn.Sequential(hidden, nn.LeakyReLU(LEAK), code).requires_grad_(False)


def geometry_loss(predicted: Tensor, truths: Tensor, weights: Tensor, huber: float) -> Tensor:
    """Return the mean over quantities that are defined of the weighted Huber loss (Huber 1964), a scalar.

    Args:
        predicted: [N, T] in standard deviations.
        truths: [N, T] in standard deviations; NaN where a quantity is not defined.
        weights: [T].
        huber: Error in standard deviations above which the loss grows linearly.
    """
    known = truths.isfinite()
    losses = nn.functional.huber_loss(predicted, torch.where(known, truths, predicted.detach()), "none", delta=huber)
    each = weights * known
    return (each * losses).sum() / each.sum().clamp(min=1e-12)
