"""Statistics of features in LeRobot's format: of each episode, and of all episodes together."""

from typing import Any

import numpy as np

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
MOST_PICTURES = 100
"""Greatest number of pictures of an episode, evenly spaced, from which its statistics are computed."""
Statistics = dict[str, np.ndarray]
"""Minimum, maximum, mean, standard deviation, count and quantiles of a feature, by their names in LeRobot."""


def of_numbers(values: np.ndarray) -> Statistics:
    """Return the statistics of a feature, each [F], from its values [T] or [T, F]."""
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    return _statistics(rows, len(rows))


def of_pictures(pictures: np.ndarray) -> Statistics:
    """Return the statistics of each channel [C, 1, 1] in 0..1 of pictures [T, H, W, C] uint8; `count` is the number of
    pictures that were used."""
    chosen = pictures[np.unique(np.linspace(0, len(pictures) - 1, MOST_PICTURES).astype(int))]
    found = _statistics(chosen.reshape(-1, chosen.shape[-1]) / 255.0, len(chosen))
    return {name: value if name == "count" else value.reshape(-1, 1, 1) for name, value in found.items()}


def together(parts: list[Statistics]) -> Statistics:
    """Return the statistics of several episodes together.

    Quantiles are means of those of the episodes, weighted by count, as LeRobot combines them.
    """
    count = np.sum([part["count"] for part in parts], axis=0)
    share = np.array([part["count"][0] for part in parts]) / count[0]
    means = np.stack([part["mean"] for part in parts])
    mean = np.tensordot(share, means, 1)
    spread = np.stack([part["std"] for part in parts]) ** 2 + (means - mean) ** 2
    quantiles = {name: np.tensordot(share, np.stack([part[name] for part in parts]), 1) for name in _names()}
    return {
        "min": np.min([part["min"] for part in parts], axis=0),
        "max": np.max([part["max"] for part in parts], axis=0),
        "mean": mean,
        "std": np.sqrt(np.tensordot(share, spread, 1)),
        "count": count,
        **quantiles,
    }


def plain(statistics: dict[str, Statistics]) -> dict[str, Any]:
    """Return the statistics of all features as plain data."""
    return {key: {name: value.tolist() for name, value in found.items()} for key, found in statistics.items()}


def _names() -> list[str]:
    return [f"q{round(100 * share):02d}" for share in QUANTILES]


def _statistics(rows: np.ndarray, count: int) -> Statistics:
    """Return the statistics [F] of rows [N, F]."""
    return {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        "count": np.array([count]),
        **dict(zip(_names(), np.quantile(rows, QUANTILES, axis=0), strict=True)),
    }
