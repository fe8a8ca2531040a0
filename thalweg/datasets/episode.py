"""Record of a flight with what was seen and done in it, independent of file formats.

Letters: T steps, H, W pixels, P numbers of proprioception, K kinds of costs.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from thalweg.datasets.errors import DatasetError

Layer = Literal["mask", "depth", "class"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
"""What may be recorded beside the colours."""
ACTION_NAMES = ("up", "turn left", "forward", "left")
"""Meaning of +1 in each branch of a move; -1 is the opposite direction, and 0 no motion."""
POSE_NAMES = ("x", "y", "z", "yaw")
"""Numbers of a pose: three in metres, yaw in radians counter-clockwise from east."""
RUNNING = -1
"""Code of the reason for a flight that has not ended by the rules."""


@dataclass(frozen=True)
class About:
    """What all flights of a data set have in common, as plain data; it is stored in the data set's metadata."""

    fps: int
    """Steps a second."""
    camera: dict[str, Any]
    """Fields of a `thalweg.render.Camera`, and `intrinsics` [3][3] in OpenCV's convention."""
    proprioception: tuple[str, ...]
    """Names of the numbers of proprioception."""
    cost_kinds: tuple[str, ...]
    """Name of each kind of costs, in the order of `RecordedEpisode.costs`."""
    reasons: tuple[str, ...]
    """Name of each reason for the end of a flight, by its code from 0."""
    classes: tuple[str, ...]
    """Name of each number of the layer `class`."""
    versions: dict[str, int]
    """Versions of worlds, frames and rules, see `thalweg.core.versions`."""
    layers: tuple[Layer, ...] = LAYERS
    """What is recorded beside the colours."""

    @classmethod
    def from_plain(cls, told: Any, folder: Path) -> "About":
        """Return the record of the metadata `told` of the data set in `folder`; raises `DatasetError` if it is none."""
        tuples = ("proprioception", "cost_kinds", "reasons", "classes", "layers")
        try:
            texts: dict[str, Any] = {name: tuple(told[name]) for name in tuples}
            return cls(int(told["fps"]), dict(told["camera"]), versions=dict(told["versions"]), **texts)
        except (KeyError, TypeError, ValueError) as error:
            raise DatasetError(f"{folder} does not say how it was recorded: {error!r}") from error


@dataclass(frozen=True)
class RecordedEpisode:
    """A flight of T steps. Observations are T + 1: before each step, and after the last one."""

    rgb: np.ndarray
    """[T + 1, H, W, 3] uint8."""
    mask: np.ndarray | None
    """[T + 1, H, W] uint8, 255 where water is seen."""
    depth_m: np.ndarray | None
    """[T + 1, H, W] float32, metres along the optical axis; -1 for the sky."""
    class_id: np.ndarray | None
    """[T + 1, H, W] uint8, see `About.classes`."""
    proprioception: np.ndarray
    """[T + 1, P] float32."""
    poses: np.ndarray
    """[T + 1, 4] float64: x, y, z in metres, yaw in radians."""
    times_s: np.ndarray
    """[T + 1] float64, clock of the water."""
    moves: np.ndarray
    """[T, 4] float32 in -1..1, see `ACTION_NAMES`."""
    options: np.ndarray | None
    """[T, 4] int64, options of a discrete action as the environment took them; None for continuous actions."""
    rewards: np.ndarray
    """[T] float64."""
    costs: np.ndarray
    """[T, K] float64, by `About.cost_kinds`."""
    terminated: bool
    """Whether the flight ended by the rules; a flight that was stopped, or cut off by a deadline, did not."""
    reason: int = RUNNING
    """Code of the reason for the end, see `About.reasons`; `RUNNING` for a flight that was stopped before its end."""
    pilots: tuple[str, ...] = ()
    """[T] name of who flew each step."""
    task: str = "River"
    options_of_flight: dict[str, Any] = field(default_factory=dict)
    """Options of the flight as plain data: river, seeds, task, vehicle, look and wind."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.rewards)

    @property
    def size_px(self) -> tuple[int, int]:
        """H and W."""
        return self.rgb.shape[1], self.rgb.shape[2]

    def reasons(self) -> np.ndarray:
        """Return the code of the reason after each step, int64 [T]: `RUNNING` for all steps but the last."""
        codes = np.full(self.steps, RUNNING, np.int64)
        codes[-1] = self.reason
        return codes

    def layer(self, name: Layer) -> np.ndarray | None:
        """Return a layer [T + 1, H, W], see the fields; None if it was not recorded."""
        return {"mask": self.mask, "depth": self.depth_m, "class": self.class_id}[name]


SENTENCES = {
    "River": "Follow the river to its end without touching anything.",
    "Swimmers": "Follow the river fast, and slowly past swimmers and kayaks.",
    "Nests": "Look for nests along the river, and fly high over reserves.",
    "RacingLine": "Follow the river fast, and keep clear of banks and stones.",
    "Portage": "Fly to the gauge station; land costs.",
}
"""What each task asks for, in words, which data sets keep for policies that take language."""


def sentence_of(task: str) -> str:
    """Return what a task asks for, in words; for the task of a plug-in a sentence with its name."""
    return SENTENCES.get(task, f"Fly the task {task}.")
