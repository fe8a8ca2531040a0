"""Reader of data sets in Minari's format that Thalweg recorded."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.datasets.episode import About, RecordedEpisode, check_episode
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.minari_layout import DATA, FILE, KEY, META


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
                read = _episode(episode, json.loads(str(meta[KEY])))
                check_episode(read, about, file)
                yield read
        except KeyError as error:
            raise DatasetError(f"{file} lacks {error}") from error
        except DatasetError:
            raise
        except Exception as error:  # of HDF5, Gymnasium and Minari, by the kind of damage
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
