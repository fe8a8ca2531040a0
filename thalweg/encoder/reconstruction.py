"""Reconstructions of an autoencoder, their errors, and a figure of them beside the originals.

Reconstructions are computed in float32 and evaluation mode: from the mean code without noise, with the running
statistics of batch norms. Values are in 0..1.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

from thalweg.core.atomic_io import write_picture
from thalweg.encoder.encoder import Encoder
from thalweg.encoder.frame_size import sides
from thalweg.encoder.geometry import GeometryConfig
from thalweg.encoder.vae import VAE, EncoderInputError, VAEConfig

CHUNK = 64
"""Images per batch."""
FIGURE_GAP_PX = 4
FIGURE_LABEL_PX = 16


def check_images(images: np.ndarray, config: VAEConfig | GeometryConfig, held_out: int = 0) -> None:
    """Raise `EncoderInputError` unless images are uint8 [K, H, W, 4] of the config's size and 2 remain to train on."""
    shape, kind = np.shape(images), getattr(images, "dtype", None)
    height, width = sides(config.size_px)
    if len(shape) != 4 or shape[1:] != (height, width, 4) or kind != np.uint8:
        raise EncoderInputError(f"images must be uint8 [K, {height}, {width}, 4], not {kind} {list(shape)}")
    if held_out < 0 or shape[0] - held_out < 2:
        raise EncoderInputError(f"of {shape[0]} images, {held_out} can't be held out: at least 2 must be left")


def to_batch(
    images: np.ndarray, config: VAEConfig | GeometryConfig, device: torch.device | str = "cpu"
) -> torch.Tensor:
    """Return the config's channels of images uint8 [N, H, W, 4] as float32 [N, C, H, W] in 0..1, channels last."""
    first, last = config.channels[0], config.channels[-1] + 1
    pixels = torch.from_numpy(np.ascontiguousarray(images[..., first:last])).to(device)
    return pixels.to(torch.float32).div_(255).permute(0, 3, 1, 2)


def reconstruct(vae: VAE, images: np.ndarray) -> np.ndarray:
    """Return the reconstructions float32 [K, H, W, C] in 0..1 of images uint8 [K, H, W, 4]."""
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
    """Return the mean squared error over the pixels and the model's channels of images uint8 [K, H, W, 4], in 0..1."""
    total = 0.0
    for start in range(0, len(images), CHUNK):
        part = images[start : start + CHUNK]
        truth = part[..., list(vae.config.channels)] / np.float32(255)
        total += float(np.square(reconstruct(vae, part) - truth).mean(dtype=np.float64)) * len(part)
    return total / len(images)


def mean_image_mse(images: np.ndarray, config: VAEConfig) -> float:
    """Return the mean squared error of the mean image as a prediction of images uint8 [K, H, W, 4]."""
    count = len(images)
    total, squares = 0.0, 0.0
    for part in np.array_split(images, max(1, count // CHUNK)):
        values = part[..., list(config.channels)] / np.float64(255)
        total, squares = total + values.sum(0), squares + np.square(values).sum(0)
    return float((squares / count - np.square(total / count)).mean())


def draw_reconstructions(images: np.ndarray, encoders: Encoder | Mapping[str, Encoder], path: str | Path) -> None:
    """Write a PNG with a column per image uint8 [K, H, W, 4]: original, mask, then the reconstructions of each encoder.

    `encoders` is one encoder, or several by the labels of their rows. Raises `EncoderInputError` without images.
    """
    if not len(images):
        raise EncoderInputError("a figure needs at least one image")
    named = encoders if isinstance(encoders, Mapping) else {encoders.inputs: encoders}
    rows = {"original": images[..., :3], "water mask": _grey(images[..., 3:])}
    for name, encoder in named.items():
        decoded = encoder.decode(encoder(images))
        if decoded.shape[-1] >= 3:
            rows[f"{name}: reconstruction"] = decoded[..., :3]
        if decoded.shape[-1] != 3:
            rows[f"{name}: reconstructed mask"] = _grey(decoded[..., -1:])
    height, width = images.shape[1:3]
    figure = Image.new(
        "RGB",
        (len(images) * (width + FIGURE_GAP_PX) + FIGURE_GAP_PX, len(rows) * (height + FIGURE_LABEL_PX + FIGURE_GAP_PX)),
        "white",
    )
    pen = ImageDraw.Draw(figure)
    for row, (title, pictures) in enumerate(rows.items()):
        top = row * (height + FIGURE_LABEL_PX + FIGURE_GAP_PX)
        pen.text((FIGURE_GAP_PX, top + 2), title, fill="black")
        for column, picture in enumerate(pictures):
            figure.paste(
                Image.fromarray(np.ascontiguousarray(picture)),
                (FIGURE_GAP_PX + column * (width + FIGURE_GAP_PX), top + FIGURE_LABEL_PX),
            )
    write_picture(path, figure)


def _grey(mask: np.ndarray) -> np.ndarray:
    return np.repeat(mask, 3, axis=-1)
