"""Kinds of files of recordings in LeRobot's and Minari's format, of videos, and of calibrations of cameras."""

import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from kind import Kind
from mutations import mutated_bytes, mutated_json, mutated_yaml

from tests.datasets.episodes import ABOUT, flight
from thalweg.core.video import VideoError, open_video, write_video
from thalweg.datasets.draft import draft_folder
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.recordings import Format, add_flight, read_recordings, recording
from thalweg.render import RenderError
from thalweg.render.records.calibration import camera_of_calibration

STEPS = 3
Mutate = Callable[[bytes, Random], bytes]


@cache
def _written(form: Format) -> Path:
    """Return a data set of one short flight, which stays as long as the process."""
    folder = Path(tempfile.mkdtemp()) / "flights"
    with recording(folder, form, ABOUT) as writer:
        add_flight(writer, flight(STEPS))
    return folder


def _part(form: Format, place: str, mutate: Mutate) -> Kind:
    """Return the kind of a file of a data set, by its place in the folder."""

    def read(path: Path) -> Any:
        folder = path.parent / "flights"
        shutil.copytree(_written(form), folder, dirs_exist_ok=True)
        (folder / place).write_bytes(path.read_bytes())
        about, flights = read_recordings(folder)
        return about, [(each.rgb, each.poses, each.rewards, each.costs, each.moves) for each in flights]

    return Kind(Path(place).name, lambda _: [(_written(form) / place).read_bytes()], mutate, read, (DatasetError,))


class _Interruption(Exception):
    """Ends a recording after its first flight."""


@cache
def _interrupted(form: Format) -> Path:
    """Return the draft that a recording of one short flight left, which stays as long as the process."""
    folder = Path(tempfile.mkdtemp()) / "flights"
    with suppress(_Interruption), recording(folder, form, ABOUT) as writer:
        add_flight(writer, flight(STEPS))
        raise _Interruption
    return draft_folder(folder)


def _draft(form: Format, place: str) -> Kind:
    """Return the kind of a file of a draft, from which the recording resumes and ends."""

    def read(path: Path) -> Any:
        folder = path.parent / "flights"
        shutil.copytree(_interrupted(form), draft_folder(folder), dirs_exist_ok=True)
        (draft_folder(folder) / place).write_bytes(path.read_bytes())
        with recording(folder, form, ABOUT) as writer:
            add_flight(writer, flight(STEPS))
        about, flights = read_recordings(folder)
        return about, [(each.rgb, each.poses, each.rewards, each.costs, each.moves) for each in flights]

    def samples(_: Path) -> list[bytes]:
        return [(_interrupted(form) / place).read_bytes()]

    return Kind(Path(place).name, samples, mutated_json, read, (DatasetError,), wanted=10_000)


def _video(folder: Path) -> list[bytes]:
    frames = np.random.default_rng(0).integers(256, size=(4, 32, 32, 3), dtype=np.uint8)
    write_video(folder / "a.mp4", frames, 4, crf=25)
    content = (folder / "a.mp4").read_bytes()
    (folder / "a.mp4").unlink()
    return [content]


def _read_video(path: Path) -> Any:
    """Return the frames; the frames a second of a damaged video may be unknown."""
    with open_video(path) as video:
        return list(video.frames)


CALIBRATION = b"""
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [400.0, 0.0, 319.5, 0.0, 401.0, 239.5, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.001, 0.0, 0.0, 0.0, 0.0]}
"""

RECORDING_KINDS: dict[str, Kind] = {
    "lerobot description": _part("lerobot", "meta/thalweg.json", mutated_json),
    "lerobot info": _part("lerobot", "meta/info.json", mutated_json),
    "lerobot table": _part("lerobot", "data/chunk-000/file-000.parquet", mutated_bytes),
    "minari metadata": _part("minari", "data/metadata.json", mutated_json),
    "minari data": _part("minari", "data/main_data.hdf5", mutated_bytes),
    "lerobot draft": _draft("lerobot", "recording.json"),
    "lerobot draft's flight": _draft("lerobot", "journal/000000.json"),
    "minari draft": _draft("minari", "recording.json"),
    "minari draft's flight": _draft("minari", "journal/000000.json"),
    "video": Kind("film.mp4", _video, mutated_bytes, _read_video, (VideoError,)),
    "calibration": Kind("camera.yaml", lambda _: [CALIBRATION], mutated_yaml, camera_of_calibration, (RenderError,)),
}
"""By their names in the table."""
