"""Reconstructions of an autoencoder and their errors, computed in float32 in evaluation mode.

Evaluation mode: the mean code without noise, batch norms with their running statistics. Values are in 0..1.
"""

import numpy as np
import torch

from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig

CHUNK = 64
"""Images worked on at a time."""


def check_images(images: np.ndarray, config: VAEConfig, held_out: int = 0) -> None:
    """Raises `EncoderInputError` unless images are uint8 [K, H, W, 4] of the right size and 2 are left to train on."""
    shape, kind = np.shape(images), getattr(images, "dtype", None)
    if len(shape) != 4 or shape[1:] != (config.size_px, config.size_px, 4) or kind != np.uint8:
        raise EncoderInputError(
            f"images must be uint8 [K, {config.size_px}, {config.size_px}, 4], not {kind} {list(shape)}"
        )
    if held_out < 0 or shape[0] - held_out < 2:
        raise EncoderInputError(f"of {shape[0]} images, {held_out} can't be held out: at least 2 must be left")


def to_batch(images: np.ndarray, config: VAEConfig, device: torch.device | str = "cpu") -> torch.Tensor:
    """Float32 [N, C, H, W] in 0..1, channels last in memory, from images uint8 [N, H, W, 4]: the config's channels."""
    first, last = config.channels[0], config.channels[-1] + 1
    pixels = torch.from_numpy(np.ascontiguousarray(images[..., first:last])).to(device)
    return pixels.to(torch.float32).div_(255).permute(0, 3, 1, 2)


def reconstruct(vae: VAE, images: np.ndarray) -> np.ndarray:
    """Reconstructions float32 [K, H, W, C] in 0..1 of images uint8 [K, H, W, 4]."""
    training, device = vae.training, next(vae.parameters()).device
    vae.eval()
    parts = []
    with torch.inference_mode():
        for start in range(0, len(images), CHUNK):
            mean, _ = vae.encode(to_batch(images[start : start + CHUNK], vae.config, device))
            parts.append(vae.decode(mean).permute(0, 2, 3, 1).cpu().numpy())
    vae.train(training)
    return np.concatenate(parts)


def reconstruction_mse(vae: VAE, images: np.ndarray) -> float:
    """Mean squared error over all pixels and the model's channels of images uint8 [K, H, W, 4], as values in 0..1."""
    total = 0.0
    for start in range(0, len(images), CHUNK):
        part = images[start : start + CHUNK]
        truth = part[..., list(vae.config.channels)] / np.float32(255)
        total += float(np.square(reconstruct(vae, part) - truth).mean(dtype=np.float64)) * len(part)
    return total / len(images)


def mean_image_mse(images: np.ndarray, config: VAEConfig) -> float:
    """Mean squared error of answering with the mean of images uint8 [K, H, W, 4]: the variance of a pixel, averaged."""
    count = len(images)
    total, squares = 0.0, 0.0
    for part in np.array_split(images, max(1, count // CHUNK)):
        values = part[..., list(config.channels)] / np.float64(255)
        total, squares = total + values.sum(0), squares + np.square(values).sum(0)
    return float((squares / count - np.square(total / count)).mean())
