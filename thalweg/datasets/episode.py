"""Record of a flight with what was seen and done in it, independent of file formats.

Letters: T steps, H, W pixels, P numbers of proprioception, K kinds of costs.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from thalweg.datasets.errors import DatasetError

Layer = Literal["mask", "depth", "class"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
"""What may be recorded beside the colours."""
FIELD_OF_LAYER: dict[Layer, str] = {"mask": "mask", "depth": "depth_m", "class": "class_id"}
"""Fields of `RecordedEpisode` that hold the layers."""
ACTION_NAMES = ("up", "turn left", "forward", "left")
"""Meaning of +1 in each branch of a move, a plain step in that direction; -1 is one in the opposite direction, 0 no
motion. A fast step forward is as many plain ones as it is long, 2."""
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
            found = cls(int(told["fps"]), dict(told["camera"]), versions=dict(told["versions"]), **texts)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise DatasetError(f"{folder} does not say how it was recorded: {error!r}") from error
        if wrong := found._error():
            raise DatasetError(f"{folder} does not say how it was recorded: {wrong}")
        return found

    def _error(self) -> str:
        """Return what is wrong with the description; empty for nothing."""
        if self.fps < 1:
            return f"fps is {self.fps}, but must be at least 1"
        for name in ("proprioception", "cost_kinds", "reasons", "classes", "layers"):
            for text in getattr(self, name):
                if not isinstance(text, str) or text != text.encode("utf-8", "replace").decode():
                    return f"{name} must be names, got {text!r:.40}"
        if unknown := [name for name in self.layers if name not in LAYERS]:
            return f"layers must be among {', '.join(LAYERS)}, got {unknown[0]!r:.40}"
        if not is_plain((self.camera, self.versions)):
            return "camera and versions must be plain data with finite numbers"
        return ""


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
    """[T, 4] float32 in plain steps, see `ACTION_NAMES`: -1..1, and forward up to 2 in tasks with a fast step."""
    options: np.ndarray | None
    """[T, 4] int64, options of a discrete action as the environment took them; None for continuous actions."""
    rewards: np.ndarray
    """[T] float64."""
    costs: np.ndarray
    """[T, K] float64, by `About.cost_kinds`."""
    terminated: bool
    """Whether the flight ended by the rules; one that was stopped, or cut off by the paper's step limit, did not."""
    pilots: tuple[str, ...]
    """[T] name of who flew each step."""
    reason: int = RUNNING
    """Code of the reason for the end, see `About.reasons`; `RUNNING` for a flight that was stopped before its end."""
    task: str = "River"
    options_of_flight: dict[str, Any] = field(default_factory=dict)
    """Options of the flight as plain data: river, seeds, task, vehicle, look and wind, and the optics of its frames."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.rewards)

    @property
    def size_px(self) -> tuple[int, int]:
        """H and W."""
        return self.rgb.shape[1], self.rgb.shape[2]

    def layer(self, name: Layer) -> np.ndarray | None:
        """Return a layer [T + 1, H, W], see the fields; None if it was not recorded."""
        return getattr(self, FIELD_OF_LAYER[name])


def is_plain(value: Any) -> bool:
    """Return whether a value is plain data whose numbers are finite and whose texts can be written."""
    if isinstance(value, Mapping):
        return all(isinstance(key, str) and is_plain(key) and is_plain(each) for key, each in value.items())
    if isinstance(value, list | tuple):
        return all(map(is_plain, value))
    if isinstance(value, str):
        return value == value.encode("utf-8", "replace").decode()
    return value is None or isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))


def check_episode(episode: RecordedEpisode, about: About, where: Path) -> None:
    """Raise `DatasetError` for a flight that was read from `where` and whose arrays don't fit together, or hold numbers
    that are not finite."""
    if wrong := episode_error(episode, about):
        raise DatasetError(f"{where} holds a flight that is damaged: {wrong}")


def episode_error(episode: RecordedEpisode, about: About) -> str:
    """Return what keeps a flight from being one of a data set: arrays that don't fit together, numbers that are not
    finite, or no plain data; empty for nothing."""
    return _array_error(episode, about) or _plain_error(episode, about)


def _array_error(episode: RecordedEpisode, about: About) -> str:
    """Return which array of a flight has another shape than the others call for, or wrong numbers; empty for none."""
    if (steps := len(episode.rewards)) < 1:
        return "it has no step"
    seen = (steps + 1, *episode.rgb.shape[1:3])
    shapes: dict[str, tuple[int, ...]] = {
        "rgb": (*seen, 3),
        "mask": seen,
        "depth_m": seen,
        "class_id": seen,
        "proprioception": (steps + 1, len(about.proprioception)),
        "poses": (steps + 1, len(POSE_NAMES)),
        "times_s": (steps + 1,),
        "moves": (steps, len(ACTION_NAMES)),
        "options": (steps, len(ACTION_NAMES)),
        "rewards": (steps,),
        "costs": (steps, len(about.cost_kinds)),
    }
    for name, shape in shapes.items():
        values = getattr(episode, name)
        if values is None:
            if missing := [layer for layer in about.layers if FIELD_OF_LAYER[layer] == name]:
                return f"the layer {missing[0]} is missing, which every flight of the data set has"
            continue
        if values.shape != shape:
            return f"{name} has the shape {values.shape}, not {shape}"
        if name in ("rgb", "mask", "class_id") and values.dtype != np.uint8:
            return f"{name} are numbers of {values.dtype}, not of uint8"
        if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
            return f"{name} holds what is no finite number"
    return ""


def _plain_error(episode: RecordedEpisode, about: About) -> str:
    """Return what is wrong with the plain data of a flight; empty for nothing."""
    if not RUNNING <= episode.reason < len(about.reasons):
        return f"the reason for its end is {episode.reason}; there are {RUNNING} to {len(about.reasons) - 1}"
    if len(episode.pilots) != episode.steps or not all(isinstance(name, str) for name in episode.pilots):
        return "pilots must be a name for each step"
    if not isinstance(episode.terminated, bool):
        return f"terminated must be true or false, got {episode.terminated!r:.40}"
    if not isinstance(episode.task, str) or not isinstance(episode.options_of_flight, dict):
        return "task must be a name, and options a mapping"
    return "" if is_plain((episode.task, episode.options_of_flight)) else "its options must be plain and finite"


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
