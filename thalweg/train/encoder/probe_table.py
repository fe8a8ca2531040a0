"""Table of R² of linear probes, by encoder and kind of views: written, read, and as plain data."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from thalweg.encoder.files import EncoderFileError
from thalweg.train.encoder.views import TARGETS


def probe_table(scores: dict[tuple[str, str], np.ndarray], targets: Sequence[str] = TARGETS) -> str:
    """Return R² of probes as CSV: a row per encoder and kind of views."""
    lines = [",".join(("encoder", "views", *(name.replace(" ", "_") for name in targets)))]
    for (name, kind), found in scores.items():
        lines.append(",".join((name, kind, *("" if np.isnan(value) else f"{value:.4f}" for value in found))))
    return "\n".join(lines) + "\n"


def read_probe(path: Path, targets: Sequence[str] = TARGETS) -> dict[tuple[str, str], np.ndarray]:
    """Return the R² [T] of probes by encoder and kind of views from the table that `probe_table` made.

    Raises `EncoderFileError`, which names the file, for another table.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        names = [name.replace(" ", "_") for name in targets]
        return {(row["encoder"], row["views"]): np.array([float(row[name] or "nan") for name in names]) for row in rows}
    except (KeyError, TypeError, ValueError) as error:
        raise EncoderFileError(f"{path}: not the table of a training of geometry ({error!r})") from error


def probe_data(scores: dict[tuple[str, str], np.ndarray], targets: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """Return R² of the geometry encoder as plain data, by kind of views and quantity."""
    return {
        kind: {
            key: None if np.isnan(value) else round(float(value), 4) for key, value in zip(targets, found, strict=True)
        }
        for (name, kind), found in scores.items()
        if name == "geometry"
    }
