"""Recorded flights as one stream of steps for a student of images, and the checks that they fit.

Letters: S steps of all flights, L steps of a sequence, C sequences, H, W, K pixels and channels.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from thalweg.algos.imitation.config import CHANNELS, IMAGE_PX
from thalweg.algos.policy.vision import NO_OPTION
from thalweg.core import versions
from thalweg.core.seeds import refuse_unseen
from thalweg.datasets.episode import About, RecordedEpisode
from thalweg.datasets.recordings import read_recordings
from thalweg.env.moves import MOVES
from thalweg.env.spaces import FORWARD
from thalweg.env.task.bird_eye import COLUMNS, ROWS
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.tasks import task_named
from thalweg.render import Camera
from thalweg.train.errors import TrainingError
from thalweg.train.imitation.sequences import Sequences
from thalweg.train.imitation.teachers import choice_worths
from thalweg.world import LEVELS

NONE, BACKWARD = 1, 2
"""Options of the branch forward. Backward has no effect in the tasks that are accepted; it is learnt as none."""


class RecordedFlights:
    """The steps of recorded flights, all in memory: 65 kB for each, twice that while they are read."""

    def __init__(self, folders: Sequence[Path], observation: str) -> None:
        """Read the recordings in `folders`; `observation` is what the student sees: `rgb+mask`, `rgb` or `mask`.

        Raises `DatasetError` and `TrainingError`, which name the folder, for recordings that cannot be read, of other
        cameras, versions, vehicles and actions than students have, or without what the student sees.
        """
        images, options, first = [], [], []
        self.digest = hashlib.sha256()
        for folder in folders:
            about, flights = read_recordings(folder)
            check_recorded_by(about, folder, observation)
            for flight in flights:
                check_flight(flight, folder)
                images.append(_images(flight, observation))
                assert flight.options is not None
                options.append(flight.options)
                first.append(np.arange(flight.steps) == 0)
                self.digest.update(flight.options.tobytes() + flight.poses.tobytes())
                self.digest.update(np.ascontiguousarray(images[-1]).data)  # the same flight may have other frames
        self.count = len(images)
        """Number of flights."""
        self.images: np.ndarray = np.concatenate(images)
        """[S, H, W, K] uint8."""
        self.options: np.ndarray = np.concatenate(options)
        """[S, 4] int64."""
        self.options[..., FORWARD] = np.where(self.options[..., FORWARD] == BACKWARD, NONE, self.options[..., FORWARD])
        self.first: np.ndarray = np.concatenate(first)
        """[S] bool, whether the step begins a flight."""

    def draw(self, length: int, count: int, rng: np.random.Generator) -> tuple[np.ndarray, Sequences]:
        """Return images [L, C, H, W, K] uint8 and sequences of L consecutive steps, each from a random step on.

        L is `length` and C is `count`. A sequence may continue in the next flight. It begins with an empty memory, as a
        flight does.
        """
        start = rng.integers(len(self.first) - length + 1, size=count)
        rows = start + np.arange(length)[:, None]
        fresh, options = self.first[rows], self.options[rows]
        fresh[0] = True
        last = np.where(fresh[..., None], NO_OPTION, self.options[rows - 1]).astype(np.int8)
        zeros = np.zeros((length, count))
        worths = choice_worths(options.reshape(-1, 4)).reshape(length, count, len(MOVES))
        sequences = Sequences(
            river=zeros.astype(np.int64),
            pose=np.zeros((length, count, 4)),
            time_s=zeros,
            segment=zeros.astype(np.int64),
            travel=zeros.astype(np.int64),
            last=last,
            fresh=fresh,
            start=np.zeros((count, 0), np.float32),
            worths=worths.astype(np.float32),
            privileged=np.zeros((length, count, len(FEATURES)), np.float32),
            maps=np.zeros((length, count, ROWS * COLUMNS // 8), np.uint8),
        )
        return self.images[rows], sequences


def check_recorded_by(about: About, folder: Path, observation: str) -> None:
    """Raise `TrainingError`, which names the folder, for recordings of another camera or version, or without a mask."""
    camera, told = Camera(height_px=IMAGE_PX, width_px=IMAGE_PX), about.camera
    for name in ("height_px", "width_px", "fov_deg", "pitch_deg"):
        if told.get(name) != getattr(camera, name):
            raise TrainingError(
                f"{folder} was recorded through a camera with {name} {told.get(name)}; students see {name}"
                f" {getattr(camera, name)}: record with the camera of the defaults"
            )
    if told.get("lens"):
        raise TrainingError(
            f"{folder} was recorded through a lens, {told['lens']}; students see without: record with the camera of the"
            " defaults"
        )
    if "mask" in observation and "mask" not in about.layers:
        raise TrainingError(f"{folder} has no water masks: record them, or learn with --observation rgb")
    if (found := about.versions.get("RENDER")) != versions.RENDER:
        raise TrainingError(f"{folder} has frames of version {found}, but the renderer is version {versions.RENDER}")


def check_flight(flight: RecordedEpisode, folder: Path) -> None:
    """Raise `TrainingError`, which names the folder, for a flight that a student cannot learn from."""
    if flight.size_px != (IMAGE_PX, IMAGE_PX):
        raise TrainingError(f"{folder} has frames of {flight.size_px} pixels; students see {IMAGE_PX} x {IMAGE_PX}")
    if flight.options is None:
        raise TrainingError(f"{folder} has continuous actions; students learn discrete ones: record with those")
    vehicle = flight.options_of_flight.get("vehicle", "uav")
    if vehicle != "uav":
        raise TrainingError(f"{folder} has flights of the vehicle {vehicle}; students fly the UAV")
    level, seed = (flight.options_of_flight.get(name) for name in ("level", "world_seed"))
    if str(level).partition("+")[0] in LEVELS and isinstance(seed, int):
        refuse_unseen([seed], f"{folder}: world_seed", TrainingError)
    if task_named(flight.task).fast_step_m:
        raise TrainingError(f"{folder} has flights of the task {flight.task} with fast steps, which students have not")


def _images(flight: RecordedEpisode, observation: str) -> np.ndarray:
    """Return what the student sees before each step [T, H, W, K] uint8."""
    parts = [flight.rgb] if "rgb" in observation else []
    if "mask" in observation:
        assert flight.mask is not None
        parts.append(flight.mask[..., None])
    images = np.concatenate(parts, axis=-1)[:-1]
    assert images.shape[-1] == CHANNELS[observation]
    return images
