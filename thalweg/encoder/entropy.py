"""Relative entropy between the codes of two encoders, by which the paper compares its inputs.

Each number of a code is scaled linearly from its range to (-2, 2), and counted in ⌈√K⌉ equal bins for K images. The
paper does not say how it treats empty bins, which make the sum infinite; here `smoothing` is added to the share of
every bin.
"""

import math

import numpy as np
from scipy.stats import entropy

from thalweg.encoder.vae import EncoderInputError

REACH = 2.0
"""Codes are scaled to -REACH..REACH."""
SMOOTHING = 1e-6
"""Added to each bin's share of the images."""


def histograms(codes: np.ndarray) -> np.ndarray:
    """Return the share [Z, bins] of images in each bin, from codes [K, Z]; constant numbers are in the middle bin.

    Raises `EncoderInputError` for codes of another shape, or that are not finite.
    """
    if codes.ndim != 2 or len(codes) < 2:
        raise EncoderInputError(f"codes must be [K, Z] of at least 2 images, not {list(codes.shape)}")
    if wrong := int((~np.isfinite(codes)).sum()):
        raise EncoderInputError(f"{wrong} of the {codes.size} numbers of the codes are not finite")
    codes = codes.astype(np.float64)
    low, high = codes.min(0), codes.max(0)
    width = np.where(high > low, high - low, 1.0)
    share = np.where(high > low, (codes - low) / width, 0.5)
    bins = math.ceil(math.sqrt(len(codes)))
    edges = np.linspace(-REACH, REACH, bins + 1)
    stretched = (2.0 * share - 1.0) * REACH
    return np.stack([np.histogram(column, edges)[0] for column in stretched.T]) / len(codes)


def relative_entropy(first: np.ndarray, second: np.ndarray, smoothing: float = SMOOTHING) -> float:
    """Return D(P ‖ Q) in nats, mean over the numbers of the codes, of codes P [K, Z] and Q [K, Z] of the same images.

    Raises `EncoderInputError` for codes of different shapes or that are not finite, and for a smoothing that is not
    positive.
    """
    if first.shape != second.shape:
        raise EncoderInputError(
            f"codes of the same images are needed, not {list(first.shape)} and {list(second.shape)}"
        )
    if not smoothing > 0:
        raise EncoderInputError(f"smoothing must be above 0, not {smoothing}: an empty bin has no logarithm")
    return float(entropy(histograms(first) + smoothing, histograms(second) + smoothing, axis=1).mean())
