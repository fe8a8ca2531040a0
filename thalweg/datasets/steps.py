"""Flights as streams: what is seen at a moment, what is done in a step, and who takes them one after the other.

Letters: T steps, H, W pixels, P numbers of proprioception, K kinds of costs.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from thalweg.datasets.episode import LAYERS, About, RecordedEpisode
from thalweg.datasets.errors import DatasetError


@dataclass(frozen=True)
class Sight:
    """What is seen and measured before a step, or after the last one; types as in `RecordedEpisode`."""

    images: Mapping[str, np.ndarray]
    """Colours `rgb` [H, W, 3], and layers [H, W] by their names."""
    proprioception: np.ndarray
    """[P]."""
    pose: np.ndarray
    """[4]: x, y, z in metres, yaw in radians."""
    time_s: float
    """Clock of the water."""

    @property
    def size_px(self) -> tuple[int, int]:
        """H and W."""
        return self.images["rgb"].shape[0], self.images["rgb"].shape[1]


@dataclass(frozen=True)
class Step:
    """What is done in a step, and what it brings; types as in `RecordedEpisode`."""

    move: np.ndarray
    """[4] in plain steps, see `thalweg.datasets.episode.ACTION_NAMES`."""
    option: np.ndarray | None
    """[4], None for continuous actions."""
    reward: float
    costs: np.ndarray
    """[K]."""
    pilot: str


def check_layers(sight: Sight, about: About) -> None:
    """Raise `DatasetError` for a sight that lacks layers of the data set."""
    if lacking := [layer for layer in about.layers if layer not in sight.images]:
        raise DatasetError(f"what is seen lacks {' and '.join(lacking)}, which every flight of the data set has")


class FlightWriter(Protocol):
    """Takes a flight: `see` once, `step` T times, and `end`."""

    def see(self, sight: Sight) -> None:
        """Take what is seen at the start."""
        ...

    def step(self, step: Step, after: Sight) -> None:
        """Write a step, and what is seen after it.

        Raises `DatasetError` for a layer of the data set that was not seen, for the first step of a flight that has
        other actions, layers or frames of another size than those before it or makes no video, and `OSError` for a
        full disk.
        """
        ...

    def end(self, terminated: bool, reason: int) -> None:
        """Say how the flight ended, see `RecordedEpisode.terminated` and `reason`."""
        ...


class DataSetWriter(Protocol):
    """Writes flights one after the other in one format."""

    about: About
    """What all flights have in common."""

    @property
    def finished(self) -> int:
        """Number of flights that are written, those of an interrupted command included."""
        ...

    def flight(self, task: str, options: dict[str, Any]) -> AbstractContextManager[FlightWriter]:
        """Write the flight that is given in the block; it counts when the block ends without an error.

        `task` and `options` are those of `RecordedEpisode`.
        """
        ...

    def close(self) -> None:
        """Write what is about all flights."""
        ...


def write_flight(writer: FlightWriter, episode: RecordedEpisode) -> None:
    """Give a flight in memory to a writer; raises the errors of `FlightWriter.step`."""
    writer.see(_sight(episode, 0))
    for t in range(episode.steps):
        option = None if episode.options is None else episode.options[t]
        step = Step(episode.moves[t], option, float(episode.rewards[t]), episode.costs[t], episode.pilots[t])
        writer.step(step, _sight(episode, t + 1))
    writer.end(episode.terminated, episode.reason)


def _sight(episode: RecordedEpisode, t: int) -> Sight:
    """Return what was seen before step t."""
    layers = {name: episode.layer(name) for name in LAYERS}
    images = {"rgb": episode.rgb[t], **{name: layer[t] for name, layer in layers.items() if layer is not None}}
    return Sight(images, episode.proprioception[t], episode.poses[t], float(episode.times_s[t]))
