"""Writer and reader of data sets in Minari's format, in which each layer is a separate, lossless array.

Minari's own images are JPEG of up to three channels, so that they are not used. HDF5 compresses the arrays without
loss, and every reader of HDF5 decompresses them.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from thalweg.datasets.episode import LAYERS, RUNNING, About, Layer, RecordedEpisode
from thalweg.datasets.errors import DatasetError

DATA, FILE, META = "data", "main_data.hdf5", "metadata.json"
KEY = "thalweg"
"""Key of the metadata, of the data set and of each episode, under which Thalweg keeps what Minari has no place for."""
NAME = re.compile(r"[-\w]+")
"""Names of data sets that Minari takes."""
CHUNK_STEPS = 1
"""Observations in a compressed block; single ones are then read fast."""


def check_name(path: Path) -> None:
    """Raise `DatasetError` for a folder whose name Minari does not take as that of a data set."""
    if not NAME.fullmatch(path.name):
        raise DatasetError(
            f"Minari takes the folder's name as that of the data set: letters, digits, - and _, not {path.name!r}"
        )


class MinariWriter:
    """Writes flights to a folder that `minari.MinariDataset(folder / "data")` reads.

    `minari.load_dataset` reads it by the folder's name if `MINARI_DATASETS_PATH` is the folder's parent.
    """

    def __init__(self, folder: Path, name: str, about: About) -> None:
        """`folder` is empty; `name` is the name of the data set."""
        import minari

        self._folder, self._name, self._about = folder / DATA, name, about
        self._version = minari.__version__
        self._storage: Any = None

    def add(self, episode: RecordedEpisode) -> None:
        """Write a flight; raises `DatasetError` if it has other actions or another size than those before it."""
        from minari.data_collector import EpisodeBuffer

        if self._storage is None:
            self._storage = self._begin(episode)
        observed, acted = spaces_of(episode, self._about)
        if (observed, acted) != (self._storage.observation_space, self._storage.action_space):
            raise DatasetError("all flights of a data set need the same size of frames, layers and kind of actions")
        steps = episode.steps
        ended = np.arange(steps) == steps - 1
        buffer = EpisodeBuffer(
            seed=episode.options_of_flight.get("seed"),
            observations=observations_of(episode),
            actions=_actions(episode),  # pyright: ignore[reportArgumentType]  # arrays do as well as lists
            rewards=list(episode.rewards),
            terminations=list(ended & episode.terminated),
            truncations=list(ended & (not episode.terminated)),
            infos=infos_of(episode),
        )
        self._storage.update_episodes([buffer])
        about = {"task": episode.task, "options": episode.options_of_flight}
        self._storage.update_episode_metadata([{KEY: json.dumps(about)}], [self._storage.total_episodes - 1])

    def close(self) -> None:
        """Compress the file and write its size to the metadata."""
        if self._storage is not None:
            compress(self._folder / FILE)
            self._storage.update_metadata({"dataset_size": round(self._storage.get_size(), 1)})

    def _begin(self, episode: RecordedEpisode) -> Any:
        from minari.dataset.minari_storage import MinariStorage

        self._folder.mkdir(parents=True)
        observed, acted = spaces_of(episode, self._about)
        storage = MinariStorage.new(self._folder, observed, acted, data_format="hdf5", jpeg_encoding=False)
        storage.update_metadata(
            {
                "dataset_id": self._name,
                "minari_version": self._version,
                "description": "Flights along rivers, recorded by Thalweg.",
                KEY: asdict(self._about),
            }
        )
        return storage


def spaces_of(episode: RecordedEpisode, about: About) -> tuple[gymnasium.Space, gymnasium.Space]:
    """Return the spaces of the observations and actions of a flight."""
    size = episode.size_px
    parts: dict[str, gymnasium.Space] = {"rgb": gymnasium.spaces.Box(0, 255, (*size, 3), np.uint8)}
    bounds = {"mask": (0, 255), "depth": (-1.0, np.inf), "class": (0, len(about.classes) - 1)}
    for name in _layers(episode):
        kind: Any = np.float32 if name == "depth" else np.uint8
        low, high = bounds[name]
        parts[name] = gymnasium.spaces.Box(low, high, size, kind)
    parts["proprioception"] = gymnasium.spaces.Box(-np.inf, np.inf, (len(about.proprioception),), np.float32)
    acted = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
    return gymnasium.spaces.Dict(parts), acted if episode.options is None else gymnasium.spaces.MultiDiscrete([3] * 4)


def observations_of(episode: RecordedEpisode) -> dict[str, np.ndarray]:
    """Return the observations [T + 1, ...] of a flight by their names."""
    layers = {name: episode.layer(name) for name in _layers(episode)}
    return {"rgb": episode.rgb, **layers, "proprioception": episode.proprioception}  # pyright: ignore


def infos_of(episode: RecordedEpisode) -> dict[str, Any]:
    """Return the values of `info` [T + 1, ...], at the start and after each step; units as in `RecordedEpisode`."""
    return {
        "pose": episode.poses,
        "time_s": episode.times_s,
        "move": np.concatenate([np.zeros((1, 4), np.float32), episode.moves]),
        "costs": np.concatenate([np.zeros((1, episode.costs.shape[1])), episode.costs]),
        "cost": np.concatenate([[0.0], episode.costs.sum(axis=1)]),
        "done_reason": np.concatenate([[RUNNING], episode.reasons()]),
        "pilot": ["", *episode.pilots],
    }


def _layers(episode: RecordedEpisode) -> list[Layer]:
    return [name for name in LAYERS if episode.layer(name) is not None]


def _actions(episode: RecordedEpisode) -> np.ndarray:
    return episode.moves if episode.options is None else episode.options


def compress(path: Path) -> None:
    """Compress the observations in an HDF5 file without loss."""
    import h5py

    draft = path.with_name("compressed.hdf5")

    def copy(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            target = out.require_group(name)
        elif item.ndim > 2:
            chunks = (CHUNK_STEPS, *item.shape[1:])
            options = {"maxshape": (None, *item.shape[1:]), "compression": "gzip", "compression_opts": 4}
            target = out.create_dataset(name, data=item[()], chunks=chunks, shuffle=item.dtype != np.uint8, **options)
        else:
            before.copy(item, out.require_group(str(Path(name).parent.as_posix())), name=Path(name).name)
            return
        for key, value in item.attrs.items():
            target.attrs[key] = value

    with h5py.File(path, "r") as before, h5py.File(draft, "w", track_order=True) as out:
        for key, value in before.attrs.items():
            out.attrs[key] = value
        before.visititems(copy)
    draft.replace(path)


def is_minari(folder: Path) -> bool:
    """Return whether a folder holds a data set of Minari."""
    return (folder / DATA / META).is_file()


def read_minari(folder: Path) -> tuple[About, Iterator[RecordedEpisode]]:
    """Return the description of a data set, and an iterator over its flights.

    Raises `DatasetError` for a data set that was not recorded by Thalweg, or cannot be read;
    so does the iterator for a file that is damaged or lacks something.
    """
    from minari import MinariDataset

    try:
        data = MinariDataset(folder / DATA)
        told = data.storage.metadata.get(KEY)
    except Exception as error:  # Minari raises many kinds
        raise DatasetError(f"{folder} cannot be read as a data set of Minari: {error}") from error
    if told is None:
        raise DatasetError(f"{folder} is a data set of Minari, but was not recorded by Thalweg")
    about = About.from_plain(told, folder)

    def episodes() -> Iterator[RecordedEpisode]:
        file = folder / DATA / FILE
        try:
            told_of_each = data.storage.get_episode_metadata(range(len(data)))
            for episode, meta in zip(data.iterate_episodes(), told_of_each, strict=True):
                yield _episode(episode, json.loads(str(meta[KEY])))
        except KeyError as error:
            raise DatasetError(f"{file} lacks {error}") from error
        except (OSError, ValueError, TypeError, IndexError, RuntimeError) as error:  # of HDF5, by the kind of damage
            raise DatasetError(f"{file} cannot be read: {error!r}") from error

    return about, episodes()


def _episode(episode: Any, about: dict[str, Any]) -> RecordedEpisode:
    seen, info = episode.observations, episode.infos
    discrete = np.issubdtype(episode.actions.dtype, np.integer)
    return RecordedEpisode(
        rgb=seen["rgb"],
        mask=seen.get("mask"),
        depth_m=seen.get("depth"),
        class_id=seen.get("class"),
        proprioception=seen["proprioception"],
        poses=info["pose"],
        times_s=info["time_s"],
        moves=info["move"][1:],
        options=episode.actions if discrete else None,
        rewards=episode.rewards,
        costs=info["costs"][1:],
        terminated=bool(episode.terminations[-1]),
        reason=int(info["done_reason"][-1]),
        pilots=tuple(name.decode() if isinstance(name, bytes) else name for name in info["pilot"][1:]),
        task=about["task"],
        options_of_flight=about["options"],
    )
