"""Statistics of features in LeRobot's format: of each episode, and of all episodes together.

Those of pictures are counted value by value as the pictures come, so that no picture is kept.
"""

from typing import Any

import numpy as np

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)
VALUES = np.arange(256) / 255.0
"""What the values of a byte are in statistics of pictures."""
Statistics = dict[str, np.ndarray]
"""Minimum, maximum, mean, standard deviation, count and quantiles of a feature, by their names in LeRobot."""


def of_numbers(values: np.ndarray) -> Statistics:
    """Return the statistics of a feature, each [F], from its values [T] or [T, F]."""
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    return {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": rows.mean(axis=0),
        "std": rows.std(axis=0),
        "count": np.array([len(rows)]),
        **dict(zip(_names(), np.quantile(rows, QUANTILES, axis=0), strict=True)),
    }


class PictureCounts:
    """How often each value of a byte occurs in each channel of pictures."""

    def __init__(self, channels: int) -> None:
        self._counts = np.zeros((channels, 256), np.int64)
        self.pictures = 0
        """Number of pictures."""

    def add(self, pictures: np.ndarray) -> None:
        """Count pictures [T, H, W, C] uint8."""
        for channel, counts in enumerate(self._counts):
            counts += np.bincount(pictures[..., channel].ravel(), minlength=256)
        self.pictures += len(pictures)

    def statistics(self) -> Statistics:
        """Return the statistics [C, 1, 1] of all pixels of each channel, in 0..1; `count` is the number of pictures."""
        share = self._counts / self._counts.sum(axis=1, keepdims=True)
        mean = share @ VALUES
        found = {
            "min": VALUES[np.argmax(self._counts > 0, axis=1)],
            "max": VALUES[255 - np.argmax(self._counts[:, ::-1] > 0, axis=1)],
            "mean": mean,
            "std": np.sqrt((share * (VALUES - mean[:, None]) ** 2).sum(axis=1)),
            **{name: self._quantile(of) for name, of in zip(_names(), QUANTILES, strict=True)},
        }
        return {"count": np.array([self.pictures])} | {name: value.reshape(-1, 1, 1) for name, value in found.items()}

    def _quantile(self, share: float) -> np.ndarray:
        """Return the quantile [C] of each channel, between the values of neighbouring ranks as `np.quantile`."""
        ends = self._counts.cumsum(axis=1)
        rank = share * (ends[0, -1] - 1)
        below, above = (np.argmax(ends > whole, axis=1) for whole in (np.floor(rank), np.ceil(rank)))
        return VALUES[below] + (rank % 1.0) * (VALUES[above] - VALUES[below])


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


def from_plain(data: dict[str, Any]) -> dict[str, Statistics]:
    """Return what `plain` was given."""
    return {key: {name: np.array(value) for name, value in found.items()} for key, found in data.items()}


def _names() -> list[str]:
    return [f"q{round(100 * share):02d}" for share in QUANTILES]
