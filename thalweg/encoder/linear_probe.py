"""Linear probe of codes: ridge regressions of what a pilot needs, evaluated on other images.

A policy's first layer is linear too: it can use directly what a linear regression predicts from a code.
"""

import numpy as np

from thalweg.encoder.vae import EncoderInputError

RIDGES = np.logspace(-4, 2, 13)
"""Penalties on squared weights beside the mean squared error, of standardised numbers, among which one is chosen for
each truth: without any, codes of 1,024 numbers fit what is noise in 2,000 images."""
SET_ASIDE = 4
"""The penalty is chosen on one in so many of the images that are fitted to."""


def explained(codes: np.ndarray, truths: np.ndarray, other_codes: np.ndarray, other_truths: np.ndarray) -> np.ndarray:
    """R² [T] on other images of the ridge regression of each truth on the codes; NaN for one that never varies.

    The penalty is that of `RIDGES` which does best on every fourth image that is fitted to, when the fit is to the
    rest.

    Args:
        codes: [K, Z] of the images that are fitted to.
        truths: [K, T] what is to be read from them; images with a NaN are left out for that truth.
        other_codes: [L, Z] of the images that are judged by.
        other_truths: [L, T].

    Raises `EncoderInputError` unless there is a truth for each code, and as many numbers in both sets.
    """
    of_each = len(codes) == len(truths) and len(other_codes) == len(other_truths)
    if not of_each or codes.shape[1] != other_codes.shape[1] or truths.shape[1] != other_truths.shape[1]:
        raise EncoderInputError(
            f"codes {list(codes.shape)} with truths {list(truths.shape)}, and codes {list(other_codes.shape)} with"
            f" truths {list(other_truths.shape)}: each code needs its truths, and both sets the same numbers"
        )
    found = []
    for truth, other in zip(truths.T, other_truths.T, strict=True):
        known, judged = np.isfinite(truth), np.isfinite(other)
        found.append(_explained(codes[known], truth[known], other_codes[judged], other[judged]))
    return np.array(found)


def _explained(codes: np.ndarray, truth: np.ndarray, others: np.ndarray, other: np.ndarray) -> float:
    if len(truth) < 2 * SET_ASIDE or len(other) < 2 or np.ptp(truth) == 0 or np.ptp(other) == 0:
        return float("nan")
    aside = np.arange(len(truth)) % SET_ASIDE == 0
    tried = [_errors(codes[~aside], truth[~aside], codes[aside], truth[aside], ridge) for ridge in RIDGES]
    best = RIDGES[int(np.argmin(np.square(tried).mean(1)))]
    return float(1.0 - np.square(_errors(codes, truth, others, other, best)).mean() / np.var(other))


def _errors(codes: np.ndarray, truth: np.ndarray, others: np.ndarray, other: np.ndarray, ridge: float) -> np.ndarray:
    """[L] of the truths `other` [L] read from `others` [L, Z] by the fit to the first two."""
    mean, deviation = codes.mean(0, dtype=np.float64), codes.std(0, dtype=np.float64)
    scale = 1.0 / np.where(deviation > 0, deviation, 1.0)
    seen, centre = (codes - mean) * scale, truth.mean()
    normal = seen.T @ seen / len(seen) + ridge * np.eye(seen.shape[1])
    weights = np.linalg.solve(normal, seen.T @ (truth - centre) / len(seen))
    return other - centre - (others - mean) * scale @ weights
