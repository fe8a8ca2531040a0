"""Linear probe of codes: ridge regressions of quantities that a pilot needs, evaluated on other images.

A policy's first layer is linear too, so it can directly use what a linear regression predicts from a code.
"""

import numpy as np

from thalweg.encoder.vae import EncoderInputError

RIDGES = np.logspace(-4, 2, 13)
"""Candidate penalties on squared weights of standardised codes; one is selected for each quantity. Without a penalty,
codes of 1,024 numbers would fit noise in 2,000 images."""
VALIDATION_STRIDE = 4
"""The penalty is selected on every fourth of the images that are fitted to."""


def probe_r_squared(
    codes: np.ndarray, truths: np.ndarray, other_codes: np.ndarray, other_truths: np.ndarray
) -> np.ndarray:
    """Return R² [T] on other images of a ridge regression of each quantity on the codes; NaN for a constant quantity.

    The penalty is the one of `RIDGES` with the least error on every fourth image, with a fit to the rest.

    Args:
        codes: [K, Z] codes of the images that are fitted to.
        truths: [K, T] quantities to predict; images with a NaN are left out for that quantity.
        other_codes: [L, Z] codes of the images to evaluate on.
        other_truths: [L, T] quantities of those images.

    Raises `EncoderInputError` unless codes and truths have the same length, and both sets the same sizes.
    """
    lengths_match = len(codes) == len(truths) and len(other_codes) == len(other_truths)
    if not lengths_match or codes.shape[1] != other_codes.shape[1] or truths.shape[1] != other_truths.shape[1]:
        raise EncoderInputError(
            f"codes {list(codes.shape)} with truths {list(truths.shape)}, and codes {list(other_codes.shape)} with"
            f" truths {list(other_truths.shape)}: each code needs its truths, and both sets the same numbers"
        )
    scores = []
    for truth, other_truth in zip(truths.T, other_truths.T, strict=True):
        finite, other_finite = np.isfinite(truth), np.isfinite(other_truth)
        scores.append(_r_squared(codes[finite], truth[finite], other_codes[other_finite], other_truth[other_finite]))
    return np.array(scores)


def _r_squared(codes: np.ndarray, truth: np.ndarray, other_codes: np.ndarray, other_truth: np.ndarray) -> float:
    if len(truth) < 2 * VALIDATION_STRIDE or len(other_truth) < 2 or np.ptp(truth) == 0 or np.ptp(other_truth) == 0:
        return float("nan")
    validation = np.arange(len(truth)) % VALIDATION_STRIDE == 0
    errors = [
        _errors(codes[~validation], truth[~validation], codes[validation], truth[validation], ridge) for ridge in RIDGES
    ]
    best = RIDGES[int(np.argmin(np.square(errors).mean(1)))]
    return float(1.0 - np.square(_errors(codes, truth, other_codes, other_truth, best)).mean() / np.var(other_truth))


def _errors(
    codes: np.ndarray, truth: np.ndarray, other_codes: np.ndarray, other_truth: np.ndarray, ridge: float
) -> np.ndarray:
    """Return the errors [L] of predicting `other_truth` [L] from `other_codes` [L, Z] by a fit of `truth` [K]."""
    mean, deviation = codes.mean(0, dtype=np.float64), codes.std(0, dtype=np.float64)
    scale = 1.0 / np.where(deviation > 0, deviation, 1.0)
    standardised, centre = (codes - mean) * scale, truth.mean()
    normal = standardised.T @ standardised / len(standardised) + ridge * np.eye(standardised.shape[1])
    weights = np.linalg.solve(normal, standardised.T @ (truth - centre) / len(standardised))
    return other_truth - centre - (other_codes - mean) * scale @ weights
