"""Writer of data sets in Minari's format: a file of HDF5 for each flight, and one of all in the end.

Images are written as the steps come; the numbers of a flight are in memory until it ends. A flight's file has the
group that becomes its episode, so that it is copied as it is.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.core.atomic_io import atomic_path
from thalweg.datasets.draft import JOURNAL, Draft
from thalweg.datasets.episode import RUNNING, About
from thalweg.datasets.errors import DatasetError
from thalweg.datasets.minari_layout import DATA, FILE, KEY, group_of, spaces_of
from thalweg.datasets.steps import FlightWriter, Sight, Step, check_layers

LEVEL = 4
"""Level of the compression by gzip, up to 9."""


class MinariWriter:
    """Writes flights to a folder that `minari.MinariDataset(folder / "data")` reads.

    `minari.load_dataset` reads it by the folder's name if `MINARI_DATASETS_PATH` is the folder's parent.
    """

    def __init__(self, draft: Draft, about: About) -> None:
        self._draft, self.about, self._flights = draft, about, draft.records

    @property
    def finished(self) -> int:
        """Number of flights that are written."""
        return len(self._flights)

    @contextmanager
    def flight(self, task: str, options: dict[str, Any]) -> Iterator[FlightWriter]:
        """Write the flight that is given in the block, see `DataSetWriter.flight`."""
        import h5py

        number = self.finished
        with atomic_path(self._file_of(number)) as draft, h5py.File(draft, "w", track_order=True) as file:
            group = file.create_group(group_of(number), track_order=True)
            group.attrs["id"] = number
            if options.get("seed") is not None:
                group.attrs["seed"] = options["seed"]
            group.attrs[KEY] = json.dumps({"task": task, "options": options})
            writer = MinariFlight(group, self.about, self._check_kind)
            yield writer
            told = writer.told()
        self._draft.note(told)

    def close(self) -> None:
        """Write the file of all flights and the metadata."""
        if not self._flights:
            return
        import h5py
        import minari
        from minari.dataset.minari_storage import MinariStorage

        kind, folder = self._flights[0]["kind"], (self._draft.folder / DATA).absolute()
        for old in folder.glob("*"):  # of a command that was killed here
            old.unlink()
        folder.mkdir(exist_ok=True)
        spaces = spaces_of(tuple(kind["size_px"]), self.about, discrete=kind["discrete"])
        storage: Any = MinariStorage.new(folder, *spaces, data_format="hdf5", jpeg_encoding=False)
        with h5py.File(folder / FILE, "w", track_order=True) as out:
            for number in range(self.finished):
                with h5py.File(self._file_of(number), "r") as flight:
                    flight.copy(group_of(number), out)
        storage.update_metadata(
            {
                "dataset_id": self._draft.name.name,
                "minari_version": minari.__version__,
                "description": "Flights along rivers, recorded by Thalweg.",
                "total_episodes": self.finished,
                "total_steps": sum(each["steps"] for each in self._flights),
                KEY: asdict(self.about),
            }
        )
        storage.update_metadata({"dataset_size": round(storage.get_size(), 1)})

    def _file_of(self, number: int) -> Path:
        return self._draft.folder / JOURNAL / f"{number:06d}.hdf5"

    def _check_kind(self, kind: dict[str, Any]) -> None:
        """Raise `DatasetError` unless a flight has actions and images as those before it."""
        if self._flights and self._flights[0]["kind"] != kind:
            raise DatasetError("all flights of a data set need the same size of frames, layers and kind of actions")


class MinariFlight:
    """Writes a flight to a group of HDF5."""

    def __init__(self, group: Any, about: About, check: Any) -> None:
        """`check`: is given what must be the same in all flights at the first step, and raises `DatasetError`."""
        self._group, self._about, self._check = group, about, check
        self._sights: list[tuple[np.ndarray, np.ndarray, float]] = []
        self._steps: list[Step] = []
        self._first: Sight | None = None
        self._kind: dict[str, Any] = {}
        self._done: tuple[bool, int] | None = None

    def see(self, sight: Sight) -> None:
        self._first = sight

    def step(self, step: Step, after: Sight) -> None:
        if not self._steps:
            assert self._first is not None
            check_layers(self._first, self._about)
            size = list(self._first.size_px)
            self._kind = {"size_px": size, "layers": [*self._first.images], "discrete": step.option is not None}
            self._check(self._kind)
            self._create(self._first)
            self._write(self._first)
        check_layers(after, self._about)
        self._steps.append(step)
        self._write(after)

    def end(self, terminated: bool, reason: int) -> None:
        if not self._steps:
            raise DatasetError("a flight without a step cannot be recorded")
        self._done = terminated, reason
        self._group.attrs["total_steps"] = len(self._steps)
        seen = self._group["observations"]
        _write_numbers(seen, {"proprioception": np.stack([felt for felt, _, _ in self._sights])})
        _write_numbers(self._group, self._outcomes())
        _write_numbers(self._group.create_group("infos", track_order=True), self._infos())

    def told(self) -> dict[str, Any]:
        """Return steps and kind of the flight as plain data; raises `DatasetError` for a flight without an end."""
        if self._done is None:
            raise DatasetError("a flight was not recorded to its end")
        return {"steps": len(self._steps), "reason": self._done[1], "kind": self._kind}

    def _create(self, sight: Sight) -> None:
        """Create the arrays of images, each of which is a compressed block: single ones are then read fast."""
        seen = self._group.create_group("observations", track_order=True)
        for name, image in sight.images.items():
            shape, kind = image.shape, image.dtype
            seen.create_dataset(
                name,
                (0, *shape),
                kind,
                maxshape=(None, *shape),
                chunks=(1, *shape),
                compression="gzip",
                compression_opts=LEVEL,
                shuffle=kind != np.uint8,
            )

    def _write(self, sight: Sight) -> None:
        """Write the images of a sight, and keep its numbers."""
        count = len(self._sights)
        for name, image in sight.images.items():
            images = self._group["observations"][name]
            images.resize(count + 1, axis=0)
            images[count] = image
        self._sights.append((sight.proprioception, sight.pose, sight.time_s))

    def _outcomes(self) -> dict[str, Any]:
        """Return what the steps did and brought, each [T, ...]."""
        assert self._done is not None
        steps, (terminated, _) = self._steps, self._done
        last = np.arange(len(steps)) == len(steps) - 1
        return {
            "actions": np.stack([step.move if step.option is None else step.option for step in steps]),
            "rewards": np.array([step.reward for step in steps]),
            "terminations": last & terminated,
            "truncations": last & (not terminated),
        }

    def _infos(self) -> dict[str, Any]:
        """Return the values of `info` [T + 1, ...], at the start and after each step; units as in `Sight` and
        `Step`."""
        assert self._done is not None
        steps, (_, reason) = self._steps, self._done
        costs = np.stack([step.costs for step in steps])
        return {
            "pose": np.stack([pose for _, pose, _ in self._sights]),
            "time_s": np.array([time_s for _, _, time_s in self._sights]),
            "move": np.concatenate([np.zeros((1, 4), np.float32), np.stack([step.move for step in steps])]),
            "costs": np.concatenate([np.zeros((1, costs.shape[1])), costs]),
            "cost": np.concatenate([[0.0], costs.sum(axis=1)]),
            "done_reason": np.array([RUNNING] * len(steps) + [reason]),
            "pilot": ["", *(step.pilot for step in steps)],
        }


def _write_numbers(group: Any, arrays: dict[str, Any]) -> None:
    """Write arrays, or lists of texts, to a group by their names, as Minari does."""
    import h5py

    for name, values in arrays.items():
        kind = h5py.string_dtype(encoding="utf-8") if isinstance(values, list) else None
        shape = (None, *np.shape(values)[1:])
        group.create_dataset(name, data=values, dtype=kind, chunks=True, maxshape=shape)
