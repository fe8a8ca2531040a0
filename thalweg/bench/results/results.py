"""Contents of a results folder, and the layout of its files; `reading` reads them.

suite.json                    the suite as it was run, with library versions and the machine
runs.csv                      one row per run; failed ones with their error
versions.json                 the versions that each run was made with
runs/PPO-0/                   the folder of a training run; its `episodes.csv` gives the training curves, or, where
                              that is not kept, its `curve.csv`, which has them in blocks of episodes
evaluation/PPO-0-Easy.csv     one row per evaluated episode
evaluation/unseen/...         the same under a condition other than the main one
outdated/                     runs with other versions, until they have been run again; laid out like this folder
logs/PPO-0.txt                what a run in a process of its own printed
film.mp4, film.txt            a flight, and its caption; film-error.txt instead if filming failed
films/PPO-best.mp4, ...       the same for the best flight and the typical failure of each trained policy
report/                       the report, made from the files above alone
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from thalweg.algos.registry import version_of
from thalweg.bench.csv_files import ResultsError, csv_text, finite, read_csv
from thalweg.bench.evaluate.conditions import Trial
from thalweg.bench.evaluate.episodes import ALL_REASONS, FIRST_COST, REASON_TEXT, REASONS, Episode
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.results.run_versions import Sources, Versions, some_critics_are_asymmetric
from thalweg.bench.results.statistics import TrainingLog
from thalweg.bench.suite.names import MOST_CHARACTERS
from thalweg.bench.suite.record import arms_of, flown_levels, observation_of, seeds_of_flown, stages_of
from thalweg.core.atomic_io import write_atomic
from thalweg.train.observations import PRIVILEGED, SEEN_BY_CRITICS

RUN_COLUMNS = ("run", "kind", "algorithm", "seed", "steps", "status", "error", "wall_s", "steps_per_s")
MAIN_FILM, FILMS = "film", "films"
"""Name of the film of the best flight, and folder of the films of each policy."""
MAIN_FILE = f"{MAIN_FILM}.mp4"
POSTER = ".jpg"
"""Ending of the picture that stands for a film."""
KINDS = ("best", "failure")
"""Endings of the names of a policy's films: its best flight and its typical failure."""


@dataclass(frozen=True)
class FilmFiles:
    """Paths of the files of a film."""

    film: Path
    caption: Path
    """Caption of the film."""
    failure: Path
    """The reason why there is no film."""
    poster: Path
    """The picture that stands for the film until it is played."""

    @classmethod
    def of(cls, folder: Path, name: str) -> "FilmFiles":
        """Return the paths for a film's name in a results folder."""
        return cls(
            folder / f"{name}.mp4", folder / f"{name}.txt", folder / f"{name}-error.txt", folder / f"{name}{POSTER}"
        )

    @property
    def paths(self) -> tuple[Path, ...]:
        return self.film, self.caption, self.failure, self.poster


@dataclass(frozen=True)
class Film:
    """A film of a results folder, or the reason why there is none."""

    path: Path | None
    """None if there is no film."""
    words: str
    """Caption of the film, or the reason why there is none."""
    poster: Path | None = None
    """The picture that stands for the film; None for films of earlier versions."""


def flight_in_words(row: Episode) -> str:
    """Return which flight a film shows, a part of its caption by which the flight is found again among results."""
    return (
        f" on {row.level}, start {row.episode} of the list: {row.length} steps, return {row.return_:.2f}, cost"
        f" {row.cost:.1f}, {REASON_TEXT[row.reason]}."
    )


@dataclass(frozen=True)
class RunRow:
    """The outcome of one run."""

    run: str
    kind: str
    algorithm: str
    seed: int
    steps: int
    """Steps of training, over all stages."""
    status: str
    """`finished`, `failed`, or `absent`: a packaged policy that this copy lacks."""
    error: str = ""
    """One line, empty for a finished run."""
    wall_s: float = 0.0
    """Seconds of training, over all sessions and stages."""
    steps_per_s: float = 0.0


@dataclass(frozen=True)
class OutdatedPolicy:
    """A policy whose runs were made with versions other than the current ones."""

    policy: str
    """The name that its runs have in the suite."""
    versions: str
    """The versions that differ from the current ones, such as `render 1, PPO 1`."""

    @property
    def name(self) -> str:
        """The name of its runs in results: never that of runs with current versions, so that they are not mixed."""
        return f"{self.policy} ({self.versions})"

    def run(self, seed: int) -> str:
        """Return the name in results of its run with a seed."""
        return f"{self.policy}-{seed} ({self.versions})"


@dataclass(frozen=True)
class Results:
    """The content of a results folder."""

    folder: Path
    suite: dict
    """Content of `suite.json`; empty if it could not be read."""
    runs: list[RunRow]
    episodes: list[Episode]
    training: list[TrainingLog]
    skipped: list[str]
    """One line for each file that was not used: its name and the reason."""
    films: dict[str, Film] = field(default_factory=dict)
    """Films by name: `MAIN_FILM`, then two for each policy, as far as they exist or failed."""
    condition_episodes: dict[str, list[Episode]] = field(default_factory=dict)
    """Episodes under each condition other than the main one, in the order of the suite."""
    outdated: dict[str, OutdatedPolicy] = field(default_factory=dict)
    """Policies with other versions, by the names that their runs and episodes have here."""
    versions: dict[str, Versions] = field(default_factory=dict)
    """Versions of each run by its name here (`runs_of`), as far as they are recorded, see
    `thalweg.bench.results.run_versions`."""
    sources: dict[str, Sources] = field(default_factory=dict)
    """Hashes of the sources of the plug-ins that each run was made with; no entry for runs of the package alone."""

    @property
    def levels(self) -> list[str]:
        """Levels in the order of the suite, then of appearance."""
        return list(dict.fromkeys([*self.suite.get("test_levels", []), *(row.level for row in self.episodes)]))

    @property
    def hard(self) -> bool:
        """Whether the first cost of the task ended episodes, or would have (`EnvConfig.hard`)."""
        return bool(self.suite.get("hard")) or any(row.reason == FIRST_COST for row in self.episodes)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for the ends of episodes that tables and figures count: `FIRST_COST` in the hard mode only."""
        return ALL_REASONS if self.hard else REASONS

    @property
    def policies(self) -> list[str]:
        """Every policy, flown or not: in the order of the runs, then those of the suite that have not started.

        A policy that is in the results only with other versions is listed with these.
        """
        started = [row.algorithm for row in self.runs]
        flown = [row.algorithm for rows in (self.episodes, *self.condition_episodes.values()) for row in rows]
        replaced = {policy.policy for policy in self.outdated.values()} - {*started, *flown}
        planned = [arm["name"] for arm in arms_of(self.suite) if arm["name"] not in replaced]
        return list(dict.fromkeys([*started, *planned, *flown]))

    @property
    def planned_flights(self) -> set[tuple[str, str, int, str]]:
        """Condition, policy, seed and level of each evaluation that the suite asks for, except for failed runs."""
        suite = self.suite
        baselines = [(name, 0) for name in suite.get("baselines", [])]
        flown = [(PACKAGED, 0)] if suite.get("packaged") else []
        flown += [(policy["name"], seed) for policy in suite.get("policies", []) for seed in seeds_of_flown(policy)]
        flown += [(arm["name"], seed) for arm in arms_of(suite) for seed in arm["seeds"]]
        failed = {(row.algorithm, row.seed) for row in self.runs if row.status != "finished"}
        main = {"name": "", "blind": True, "levels": [], "rivers": []}
        privileged = self.privileged | {
            policy["name"] for policy in suite.get("policies", []) if policy["observation"] == PRIVILEGED
        }
        return {
            (condition["name"], name, seed, level)
            for condition in (main, *suite.get("conditions", []))
            for name, seed in [*flown, *(baselines if condition["blind"] and not condition.get("shield") else [])]
            if not ((condition.get("varied") or condition.get("shield")) and name in privileged)
            for level in flown_levels(suite, condition)
            if (name, seed) not in failed
        }

    @property
    def observations(self) -> dict[str, str]:
        """What the policies of each arm see, by the arm's name, see `thalweg.train.observations.IN_WORDS`."""
        return {arm["name"]: observation_of(self.suite, arm) for arm in arms_of(self.suite)}

    @property
    def privileged(self) -> set[str]:
        """Names of the arms whose policies see the privileged observation instead of frames."""
        return {name for name, seen in self.observations.items() if seen == PRIVILEGED}

    @property
    def with_asymmetric_critics(self) -> list[str]:
        """Names of the arms of which critics see the privileged state in some stage, whatever their policies see.

        Arms that are in the results only with other versions are left out: their defaults may have been others.
        """
        replaced = {policy.policy for policy in self.outdated.values()} - {row.algorithm for row in self.runs}
        return [
            arm["name"]
            for arm in arms_of(self.suite)
            if arm["name"] not in replaced and self._has_asymmetric_critics(arm)
        ]

    def _has_asymmetric_critics(self, arm: Mapping[str, Any]) -> bool:
        """Return whether critics of an arm see the privileged state, by the versions that its runs recorded.

        Those of a policy that sees the privileged observation say nothing of its critics. Then, and without records,
        the settings decide, if the algorithm has the version of today.
        """
        by_settings = some_critics_are_asymmetric(stages_of(arm))
        recorded = [self.versions.get(f"{arm['name']}-{seed}") for seed in arm["seeds"]]
        recorded = [each for each in recorded if each is not None]
        if recorded and arm["name"] not in self.privileged:
            return any("privileged" in each for each in recorded)
        return by_settings and all(each.get(arm["algorithm"]) == version_of(arm["algorithm"]) for each in recorded)

    def critics_see(self, policy: str) -> str:
        """Return what critics of a policy saw in training, see `SEEN_BY_CRITICS`; `none` for one that was not trained.

        Of a policy with other versions, whose defaults may have been others, it is what its runs recorded, or `unknown`
        where records tell nothing: if there are none, or if it sees the privileged observation itself. An arm that has
        been run with other versions alone has their answer.
        """
        name = self.outdated[policy].policy if policy in self.outdated else policy
        arm = next((arm for arm in arms_of(self.suite) if arm["name"] == name), None)
        if arm is None:
            return "none"
        if policy not in self.outdated:
            older = {self.critics_see(each) for each, of in self.outdated.items() if of.policy == name}
            if older and not self._is_run(name):
                return older.pop() if len(older) == 1 else "unknown"
            return SEEN_BY_CRITICS[name in self.with_asymmetric_critics]
        records = [self.versions[run] for run in self.runs_of(policy) if run in self.versions]
        if name in self.privileged or not records:
            return "unknown"
        return SEEN_BY_CRITICS[any("privileged" in record for record in records)]

    @property
    def flights(self) -> set[tuple[str, str, int, str]]:
        """Condition, policy, seed and level of each evaluation in the results."""
        every = {"": self.episodes, **self.condition_episodes}
        return {(name, row.algorithm, row.seed, row.level) for name, rows in every.items() for row in rows}

    def _is_run(self, policy: str) -> bool:
        """Return whether a policy has been run, under just that name."""
        return policy in {row.algorithm for row in self.runs}

    def _seeds_of(self, name: str) -> Sequence[int]:
        """Return the seeds that the suite asks for of a policy: those of its arm, or the places of its files; 0 of
        another one."""
        planned = {each["name"]: seeds_of_flown(each) for each in self.suite.get("policies", [])}
        return (planned | {arm["name"]: arm["seeds"] for arm in arms_of(self.suite)}).get(name, [0])

    def runs_of(self, policy: str) -> list[str]:
        """Return the names of the runs of a policy with all seeds that the suite asks for."""
        old = self.outdated.get(policy)
        name = policy if old is None else old.policy
        return [f"{name}-{seed}" if old is None else old.run(seed) for seed in self._seeds_of(name)]

    def made_by(self, policy: str) -> str:
        """Return version and source of all plug-ins and functions that the runs of a policy were made with; empty for
        the package alone. Those of an arm that has been run with other versions alone are theirs."""
        found: dict[str, None] = {}
        older = [] if self._is_run(policy) else [each for each, of in self.outdated.items() if of.policy == policy]
        for run in (run for name in (policy, *older) for run in self.runs_of(name)):
            for name, source in self.sources.get(run, {}).items():
                found[f"{name} {self.versions.get(run, {}).get(name)} ({source})"] = None
        return ", ".join(found)

    def planned_seeds(self, algorithm: str) -> int:
        """Return the number of seeds that the suite asks for of a policy."""
        return max(len(self._seeds_of(algorithm)), sum(row.algorithm == algorithm for row in self.runs), 1)

    @property
    def most_steps(self) -> int:
        """Steps of the longest runs of the suite; 0 if unknown."""
        return max((arm["steps"] for arm in arms_of(self.suite)), default=0)

    def gap(self, algorithm: str) -> str:
        """Return the reason why there are no episodes of a policy: `failed`, `absent`, or else `missing`."""
        statuses = {row.status for row in self.runs if row.algorithm == algorithm}
        return next((status for status in ("failed", "absent") if status in statuses), "missing")


def evaluation_path(folder: Path, run: str, trial: Trial) -> Path:
    """Return the path of the episodes of a run in a trial."""
    return folder / "evaluation" / trial.condition.name / f"{run}-{trial.level}.csv"


def write_runs(folder: Path, rows: list[RunRow]) -> None:
    """Write `runs.csv` atomically."""
    write_atomic(folder / "runs.csv", runs_text(rows))


def runs_text(rows: list[RunRow]) -> str:
    """Return the runs as CSV."""
    return csv_text(RUN_COLUMNS, [[getattr(row, name) for name in RUN_COLUMNS] for row in rows])


def read_runs(folder: Path) -> list[RunRow]:
    """Return the rows of `runs.csv`; none without such a file. Raises `ResultsError` for a file of another kind."""
    path = folder / "runs.csv"
    if not path.exists():
        return []
    try:
        return [
            RunRow(
                _run_name(row["run"]),
                row["kind"],
                row["algorithm"],
                int(row["seed"]),
                int(row["steps"]),
                row["status"],
                row["error"],
                finite(row["wall_s"]),
                finite(row["steps_per_s"]),
            )
            for row in read_csv(path, RUN_COLUMNS)
        ]
    except ValueError as error:
        raise ResultsError(f"runs.csv: {error}" if not isinstance(error, ResultsError) else str(error)) from error


def _run_name(name: str) -> str:
    """Return the name of a run; raises `ValueError` for one that cannot be that of its folder."""
    if not name or len(name) > MOST_CHARACTERS or "/" in name or "\0" in name:
        raise ValueError(f"the run {name[:40]!r} must have a name of 1 to {MOST_CHARACTERS} characters without /")
    return name
