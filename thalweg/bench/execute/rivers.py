"""Where do a suite's policies come from and fly? On our rivers, through the encoder that comes with the package.

The runner sees only `Place`, so that tests can put a small problem in its stead.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES, Policy
from thalweg.bench.evaluate.conditions import MAIN, RIVERS, Trial
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import Course, EvaluationConfig, Label, Look, Step, evaluate, through_encoder
from thalweg.bench.pictures.film_format import FilmFormat
from thalweg.bench.suite.suites import Arm, Run, Stage, Suite
from thalweg.core import versions
from thalweg.encoder import Encoder
from thalweg.train import load_policy
from thalweg.train.river import RiverTraining, check_policy_fits, load_compatible_encoder

PACKAGED_POLICY = Path(__file__).with_name("flight.safetensors")
"""The best policy so far, which comes with the package."""


STAGES = ".before"
"""Folder, within a run's, of the runs that it begins with."""


def made_by() -> dict[str, int | None]:
    """Versions that the results of any suite depend on; None for a packaged policy that this copy lacks."""
    return {
        "world": versions.WORLD,
        "render": versions.RENDER,
        "rules": versions.RULES,
        "training": versions.TRAINING,
        "evaluation": versions.EVALUATION,
        "encoder": versions.PACKAGED_ENCODER,
        "packaged": versions.PACKAGED_POLICY if PACKAGED_POLICY.exists() else None,
    }


class Place(Protocol):
    """What the runner needs done."""

    def train(self, run: Run, folder: Path) -> None:
        """Train into the folder, going on from what lies there."""
        ...

    def evaluate(self, run: Run, folder: Path, trial: Trial, on_step: Callable[[Step], None]) -> list[Episode]:
        """The evaluated episodes of the run's policy in a trial."""
        ...

    def title(self, run: Run, folder: Path) -> str:
        """What the run's policy is called in front of people."""
        ...

    def film(
        self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None], *, shape: FilmFormat
    ) -> None:
        """Film an evaluated episode into `path`, in a format."""
        ...


class Rivers:
    """The real place: worlds, encoder and courses are made once and kept."""

    def __init__(self, suite: Suite) -> None:
        self.suite = suite
        self._looks: dict[str, Look] = {}

    @cached_property
    def encoder(self) -> Encoder:
        return load_compatible_encoder()

    def config(self, trial: Trial) -> EvaluationConfig:
        """How a trial is flown."""
        suite = self.suite
        return EvaluationConfig(suite.episodes, suite.starts_seed, trial.condition.deterministic)

    def courses(self, trial: Trial) -> list[Course]:
        """The rivers of a trial and the starts on each."""
        condition, level, config = trial.condition, trial.level, self.config(trial)
        if condition.unseen:
            return Course.unseen(level, config)
        real = level in condition.rivers
        course = Course.on(RIVERS[level].build(), config) if real else Course.of_level(level, config)
        return [course if condition.randomisation is None else course.varied(condition.randomisation, config)]

    def train(self, run: Run, folder: Path) -> None:
        """Train on the arm's levels, one stage after the other, seen through the encoder."""
        arm, before = self.suite.arm(run.algorithm), None
        for number, stage in enumerate(arm.before):
            place = folder / STAGES / str(number)
            self._train(stage, stage.level, run.seed, place, before)
            before = place
        self._train(arm, self.suite.level_of(arm), run.seed, folder, before)

    def _train(self, what: Stage | Arm, level: str, seed: int, folder: Path, begin_with: Path | None) -> None:
        RiverTraining(level, self.suite.num_envs).train(
            what.algorithm,
            self.encoder,
            steps=what.steps,
            seed=seed,
            folder=folder,
            settings=dict(what.settings) or None,
            preset=what.preset,
            begin_with=begin_with,
        )

    def policy(self, run: Run, folder: Path) -> Policy:
        """The run's policy."""
        if run.kind == "baseline":
            return BASELINES[run.algorithm]
        return load_policy(PACKAGED_POLICY if run.kind == "packaged" else folder)

    def looks(self, trial: Trial, courses: Sequence[Course], policy: Policy) -> list[Look] | list[None]:
        """What the policy sees on each course; None for one that sees no frames."""
        if hasattr(policy, "sees"):
            return [None] * len(courses)
        check_policy_fits(policy, self.encoder)
        if trial.condition != MAIN:
            return [through_encoder(course, self.encoder) for course in courses]
        if trial.level not in self._looks:
            self._looks[trial.level] = through_encoder(courses[0].world, self.encoder)
        return [self._looks[trial.level]]

    def evaluate(self, run: Run, folder: Path, trial: Trial, on_step: Callable[[Step], None]) -> list[Episode]:
        """The evaluated episodes of the run's policy in a trial."""
        policy, courses, rows = self.policy(run, folder), self.courses(trial), []
        label, config = Label(run.algorithm, run.seed, trial.level), self.config(trial)
        waiting = sum(len(course.starts) for course in courses)
        for course, look in zip(courses, self.looks(trial, courses, policy), strict=True):
            waiting -= len(course.starts)

            def told(step: Step, waiting: int = waiting) -> None:
                on_step(replace(step, waiting=waiting))

            rows += evaluate(policy, course, label, config, look=look, on_step=told)
        return rows

    def title(self, run: Run, folder: Path) -> str:
        """What the run's policy is called in front of people."""
        if run.kind == "baseline":
            return run.algorithm
        if run.kind == "train":
            return f"{run.algorithm}, seed {run.seed}"
        algorithm = getattr(getattr(self.policy(run, folder), "about", None), "algorithm", "")
        return f"packaged policy ({algorithm})" if algorithm else "packaged policy"

    def film(
        self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None], *, shape: FilmFormat
    ) -> None:
        """Fly an evaluated episode again and film it; raises `ResultsError` unless it is the same flight."""
        from thalweg.bench.pictures.film import Flight, write_film

        policy, trial = self.policy(run, folder), Trial(episode.level)
        (whole,) = self.courses(trial)
        course = whole.only(episode.episode)
        label = Label(run.algorithm, run.seed, episode.level)
        steps: list[Step] = []
        (look,) = self.looks(trial, [course], policy)
        (again,) = evaluate(policy, course, label, self.config(trial), look=look, on_step=steps.append)
        _require_same(again, episode)
        title = self.title(run, folder)
        write_film(path, course.world, Flight.from_steps(again, steps), title, shape=shape, on_frame=on_frame)


def _require_same(again: Episode, row: Episode) -> None:
    """Raise `ResultsError` that names each value in which a flight flown again differs from its row."""
    differing = [
        f"{field.name.rstrip('_')} {getattr(again, field.name)!r} now, {getattr(row, field.name)!r} in the results"
        for field in fields(Episode)
        if getattr(again, field.name) != getattr(row, field.name)
    ]
    if differing:
        raise ResultsError(f"flown again, start {row.episode} on {row.level} differs: {'; '.join(differing)}")
