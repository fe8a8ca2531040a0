"""Reading of results folders. Files that cannot be used are skipped and named."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from os.path import exists
from pathlib import Path
from typing import Any, TypeVar

from thalweg.algos.registry import version_of
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.episodes import Episode, read_episodes
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.results.curve import read_training, training_file
from thalweg.bench.results.outdated import FOLDER as OUTDATED
from thalweg.bench.results.results import (
    FILMS,
    KINDS,
    MAIN_FILM,
    Film,
    FilmFiles,
    OutdatedPolicy,
    Results,
    RunRow,
    flight_in_words,
    read_runs,
)
from thalweg.bench.results.run_versions import (
    GEOMETRY,
    GEOMETRY_TASKS,
    Sources,
    Versions,
    current_versions,
    read_sources,
    read_versions,
    some_cost_critics_are_told,
    some_critics_are_asymmetric,
    version_label,
)
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.record import (
    arms_of,
    encoder_of,
    has_banks,
    has_forces,
    observation_of,
    read_suite,
    stages_of,
    task_of,
    training_steps,
)
from thalweg.core.atomic_io import without_temporaries

Value = TypeVar("Value")


def read_results(folder: Path, *, as_recorded: bool = False) -> Results:
    """Everything readable in a results folder.

    Policies whose runs are outdated have their versions in their names. `as_recorded` leaves them out, for a study that
    is described as of the versions it was made with, which must then be the same for all its runs.

    Raises `ResultsError` if the folder does not exist, holds no episodes, or holds runs of several versions that should
    be read as recorded.
    """
    if not folder.is_dir():
        raise ResultsError(f"no results folder {folder}")
    reader = _Reader(folder)
    suite = reader.attempt(folder / "suite.json", lambda: read_suite(folder), {})
    rows = reader.attempt(folder / "runs.csv", lambda: read_runs(folder), [])
    suite = reader.attempt(folder / "suite.json", lambda: _checked_suite(suite, rows), {})
    unknown = [] if suite else sorted(path.name for path in (folder / "evaluation").glob("*/"))
    runs = reader.runs(folder, rows, suite, unknown)
    if unknown:
        reader.skipped.append(
            f"evaluation: flights under {', '.join(unknown)}, for without suite.json no condition is known"
        )
    if not runs.episodes and not rows and len(reader.skipped) == 1 and not (folder / "suite.json").exists():
        raise ResultsError(
            f"{folder} holds no results: no suite.json lies in it. Give a folder that `thalweg bench` wrote"
        )
    if as_recorded:
        _check_one_version(folder, runs.versions)
        outdated = {}
    else:
        runs, outdated = _labelled(runs, suite)
    if not as_recorded and (folder / OUTDATED).is_dir():
        outdated_rows = reader.attempt(folder / OUTDATED / "runs.csv", lambda: read_runs(folder / OUTDATED), [])
        outdated_runs, more = _labelled(reader.runs(folder / OUTDATED, outdated_rows, suite, unknown), suite)
        runs, outdated = _with_outdated(runs, outdated_runs, more), outdated | more
    if not runs.episodes:
        reasons = "".join(f"\n  {line}" for line in reader.skipped)
        raise ResultsError(f"{folder} holds no evaluated episodes{reasons}")
    by_condition = {name: episodes for name, episodes in runs.by_condition.items() if episodes}
    results = Results(
        folder,
        suite,
        runs.rows,
        runs.episodes,
        runs.training,
        reader.skipped,
        condition_episodes=by_condition,
        outdated={name: policy for name, policy in outdated.items() if name in runs.policies},
        versions=runs.versions,
        sources=runs.sources,
    )
    _sort_episodes(results)
    return with_films(results)


def with_films(results: Results) -> Results:
    """The results with the films that lie in their folder now."""
    reader = _Reader(results.folder, list(results.skipped))
    return replace(results, films=reader.films(results), skipped=reader.skipped)


def _checked_suite(suite: dict[str, Any], rows: Sequence[RunRow]) -> dict[str, Any]:
    """The suite; raises `ResultsError` for one without any algorithm if some were trained."""
    trained = dict.fromkeys(row.algorithm for row in rows if row.kind == "train")
    if suite and trained and not arms_of(suite):
        raise ResultsError(
            f"suite.json names no algorithm, but runs.csv has runs of {', '.join(trained)} that were trained"
        )
    return suite


@dataclass(frozen=True)
class _Runs:
    """The runs in a results folder, or in the folder of outdated ones."""

    rows: list[RunRow]
    episodes: list[Episode]
    """Episodes under the main condition."""
    by_condition: dict[str, list[Episode]]
    training: list[TrainingLog]
    versions: dict[str, Versions]
    sources: dict[str, Sources]

    @property
    def policies(self) -> set[str]:
        """Names of all policies."""
        episodes = (row for rows in (self.episodes, *self.by_condition.values()) for row in rows)
        return {each.algorithm for each in (*self.rows, *episodes)}


def _check_one_version(folder: Path, versions: Mapping[str, Versions]) -> None:
    """Raise `ResultsError` if runs of a folder have different versions of anything, or outdated ones are set aside."""
    if (folder / OUTDATED).is_dir():
        raise ResultsError(f"{folder} holds runs of several versions: some are set aside in {OUTDATED}")
    found: dict[str, int | None] = {}
    for run, recorded in versions.items():
        for name, version in recorded.items():
            if found.setdefault(name, version) != version:
                raise ResultsError(f"{folder} holds runs of several versions: {run} has {name} {version}")


def _labelled(runs: _Runs, suite: Mapping[str, Any]) -> tuple[_Runs, dict[str, OutdatedPolicy]]:
    """The runs with outdated ones under names of their own, and these policies by name."""
    outdated: dict[str, OutdatedPolicy] = {}

    def name_of(policy: str, seed: int) -> str:
        recorded = runs.versions.get(f"{policy}-{seed}", {})
        current = versions_today(suite, policy, recorded)
        # The version of a plug-in that is not here cannot be compared.
        absent = {
            each: recorded.get(each) for each in runs.sources.get(f"{policy}-{seed}", {}) if not current.get(each)
        }
        if suite.get("task") in absent and "props" in recorded:  # of which such a task may draw some
            absent["props"] = current_versions("packaged", (), task="Swimmers")["props"]
        label = version_label(recorded, current | absent)
        if not label:
            return policy
        found = OutdatedPolicy(policy, label)
        outdated[found.name] = found
        return found.name

    def renamed(row: Any) -> Any:
        return replace(row, algorithm=name_of(row.algorithm, row.seed))

    def run_of(run: str) -> str:
        policy, _, seed = run.rpartition("-")
        name = name_of(policy, int(seed)) if seed.isdecimal() else ""
        return outdated[name].run(int(seed)) if name in outdated else run

    rows = [replace(row, run=run_of(row.run), algorithm=name_of(row.algorithm, row.seed)) for row in runs.rows]
    by_condition = {name: list(map(renamed, episodes)) for name, episodes in runs.by_condition.items()}
    episodes, training = (list(map(renamed, each)) for each in (runs.episodes, runs.training))
    recorded = {run_of(run): found for run, found in runs.versions.items()}
    sources = {run_of(run): found for run, found in runs.sources.items()}
    return _Runs(rows, episodes, by_condition, training, recorded, sources), outdated


def versions_today(suite: Mapping[str, Any], policy: str, recorded: Versions) -> dict[str, int | None]:
    """The versions that a policy's runs have now, by the record of their suite; if that does not name it, derived from
    the recorded ones."""
    where: dict[str, Any] = {"task": task_of(suite), "forces": has_forces(suite), "banks": has_banks(suite)}
    if policy in suite.get("baselines", []):
        return current_versions("baseline", [policy], **where)
    if policy == PACKAGED:
        return current_versions("packaged", (), **where)
    flown = next((each for each in suite.get("policies", []) if each["name"] == policy), None)
    if flown is not None:  # a function's version is not known here: a report loads no function
        seen, encoder = flown["observation"], encoder_of(suite, flown)
        made = current_versions("function", (), observation=seen, encoder=encoder, **where)
        return made | ({policy: recorded[policy]} if policy in recorded else {})
    arm = next((arm for arm in arms_of(suite) if arm["name"] == policy), None)
    if arm is not None:
        stages = stages_of(arm)
        return current_versions(
            "train",
            [algorithm for algorithm, _, _ in stages],
            observation=observation_of(suite, arm),
            encoder=encoder_of(suite, arm),
            asymmetric_critics=some_critics_are_asymmetric(stages),
            told_cost_critics=some_cost_critics_are_told(stages),
            begins_with_packaged=arm.get("begin_with") == PACKAGED,
            **where,
        )
    known = (
        current_versions(
            "train",
            [name for name in recorded if version_of(name) is not None],
            asymmetric_critics=True,
            told_cost_critics=True,
            **where,
        )
        | current_versions("train", (), encoder=GEOMETRY)
        | current_versions("train", (), encoder=GEOMETRY_TASKS)
        | current_versions("packaged", ())
        | current_versions("baseline", [policy], **where)
    )
    return {name: version for name, version in known.items() if name in recorded or not recorded}


def _with_outdated(runs: _Runs, outdated_runs: _Runs, outdated: Mapping[str, OutdatedPolicy]) -> _Runs:
    """The runs with those set aside, except for those that have been run again; rows of a policy stand together."""
    done = {(row.algorithm, row.seed) for row in runs.rows if row.status == "finished"}

    def is_shown(row: Any) -> bool:
        policy = outdated[row.algorithm].policy if row.algorithm in outdated else row.algorithm
        return (policy, row.seed) not in done

    def policy_of(row: RunRow) -> str:
        return row.algorithm.partition(" (")[0]

    known = {(row.algorithm, row.seed) for row in runs.rows}
    rows = runs.rows + [row for row in outdated_runs.rows if is_shown(row) and (row.algorithm, row.seed) not in known]
    order = list(dict.fromkeys(map(policy_of, rows)))
    conditions = dict.fromkeys([*runs.by_condition, *outdated_runs.by_condition])
    return _Runs(
        sorted(rows, key=lambda row: order.index(policy_of(row))),
        runs.episodes + list(filter(is_shown, outdated_runs.episodes)),
        {
            name: runs.by_condition.get(name, []) + list(filter(is_shown, outdated_runs.by_condition.get(name, [])))
            for name in conditions
        },
        runs.training + list(filter(is_shown, outdated_runs.training)),
        outdated_runs.versions | runs.versions,
        outdated_runs.sources | runs.sources,
    )


def _sort_episodes(results: Results) -> None:
    """Sort all episodes by run, then by level."""
    by_run = {(row.algorithm, row.seed): number for number, row in enumerate(results.runs)}
    by_level = {level: number for number, level in enumerate(results.levels)}

    def key(row: Episode) -> tuple[int, int]:
        return by_run.get((row.algorithm, row.seed), len(by_run)), by_level.get(row.level, len(by_level))

    for rows in (results.episodes, *results.condition_episodes.values()):
        rows.sort(key=key)


@dataclass(frozen=True)
class _Reader:
    """Reads the files of a folder, and collects the reasons why some cannot be used."""

    folder: Path
    skipped: list[str] = field(default_factory=list)
    """See `Results`."""

    def attempt(self, path: Path, read: Callable[[], Value], default: Value) -> Value:
        """The result of `read`; `default`, with a line in `skipped`, if the file at `path` cannot be used."""
        try:
            return read()
        except (ResultsError, OSError) as error:
            reason = str(error.strerror if isinstance(error, OSError) else error)
            name = path.relative_to(self.folder).as_posix()
            is_named = reason.startswith(path.name)
            self.skipped.append(name + reason.removeprefix(path.name) if is_named else f"{name}: {reason}")
            return default

    def runs(self, folder: Path, rows: list[RunRow], suite: Mapping[str, Any], unknown: Sequence[str]) -> _Runs:
        """The runs of a suite in a folder, given its rows; `unknown` are folders of evaluations that are not read."""
        conditions = [condition["name"] for condition in suite.get("conditions", [])]
        versions = self.attempt(folder / "versions.json", lambda: read_versions(folder), {})
        episodes = self.episodes(folder / "evaluation", skip=[*conditions, *unknown])
        by_condition = {name: self.episodes(folder / "evaluation" / name) for name in conditions}
        sources = {} if not versions else read_sources(folder)
        return _Runs(rows, episodes, by_condition, self.training(folder, rows, suite), versions, sources)

    def episodes(self, folder: Path, skip: Sequence[str] = ()) -> list[Episode]:
        """The episodes of all files in a folder, except for folders in it named in `skip`."""
        paths = [path for path in without_temporaries(folder.glob("*")) if path.name not in skip]
        return [row for path in paths for row in self.attempt(path, lambda path=path: _read_evaluation(path), [])]

    def training(self, folder: Path, rows: Sequence[RunRow], suite: Mapping[str, Any]) -> list[TrainingLog]:
        """The training logs of the last stages of the runs, as far as they got."""
        earlier = {arm["name"]: training_steps(arm) - arm["steps"] for arm in arms_of(suite)}
        logs = []
        for row in rows:
            path = training_file(folder / "runs" / row.run)
            is_due = row.status == "finished" and folder == self.folder
            if row.kind == "train" and (path.exists() or is_due):
                before = earlier.get(row.algorithm, 0)
                read = partial(read_training, path, row, before)
                logs.append(self.attempt(path, read, None))
        return [log for log in logs if log is not None]

    def line(self, path: Path) -> str:
        """The content of a file of one line."""

        def read() -> str:
            try:
                return path.read_text(encoding="utf-8").strip()
            except UnicodeDecodeError as error:
                raise ResultsError(f"{path.name} is not text: {error}") from error

        return self.attempt(path, read, "")

    def films(self, results: Results) -> dict[str, Film]:
        """The films that exist or failed, by name: that of the best flight, then those of each policy.

        The caption of a film says so if its flight is outdated, or not among the results.
        """
        flights: dict[str, list[Episode]] = defaultdict(list)
        for row in results.episodes:
            flights[row.algorithm.partition(" (")[0]].append(row)
        shown = {MAIN_FILM: results.episodes}
        for policy in dict.fromkeys(name.partition(" (")[0] for name in results.policies):
            shown |= {f"{FILMS}/{policy}-{kind}": flights[policy] for kind in KINDS}
        found = {}
        for name, candidates in shown.items():
            files = FilmFiles.of(self.folder, name)
            # A path that is too long for the system raises an error in `Path.exists`.
            if exists(files.film) and exists(files.caption):
                words = self.line(files.caption)
                words += _label_of_film(words, candidates, results.outdated)
                found[name] = Film(files.film, words, files.poster if exists(files.poster) else None)
            elif exists(files.failure):
                found[name] = Film(None, self.line(files.failure))
            elif exists(files.film):
                self.skipped.append(f"{name}.mp4: there is no {name}.txt that says what it shows")
        return found


def _label_of_film(caption: str, candidates: Sequence[Episode], outdated: Mapping[str, OutdatedPolicy]) -> str:
    """A sentence about a film whose flight, one of the candidates, is outdated or no longer there; empty for others."""
    found = [row.algorithm for row in candidates if flight_in_words(row) in caption]
    if any(name not in outdated for name in found):
        return ""
    return f" Outdated: {outdated[found[0]].versions}." if found else " This flight is no longer among the results."


def _read_evaluation(path: Path) -> list[Episode]:
    """The episodes of a file; raises `ResultsError` unless its name agrees with its content."""
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
