"""What can be read from a code by a straight line? Linear regressions of what a pilot needs, judged on other images.

A policy's first layer is linear too: what a line can read from a code, it can use at once.
"""

import numpy as np

from thalweg.encoder.vae import EncoderInputError

RIDGE = 1e-3
"""Penalty on squared weights beside the mean squared error, of standardised numbers: codes of 1,024 numbers would
otherwise fit what is noise in 2,000 images."""


def explained(
    codes: np.ndarray, truths: np.ndarray, other_codes: np.ndarray, other_truths: np.ndarray, ridge: float = RIDGE
) -> np.ndarray:
    """R² [T] on other images of the ridge regression of each truth on the codes; NaN for one that never varies.

    Args:
        codes: [K, Z] of the images that are fitted to.
        truths: [K, T] what is to be read from them; images with a NaN are left out for that truth.
        other_codes: [L, Z] of the images that are judged by.
        other_truths: [L, T].
        ridge: See `RIDGE`.
    """
    if codes.shape[1] != other_codes.shape[1] or truths.shape[1] != other_truths.shape[1]:
        raise EncoderInputError(
            f"codes {list(codes.shape)} and {list(other_codes.shape)}, truths {list(truths.shape)} and"
            f" {list(other_truths.shape)}: the numbers of both must be the same"
        )
    found = []
    for truth, other in zip(truths.T, other_truths.T, strict=True):
        known, judged = np.isfinite(truth), np.isfinite(other)
        found.append(_explained(codes[known], truth[known], other_codes[judged], other[judged], ridge))
    return np.array(found)


def _explained(codes: np.ndarray, truth: np.ndarray, others: np.ndarray, other: np.ndarray, ridge: float) -> float:
    if len(truth) < 2 or len(other) < 2 or np.ptp(truth) == 0 or np.ptp(other) == 0:
        return float("nan")
    mean, deviation = codes.mean(0, dtype=np.float64), codes.std(0, dtype=np.float64)
    scale = 1.0 / np.where(deviation > 0, deviation, 1.0)
    seen, centre = (codes - mean) * scale, truth.mean()
    normal = seen.T @ seen / len(seen) + ridge * np.eye(seen.shape[1])
    weights = np.linalg.solve(normal, seen.T @ (truth - centre) / len(seen))
    errors = other - centre - (others - mean) * scale @ weights
    return float(1.0 - np.mean(errors**2) / np.var(other))
