"""The layout of Minari's data sets: names of files and groups, and the spaces of observations and actions.

Minari's own images are JPEG of up to three channels, so that they are not used: each layer is a separate array, which
HDF5 compresses without loss and every reader of HDF5 decompresses.
"""

import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from thalweg.datasets.episode import LAYERS, About
from thalweg.datasets.errors import DatasetError

DATA, FILE, META = "data", "main_data.hdf5", "metadata.json"
KEY = "thalweg"
"""Key of the metadata, of the data set and of each episode, under which Thalweg keeps what Minari has no place for."""
NAME = re.compile(r"[-\w]+")
"""Names of data sets that Minari takes."""


def check_name(path: Path) -> None:
    """Raise `DatasetError` for a folder whose name Minari does not take as that of a data set."""
    if not NAME.fullmatch(path.name):
        raise DatasetError(
            f"Minari takes the folder's name as that of the data set: letters, digits, - and _, not {path.name!r}"
        )


def group_of(number: int) -> str:
    """Return the name of the group of an episode."""
    return f"episode_{number}"


def spaces_of(size_px: tuple[int, int], about: About, *, discrete: bool) -> tuple[gymnasium.Space, gymnasium.Space]:
    """Return the spaces of the observations and actions of flights with images of H x W pixels."""
    parts: dict[str, gymnasium.Space] = {"rgb": gymnasium.spaces.Box(0, 255, (*size_px, 3), np.uint8)}
    bounds = {"mask": (0, 255), "depth": (-1.0, np.inf), "class": (0, len(about.classes) - 1)}
    for name in (name for name in LAYERS if name in about.layers):
        kind: Any = np.float32 if name == "depth" else np.uint8
        low, high = bounds[name]
        parts[name] = gymnasium.spaces.Box(low, high, size_px, kind)
    parts["proprioception"] = gymnasium.spaces.Box(-np.inf, np.inf, (len(about.proprioception),), np.float32)
    acted = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
    return gymnasium.spaces.Dict(parts), gymnasium.spaces.MultiDiscrete([3] * 4) if discrete else acted
