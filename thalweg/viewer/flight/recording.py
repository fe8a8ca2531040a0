"""The file of a flight: its options, actions and what came of them, from which it can be flown again to the bit.

A finished flight also becomes a row of a table as `thalweg evaluate --out` writes it.
"""

import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import ALL_REASONS, Episode, flown_of_ahead, read_episodes, write_episodes
from thalweg.core import versions
from thalweg.core.atomic_io import atomic_path, without_temporaries
from thalweg.core.config import parse_config
from thalweg.core.file_lock import held
from thalweg.core.notices import notice
from thalweg.env.task.course_arrays import fingerprint
from thalweg.viewer.errors import ViewerError
from thalweg.viewer.flight.flight import Flight
from thalweg.viewer.flight.options import FlightOptions
from thalweg.world import World

FORMAT = 1
"""Version of the file."""
ENDING = ".npz"
DUE, NOT_YET = ".row-of-", 10**9
"""What stands between flight and table in the name of the hidden file of a row that is not yet in its table, and the
number of the row until it has one there."""
ARRAYS = ("actions", "poses", "times_s", "rewards", "costs")
NUMBERS = ("progress", "reason", "ahead", "world")
"""What a file has beside the text, in arrays and numbers."""
KEPT = {name: getattr(versions, name) for name in ("WORLD", "RULES", "FORCES", "TASKS", "VEHICLES")}
"""Versions on which it depends how a flight goes."""


@dataclass(frozen=True)
class Recording:
    """A flight of T steps."""

    options: FlightOptions
    pilots: tuple[str, ...]
    """[T] who flew each step."""
    cost_kinds: tuple[str, ...]
    versions: Mapping[str, int]
    """Versions that the flight was made with, as `KEPT`."""
    actions: np.ndarray
    """[T, 4], of the action space of the options."""
    poses: np.ndarray
    """[T + 1, 4] float64: x, y, z in metres, yaw in radians, from the start on."""
    times_s: np.ndarray
    """[T + 1] float64, clock of the water."""
    rewards: np.ndarray
    """[T] float64."""
    costs: np.ndarray
    """[T, K] float64."""
    progress: float
    """As `info["progress"]` after the last step."""
    reason: int
    """Code of `thalweg.env.DoneReason`; -1 for a flight that was saved before its end."""
    ahead: float
    """Share of an open course that lay ahead of the start, see `share_ahead`; NaN on a loop."""
    world: int
    """Hash of the river."""

    @classmethod
    def of(cls, flight: Flight) -> "Recording":
        """Return what has been flown; raises `ViewerError` for a flight without a step."""
        if not flight.steps:
            raise ViewerError("nothing has been flown yet: there is no flight to save")
        return cls(
            flight.options,
            tuple(flight.pilots),
            tuple(flight.env.cost_kinds),
            dict(KEPT),
            np.array(flight.actions),
            np.array(flight.poses),
            np.array(flight.times_s),
            np.array(flight.rewards),
            np.array(flight.costs),
            float(flight.info["progress"][0]),
            flight.reason,
            flight.ahead,
            fingerprint(flight.world),
        )

    @property
    def pilot(self) -> str:
        """Who flew, in the order in which they took over."""
        return "+".join(dict.fromkeys(self.pilots))

    def episode(self, number: int, world: World) -> Episode:
        """Return the row of a flight in a table of episodes, with its `number` there; without a reason if it has not
        ended, which tables do not hold."""
        totals = self.costs.cumsum(axis=0)[-1]  # one after the other, as evaluations add them
        x, y, z, yaw = map(float, self.poses[0])
        reason = ALL_REASONS[self.reason] if self.reason >= 0 else ""
        return Episode(
            self.pilot,
            self.options.seed,
            self.options.level,
            world.seed,
            number,
            *(x, y, z, yaw),
            return_=float(self.rewards.cumsum()[-1]),
            cost=float(self.costs.sum(axis=1).cumsum()[-1]),
            tight=float(totals[0]),
            loose=float(totals[1]),
            length=len(self.actions),
            reason=reason,
            success=reason == "Success",
            progress=self.progress,
            end_x=float(self.poses[-1, 0]),
            end_y=float(self.poses[-1, 1]),
            end_z=float(self.poses[-1, 2]),
            ahead=flown_of_ahead(self.progress, self.ahead, portage=self.options.rules.task_record.portage),
        )

    def check_river(self, world: World) -> None:
        """Raise `ViewerError` for another river than that of the flight."""
        if fingerprint(world) != self.world:
            raise ViewerError(f"the flight was in another river than {world.name}, seed {world.seed}, is now")

    def check_repeats(self, flight: Flight) -> None:
        """Raise `ViewerError` if a flight by the same actions has come to another pose than the recorded one."""
        if not np.array_equal(flight.poses[-1], self.poses[flight.steps]):
            others = [name for name, kept in KEPT.items() if self.versions.get(name) != kept]
            made = ", ".join(f"{name} {self.versions.get(name)} then, {KEPT[name]} now" for name in others)
            raise ViewerError(
                f"the recorded flight goes otherwise here from step {flight.steps} on ({made or 'on this machine'})"
            )


def write_recording(path: Path, recording: Recording) -> None:
    """Write a flight as a NumPy archive of plain arrays and a text, atomically."""
    about = {
        "format": FORMAT,
        "options": asdict(recording.options),
        "pilots": recording.pilots,
        "cost_kinds": recording.cost_kinds,
        "versions": recording.versions,
    }
    values: dict[str, Any] = {name: getattr(recording, name) for name in (*ARRAYS, *NUMBERS)}
    values["world"] = np.uint64(recording.world)
    with atomic_path(path) as draft:
        np.savez_compressed(draft, about=json.dumps(about), **values)


def read_recording(path: Path) -> Recording:
    """Return the flight in a file; raises `ViewerError` for a file of another kind, which is never executed, and
    `OSError` for one that cannot be opened."""
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as archive:
                about = json.loads(str(archive["about"]))
                arrays = {name: archive[name] for name in ARRAYS}
                numbers = {name: archive[name].item() for name in NUMBERS}
            known = about["format"], about["options"], about["pilots"], about["cost_kinds"], about["versions"]
        except Exception as error:  # archives, texts and arrays fail in many ways
            raise ViewerError(f"{path.name} is not a recorded flight") from error
    form, options, pilots, kinds, made_with = known
    _check_text(path.name, pilots, kinds, made_with)
    if form != FORMAT:
        raise ViewerError(f"{path.name} has format {form}; this version reads {FORMAT}")
    options = parse_config(FlightOptions, options, path.name)
    _check_shapes(path.name, arrays, len(pilots), len(kinds), options)
    _check_numbers(path.name, numbers)
    return Recording(options, tuple(pilots), tuple(kinds), made_with, **arrays, **numbers)


def _check_text(name: str, pilots: Any, kinds: Any, made_with: Any) -> None:
    """Raise `ViewerError` unless pilots and kinds of costs are lists of names, and versions whole numbers."""
    for what, names in (("pilots", pilots), ("cost_kinds", kinds)):
        if not isinstance(names, list) or not all(isinstance(each, str) and each.isprintable() for each in names):
            raise ViewerError(f"{name}: {what} must be a list of names")
    if len(kinds) < 2:
        raise ViewerError(f"{name}: cost_kinds must begin with tight and loose, got {', '.join(kinds) or 'none'}")
    if not isinstance(made_with, dict) or not all(type(each) is int for each in made_with.values()):
        raise ViewerError(f"{name}: versions must be whole numbers by name")


def _check_numbers(name: str, numbers: dict[str, Any]) -> None:
    """Raise `ViewerError` for a number that is none, or out of its range."""
    reason, world, progress, ahead = (numbers[each] for each in ("reason", "world", "progress", "ahead"))
    if type(reason) is not int or reason not in range(-1, len(ALL_REASONS)):
        raise ViewerError(f"{name} has the unknown reason {reason!r:.40}")
    if type(world) is not int or world < 0:
        raise ViewerError(f"{name}: world must be the hash of a river, got {world!r:.40}")
    if type(progress) is not float or not 0.0 <= progress <= 1.0:
        raise ViewerError(f"{name}: progress must be from 0 to 1, got {progress!r:.40}")
    if type(ahead) is not float or not (math.isnan(ahead) or 0.0 < ahead <= 1.0):
        raise ViewerError(f"{name}: ahead must be above 0 and at most 1, or NaN on a loop, got {ahead!r:.40}")


def _check_shapes(name: str, arrays: dict[str, np.ndarray], steps: int, kinds: int, options: FlightOptions) -> None:
    """Raise `ViewerError` unless all arrays belong to a flight of so many steps, and have finite numbers."""
    shapes = {
        "actions": (steps, 4),
        "poses": (steps + 1, 4),
        "times_s": (steps + 1,),
        "rewards": (steps,),
        "costs": (steps, kinds),
    }
    for each, array in arrays.items():
        if array.shape != shapes[each] or array.dtype.kind not in "iuf":
            raise ViewerError(f"{name}: {each} is {array.dtype} {array.shape}; needed: numbers {shapes[each]}")
        if not np.isfinite(array).all():
            raise ViewerError(f"{name}: {each} has a number that is not finite")
    if not steps:
        raise ViewerError(f"{name} has no step")
    whole = options.action == "multidiscrete"
    if np.issubdtype(arrays["actions"].dtype, np.integer) != whole:
        raise ViewerError(f"{name}: actions are {arrays['actions'].dtype}, but the flight's are {options.action}")


class Folder:
    """The folder in which flights are kept, with the tables of those that ended."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def save(self, flight: Flight) -> str:
        """Write what has been flown, and its row if it has ended; returns the name of the flight.

        The flight is kept also where its table cannot be read or written: a notice says so, and the row is added once
        that is mended. Raises `ViewerError` for a flight without a step, and `OSError`.
        """
        recording = Recording.of(flight)
        table = _table_of(recording.options)
        with self._free_name(recording) as name, held(self.path / table):
            due = self.path / f".{name}{DUE}{table}"
            try:
                if flight.ended:
                    write_episodes(due, [recording.episode(NOT_YET, flight.world)])
                write_recording(self.path / f"{name}{ENDING}", recording)
            except BaseException:
                due.unlink(missing_ok=True)
                raise
            try:
                self._add_rows(table)
            except (ResultsError, OSError) as error:
                notice(f"the flight {name} is saved in {self.path}, but has no row in {table} yet: {error}")
        return name

    def _add_rows(self, table: str) -> None:
        """Add the rows that are due to a table, also those of processes that were killed before they added theirs.

        Raises `ResultsError` for a table that cannot be read, and `OSError`. A row that cannot be read stays beside it.
        """
        path = self.path / table
        for due in without_temporaries(self.path.glob(f".*{DUE}{table}")):
            if (self.path / f"{due.name[1:].removesuffix(DUE + table)}{ENDING}").is_file():  # else it was never written
                try:
                    (row,) = read_episodes(due)
                except (ResultsError, ValueError):
                    continue
                rows = read_episodes(path) if path.is_file() else []
                if rows[row.episode : row.episode + 1] != [row]:  # else it was added, and its file was not removed
                    row = replace(row, episode=len(rows))
                    write_episodes(due, [row])
                    write_episodes(path, [*rows, row])
            due.unlink(missing_ok=True)

    def names(self) -> list[str]:
        """Return the names of the flights in the folder, the newest first."""
        files = [file for file in without_temporaries(self.path.glob(f"*{ENDING}")) if file.is_file()]
        return [file.stem for file in sorted(files, key=lambda file: (-file.stat().st_mtime, file.name))]

    def read(self, name: str) -> Recording:
        """Return the flight of a name; raises `ViewerError` for one that is not among `names`."""
        if name not in self.names():
            raise ViewerError(f"no flight {name!r} in {self.path}")
        return read_recording(self.path / f"{name}{ENDING}")

    @contextmanager
    def _free_name(self, recording: Recording) -> Iterator[str]:
        """Yield a name that no flight has yet, who, where, and a number, which no other process is given meanwhile."""
        options = recording.options
        stem = re.sub(r"[^\w.+-]+", "-", f"{options.level}-{options.task}-{recording.pilot}")[:80]
        self.path.mkdir(parents=True, exist_ok=True)
        for number in itertools.count(1):
            name = f"{stem}-{number:03d}"
            flight, claim = self.path / f"{name}{ENDING}", self.path / f".{name}.claim"
            if flight.exists():
                continue
            try:
                claim.touch(exist_ok=False)
            except FileExistsError:  # another process is writing that flight, or was killed while it did
                continue
            try:
                if not flight.exists():  # it may have been written, and its claim removed, since the first look
                    yield name
                    return
            finally:
                claim.unlink(missing_ok=True)


def _table_of(options: FlightOptions) -> str:
    """Return the name of the table for flights of a task and a vehicle, which no column tells apart."""
    kind = [options.task] * (options.task != "River") + [options.vehicle] * (options.vehicle != "uav")
    return "-".join(["episodes", *kind]) + ".csv"
