"""What lies in a results folder? Everything that can be read, and by name everything that could not.

suite.json                    the suite as it was run, with versions and the machine
runs.csv                      one row per run, failed ones with their error
runs/PPO-0/                   the folder of a training run; `episodes.csv` in it gives the training curves
evaluation/PPO-0-Easy.csv     one row per evaluated episode
evaluation/unseen/...         the same under a condition other than the main one
logs/PPO-0.txt                what a run printed that was done in a process of its own
film.mp4, film.txt            a flight, and what it shows; film-error.txt instead where filming failed
report/                       made from the files above, and from nothing else
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from thalweg.bench.conditions import Trial
from thalweg.bench.episodes import Episode, read_episodes
from thalweg.bench.files import ResultsError, csv_text, read_csv
from thalweg.bench.statistics import TrainingLog
from thalweg.bench.suites import PACKAGED, arms_of
from thalweg.whole import write_whole

RUN_COLUMNS = ("run", "kind", "algorithm", "seed", "steps", "status", "error", "wall_s", "steps_per_s")
FILM, CAPTION, NO_FILM = "film.mp4", "film.txt", "film-error.txt"


@dataclass(frozen=True)
class RunRow:
    """What became of one run."""

    run: str
    kind: str
    algorithm: str
    seed: int
    steps: int
    status: str
    """`finished`, `failed`, or `absent`: a packaged policy that this copy lacks."""
    error: str = ""
    """One line, empty for a finished run."""
    wall_s: float = 0.0
    """Seconds of training, over all sessions that it took."""
    steps_per_s: float = 0.0


@dataclass(frozen=True)
class Results:
    """A results folder, read."""

    folder: Path
    suite: dict
    """As in `suite.json`; empty where that could not be read."""
    runs: list[RunRow]
    episodes: list[Episode]
    training: list[TrainingLog]
    skipped: list[str]
    """One line for each file that was not used: its name and why."""
    no_film: str = ""
    """Why filming failed; empty if it did not."""
    beyond: dict[str, list[Episode]] = field(default_factory=dict)
    """Episodes under each condition other than the main one, in the order of the suite."""

    @property
    def levels(self) -> list[str]:
        """Levels in the order of the suite, then of appearance."""
        return list(dict.fromkeys([*self.suite.get("test_levels", []), *(row.level for row in self.episodes)]))

    @property
    def policies(self) -> list[str]:
        """Every algorithm, flown or not: in the order of the runs, then those of the suite that have not begun."""
        begun, flown = (row.algorithm for row in self.runs), (row.algorithm for row in self.episodes)
        return list(dict.fromkeys([*begun, *(arm["name"] for arm in arms_of(self.suite)), *flown]))

    @property
    def planned_flights(self) -> set[tuple[str, str, int, str]]:
        """Condition, policy, seed and level of each evaluation that there should be: of the suite, but for runs that
        failed."""
        suite = self.suite
        baselines = [(name, 0) for name in suite.get("baselines", [])]
        flown = [(PACKAGED, 0)] if suite.get("packaged") else []
        flown += [(arm["name"], seed) for arm in arms_of(suite) for seed in arm["seeds"]]
        failed = {(row.algorithm, row.seed) for row in self.runs if row.status != "finished"}
        main = {"name": "", "blind": True, "levels": [], "rivers": []}
        return {
            (condition["name"], name, seed, level)
            for condition in (main, *suite.get("conditions", []))
            for name, seed in [*flown, *(baselines if condition["blind"] else [])]
            for level in [*condition["rivers"]] or condition["levels"] or suite.get("test_levels", [])
            if (name, seed) not in failed
        }

    @property
    def flights(self) -> set[tuple[str, str, int, str]]:
        """Condition, policy, seed and level of each evaluation that there is."""
        every = {"": self.episodes, **self.beyond}
        return {(name, row.algorithm, row.seed, row.level) for name, rows in every.items() for row in rows}

    def planned_seeds(self, algorithm: str) -> int:
        """How many seeds there should be of an algorithm."""
        planned = sum(len(arm["seeds"]) for arm in arms_of(self.suite) if arm["name"] == algorithm)
        return max(planned, sum(row.algorithm == algorithm for row in self.runs), 1)

    @property
    def most_steps(self) -> int:
        """Steps of the longest runs of the suite; 0 where it is not known."""
        return max((arm["steps"] for arm in arms_of(self.suite)), default=0)

    def gap(self, algorithm: str) -> str:
        """Why there are no episodes of an algorithm: `failed`, `absent`, or just `missing`."""
        statuses = {row.status for row in self.runs if row.algorithm == algorithm}
        return next((status for status in ("failed", "absent") if status in statuses), "missing")


def evaluation_path(folder: Path, run: str, trial: Trial) -> Path:
    """Where the episodes of a run in a trial lie."""
    return folder / "evaluation" / trial.condition.name / f"{run}-{trial.level}.csv"


def write_runs(folder: Path, rows: list[RunRow]) -> None:
    """Write `runs.csv`, whole or not at all."""
    write_whole(folder / "runs.csv", runs_text(rows))


def runs_text(rows: list[RunRow]) -> str:
    """The runs as CSV."""
    return csv_text(RUN_COLUMNS, [[getattr(row, name) for name in RUN_COLUMNS] for row in rows])


def read_runs(folder: Path) -> list[RunRow]:
    """The rows of `runs.csv`; none if there is no such file. Raises `ResultsError` where it is not of this kind."""
    path = folder / "runs.csv"
    if not path.exists():
        return []
    try:
        return [
            RunRow(
                row["run"],
                row["kind"],
                row["algorithm"],
                int(row["seed"]),
                int(row["steps"]),
                row["status"],
                row["error"],
                float(row["wall_s"]),
                float(row["steps_per_s"]),
            )
            for row in read_csv(path, RUN_COLUMNS)
        ]
    except ValueError as error:
        raise ResultsError(f"runs.csv: {error}" if not isinstance(error, ResultsError) else str(error)) from error


def read_suite(folder: Path) -> dict:
    """The content of `suite.json`; raises `ResultsError` where it is not JSON of this kind."""
    try:
        suite = json.loads((folder / "suite.json").read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ResultsError(f"suite.json cannot be read: {why}") from error
    if not isinstance(suite, dict) or "name" not in suite:
        raise ResultsError("suite.json is not the record of a suite")
    return suite


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
    skipped: list[str] = []

    def attempt(path: Path, read, otherwise):
        try:
            return read()
        except (ResultsError, OSError) as error:
            place, said = path.relative_to(folder).as_posix(), str(error)
            skipped.append(place + said.removeprefix(path.name) if said.startswith(path.name) else f"{place}: {said}")
            return otherwise

    suite = attempt(folder / "suite.json", lambda: read_suite(folder), {})
    runs = attempt(folder / "runs.csv", lambda: read_runs(folder), [])
    names = [condition["name"] for condition in suite.get("conditions", [])]
    places = [(folder / "evaluation").glob("*"), *((folder / "evaluation" / name).glob("*") for name in names)]
    episodes, *others = (
        [
            row
            for path in sorted(place)
            if path.name not in names
            for row in attempt(path, lambda p=path: _checked(p), [])
        ]
        for place in places
    )
    training = []
    for row in runs:
        path = folder / "runs" / row.run / "episodes.csv"
        if row.kind == "train" and (path.exists() or row.status == "finished"):
            log = attempt(path, lambda path=path, row=row: read_training(path, row), None)
            training.extend([log] if log is not None else [])
    if not episodes and not runs and len(skipped) == 1 and not (folder / "suite.json").exists():
        raise ResultsError(
            f"{folder} holds no results: no suite.json lies in it. Give a folder that `thalweg bench` wrote"
        )
    if not episodes:
        reasons = "".join(f"\n  {line}" for line in skipped)
        raise ResultsError(f"{folder} holds no evaluated episodes{reasons}")
    reason = folder / NO_FILM
    no_film = attempt(reason, lambda: reason.read_text(encoding="utf-8").strip(), "") if reason.exists() else ""
    beyond = {name: rows for name, rows in zip(names, others, strict=True) if rows}
    found = Results(folder, suite, runs, episodes, training, skipped, no_film, beyond)
    by_run = {row.run: place for place, row in enumerate(runs)}
    by_level = {level: place for place, level in enumerate(found.levels)}
    for rows in (episodes, *beyond.values()):
        rows.sort(
            key=lambda row: (
                by_run.get(f"{row.algorithm}-{row.seed}", len(by_run)),
                by_level.get(row.level, len(by_level)),
            )
        )
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
