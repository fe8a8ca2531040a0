"""What can be read of a results folder, and by name what could not?"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from thalweg.bench.csv_files import ResultsError, read_csv
from thalweg.bench.evaluate.episodes import Episode, read_episodes
from thalweg.bench.results.results import FILMS, KINDS, MAIN_FILM, Film, FilmFiles, Results, RunRow, read_runs
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.record import read_suite
from thalweg.bench.suite.suites import arms_of

Value = TypeVar("Value")


def read_training(path: Path, row: RunRow) -> TrainingLog:
    """The finished episodes of a training run from its `episodes.csv`; raises `ResultsError`."""
    columns = ("step", "return", "tight", "loose")
    lines = read_csv(path, columns)
    try:
        values = {name: np.array([float(line[name]) for line in lines]) for name in columns}
    except ValueError as error:
        raise ResultsError(f"{path.name}: {error}") from error
    order = np.argsort(values["step"], kind="stable")
    step, return_, tight, loose = (values[name][order] for name in columns)
    last = max(row.steps, int(step[-1]) if len(step) else 0)
    return TrainingLog(row.algorithm, row.seed, step.astype(np.int64), return_, tight, loose, last)


def read_results(folder: Path) -> Results:
    """Everything readable in the folder; raises `ResultsError` where there is no such folder or no episode in it."""
    if not folder.is_dir():
        raise ResultsError(f"no results folder {folder}")
    reader = _Reader(folder)
    suite = reader.attempt(folder / "suite.json", lambda: read_suite(folder), {})
    runs = reader.attempt(folder / "runs.csv", lambda: read_runs(folder), [])
    suite = reader.attempt(folder / "suite.json", lambda: _of_runs(suite, runs), {})
    conditions = [condition["name"] for condition in suite.get("conditions", [])]
    unknown = [] if suite else sorted(place.name for place in (folder / "evaluation").glob("*/"))
    episodes = reader.episodes(folder / "evaluation", apart=[*conditions, *unknown])
    if unknown:
        reader.skipped.append(
            f"evaluation: flights under {', '.join(unknown)}, for without suite.json no condition is known"
        )
    others = {name: reader.episodes(folder / "evaluation" / name) for name in conditions}
    training = reader.training(runs)
    if not episodes and not runs and len(reader.skipped) == 1 and not (folder / "suite.json").exists():
        raise ResultsError(
            f"{folder} holds no results: no suite.json lies in it. Give a folder that `thalweg bench` wrote"
        )
    if not episodes:
        reasons = "".join(f"\n  {line}" for line in reader.skipped)
        raise ResultsError(f"{folder} holds no evaluated episodes{reasons}")
    by_condition = {name: rows for name, rows in others.items() if rows}
    found = Results(folder, suite, runs, episodes, training, reader.skipped, condition_episodes=by_condition)
    _put_in_order(found)
    return replace(found, films=reader.films(found.policies))


def _of_runs(suite: dict[str, Any], runs: Sequence[RunRow]) -> dict[str, Any]:
    """The suite; raises `ResultsError` for one without a single algorithm where some were trained."""
    trained = dict.fromkeys(row.algorithm for row in runs if row.kind == "train")
    if suite and trained and not arms_of(suite):
        raise ResultsError(
            f"suite.json names no algorithm, but runs.csv has runs of {', '.join(trained)} that were trained"
        )
    return suite


def _put_in_order(found: Results) -> None:
    """Sort all episodes by run, then by level."""
    by_run = {row.run: place for place, row in enumerate(found.runs)}
    by_level = {level: place for place, level in enumerate(found.levels)}

    def place(row: Episode) -> tuple[int, int]:
        return by_run.get(f"{row.algorithm}-{row.seed}", len(by_run)), by_level.get(row.level, len(by_level))

    for rows in (found.episodes, *found.condition_episodes.values()):
        rows.sort(key=place)


@dataclass(frozen=True)
class _Reader:
    """Reads what it can of a folder, and remembers what it could not."""

    folder: Path
    skipped: list[str] = field(default_factory=list)
    """As in `Results`."""

    def attempt(self, path: Path, read: Callable[[], Value], otherwise: Value) -> Value:
        """What `read` gives; `otherwise`, and a line of why, if the file at `path` can't be used."""
        try:
            return read()
        except (ResultsError, OSError) as error:
            said = str(error.strerror if isinstance(error, OSError) else error)
            place = path.relative_to(self.folder).as_posix()
            line = place + said.removeprefix(path.name) if said.startswith(path.name) else f"{place}: {said}"
            self.skipped.append(line)
            return otherwise

    def episodes(self, place: Path, apart: Sequence[str] = ()) -> list[Episode]:
        """The episodes of all files in a folder, but for folders in it named in `apart`."""
        paths = [path for path in sorted(place.glob("*")) if path.name not in apart]
        return [row for path in paths for row in self.attempt(path, lambda path=path: _checked(path), [])]

    def training(self, runs: Sequence[RunRow]) -> list[TrainingLog]:
        """How the training of each run went, as far as it got."""
        logs = []
        for row in runs:
            path = self.folder / "runs" / row.run / "episodes.csv"
            if row.kind == "train" and (path.exists() or row.status == "finished"):
                logs.append(self.attempt(path, lambda path=path, row=row: read_training(path, row), None))
        return [log for log in logs if log is not None]

    def words(self, path: Path) -> str:
        """A file of one line."""

        def read() -> str:
            try:
                return path.read_text(encoding="utf-8").strip()
            except UnicodeDecodeError as error:
                raise ResultsError(f"{path.name} is not text: {error}") from error

        return self.attempt(path, read, "")

    def films(self, policies: Sequence[str]) -> dict[str, Film]:
        """The films that there are or that could not be made, by name: the best flight's, then those of policies."""
        found = {}
        for name in (MAIN_FILM, *(f"{FILMS}/{policy}-{kind}" for policy in policies for kind in KINDS)):
            files = FilmFiles.of(self.folder, name)
            if files.film.exists() and files.caption.exists():
                found[name] = Film(files.film, self.words(files.caption))
            elif files.failure.exists():
                found[name] = Film(None, self.words(files.failure))
            elif files.film.exists():
                self.skipped.append(f"{name}.mp4: there is no {name}.txt that says what it shows")
        return found


def _checked(path: Path) -> list[Episode]:
    """The episodes of a file whose name agrees with what is in it."""
    if path.suffix != ".csv":
        raise ResultsError("not a result of an evaluation (half-written, or foreign)")
    rows = read_episodes(path)
    if not rows:
        raise ResultsError(f"{path.name} has no rows")
    names = {f"{row.algorithm}-{row.seed}-{row.level}" for row in rows}
    if names != {path.stem}:
        raise ResultsError(f"{path.name} holds the episodes of {', '.join(sorted(names))}")
    if [row.episode for row in rows] != list(range(len(rows))):
        raise ResultsError(f"{path.name} lacks or repeats episodes")
    return rows
