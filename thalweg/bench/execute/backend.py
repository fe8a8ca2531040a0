"""Backends that train and fly the policies of a suite: the protocol, and the rivers.

The runner sees only `Backend`, so that tests can replace the rivers by a small problem.
"""

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Protocol

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES, DRAWN, Policy, RecurrentPolicy, sight_of
from thalweg.bench.evaluate.conditions import MAIN, Trial
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import Episode
from thalweg.bench.evaluate.evaluation import Label, Observe, Step, evaluate, observation_function
from thalweg.bench.evaluate.shielded import FlightShield, check_masks
from thalweg.bench.packaged import PACKAGED_POLICY
from thalweg.bench.pictures.film_format import FilmFormat
from thalweg.bench.suite.arms import Arm, Run, Stage
from thalweg.bench.suite.config import Suite
from thalweg.core import versions
from thalweg.encoder import Encoder
from thalweg.render import Camera
from thalweg.train import load_policy
from thalweg.train.observations import FRAMES, camera_of, check_policy_fits, observation_of
from thalweg.train.river import RiverTraining, announce_build, load_compatible_encoder

STAGES = ".before"
"""Folder within a run's folder that holds the runs of earlier stages."""


def installed_versions() -> dict[str, int | None]:
    """Return all versions that results can depend on; None for a packaged policy that this copy lacks."""
    return {
        "world": versions.WORLD,
        "banks": versions.BANKS,
        "render": versions.RENDER,
        "rules": versions.RULES,
        "tasks": versions.TASKS,
        "deadlines": versions.DEADLINES,
        "props": versions.PROPS,
        "forces": versions.FORCES,
        "privileged": versions.PRIVILEGED,
        "training": versions.TRAINING,
        "evaluation": versions.EVALUATION,
        "steady": versions.STEADY,
        "shield": versions.SHIELD,
        "encoder": versions.PACKAGED_ENCODER,
        "geometry": versions.PACKAGED_GEOMETRY,
        "geometry-tasks": versions.PACKAGED_GEOMETRY_TASKS,
        "packaged": versions.PACKAGED_POLICY if PACKAGED_POLICY.exists() else None,
        **versions.ALGORITHMS,
    }


class Backend(Protocol):
    """Trains, flies and films the policies of a suite's runs."""

    def train(self, run: Run, folder: Path) -> None:
        """Train the run's policy into the folder, resuming what lies there."""
        ...

    def evaluate(self, run: Run, folder: Path, trial: Trial, on_step: Callable[[Step], None]) -> list[Episode]:
        """Return the evaluated episodes of the run's policy in a trial."""
        ...

    def title(self, run: Run, folder: Path) -> str:
        """Return the name of the run's policy for people."""
        ...

    def film(
        self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None], *, shape: FilmFormat
    ) -> None:
        """Film an evaluated episode into `path`, in a format."""
        ...


class RiverBackend:
    """Trains on rivers, seen through a packaged encoder or by the privileged observation, and flies on them, also by
    policies that see images.

    An encoder is loaded when its codes are first seen; it and the main views are loaded once. To other processes and
    machines the suite alone travels, and each loads what it needs.
    """

    def __init__(self, suite: Suite) -> None:
        self.suite = suite
        self._observers: dict[tuple[str, str, Camera, str], Observe | None] = {}
        self._encoders: dict[str, Encoder] = {}

    def __reduce__(self) -> tuple[type["RiverBackend"], tuple[Suite]]:
        """Return how to make the backend anew: tensors of compiled encoders cannot be pickled, and drawn rivers are
        large."""
        return type(self), (self.suite,)

    def encoder(self, run: Run) -> Encoder:
        """Return the encoder whose codes a run's policy sees."""
        name = self.suite.encoder_of(run)
        if name not in self._encoders:
            self._encoders[name] = load_compatible_encoder(name)
        return self._encoders[name]

    def config(self, trial: Trial) -> EvaluationConfig:
        """Return the configuration of a trial's evaluation."""
        suite, rules = self.suite, self.suite.rules.with_options(observation="none")
        return EvaluationConfig(suite.episodes, suite.starts_seed, trial.condition.deterministic, rules)

    def courses(self, trial: Trial, *, drawn: bool = True) -> Iterator[Course]:
        """Yield the rivers of a trial and the starts on each, `episodes` together; levels' rivers without land if
        nothing is `drawn`. Each is made when its turn comes."""
        condition, level, config = trial.condition, trial.level, self.config(trial)
        if condition.unseen:
            yield from Course.unseen(level, config, drawn=drawn)
            return
        ground = condition.river(level) if level in condition.rivers else self.suite.ground(level)
        if isinstance(ground, str):
            course = Course.of_level(ground, config, drawn=drawn)
        else:
            announce_build(ground, 0)
            course = Course.on(ground.build(), config)
        yield course if condition.randomisation is None else course.varied(condition.randomisation, config)

    def train(self, run: Run, folder: Path) -> None:
        """Train on the arm's levels, one stage after another."""
        arm = self.suite.arm(run.algorithm)
        before = None if arm.begin_with is None else arm.begin_with.unchanged().path
        for number, stage in enumerate(arm.before):
            stage_folder = folder / STAGES / str(number)
            self._train(run, stage, self.suite.level_of(stage), stage_folder, before)
            before = stage_folder
        self._train(run, arm, self.suite.level_of(arm), folder, before)

    def _train(self, run: Run, stage: Stage | Arm, level: str, folder: Path, begin_with: Path | None) -> None:
        seeds, seen = self.suite.seeds_of(self.suite.arm(run.algorithm), stage), self.suite.observation_of(run)
        RiverTraining(self.suite.ground(level), self.suite.num_envs, seeds, self.suite.training_rules).train(
            stage.algorithm,
            self.encoder(run) if seen == FRAMES else None,
            observation=seen,
            steps=stage.steps,
            seed=run.seed,
            folder=folder,
            settings=dict(stage.settings) or None,
            preset=stage.preset,
            begin_with=begin_with,
        )

    def policy(self, run: Run, folder: Path) -> Policy | RecurrentPolicy:
        """Return the run's policy."""
        if run.kind == "baseline":
            return BASELINES[run.algorithm]
        if run.kind == "function":
            return self.suite.function(run.algorithm).policy
        if run.kind == "policy":
            return self.suite.policy_file(run).unchanged().policy
        return load_policy(PACKAGED_POLICY if run.kind == "packaged" else folder)

    def observer(self, run: Run, trial: Trial, course: Course, policy: Policy | RecurrentPolicy) -> Observe | None:
        """Return the observation function for a course; None for a policy for which nothing is drawn."""
        sees = sight_of(policy)
        encoder = self.encoder(run) if sees == "frames" else None
        rules = self.suite.rules
        check_policy_fits(policy, encoder, task=rules.task, action=rules.action, dynamics=rules.dynamics)
        shielded = trial.condition.shield
        if shielded:
            check_masks(policy, encoder)
        if trial.condition != MAIN or sees not in DRAWN:
            return observation_function(policy, course, encoder, shielded=shielded)
        view = (
            trial.level,
            observation_of(policy),
            camera_of(policy),
            "" if encoder is None else self.suite.encoder_of(run),
        )
        if view not in self._observers:
            self._observers[view] = observation_function(policy, course.world, encoder)
        return self._observers[view]

    def evaluate(self, run: Run, folder: Path, trial: Trial, on_step: Callable[[Step], None]) -> list[Episode]:
        """Return the evaluated episodes of the run's policy in a trial."""
        policy, rows = self.policy(run, folder), []
        shielded = trial.condition.shield
        courses = self.courses(trial, drawn=shielded or sight_of(policy) in DRAWN)
        label, config = Label(run.algorithm, run.seed, trial.level), self.config(trial)
        # The shield reads the masks of the policy's frames, which are those of the camera of its training.
        config = replace(config, env=config.env.with_options(camera=camera_of(policy))) if shielded else config
        waiting = config.episodes
        for course in courses:
            observe = self.observer(run, trial, course, policy)
            waiting -= len(course.starts)

            def report(step: Step, waiting: int = waiting) -> None:
                on_step(replace(step, waiting=waiting))

            shield = FlightShield() if shielded else None
            rows += evaluate(policy, course, label, config, observe=observe, on_step=report, shield=shield)
        return rows

    def title(self, run: Run, folder: Path) -> str:
        """Return the name of the run's policy for people."""
        if run.kind in ("baseline", "function"):
            return run.algorithm
        if run.kind in ("train", "policy"):
            return f"{run.algorithm}, seed {run.seed}"
        algorithm = getattr(getattr(self.policy(run, folder), "about", None), "algorithm", "")
        return f"packaged policy ({algorithm})" if algorithm else "packaged policy"

    def film(
        self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None], *, shape: FilmFormat
    ) -> None:
        """Repeat an evaluated episode and film it; raises `ResultsError` unless the flight is the same."""
        from thalweg.bench.pictures.film import Flight, write_film

        policy, trial = self.policy(run, folder), Trial(episode.level)
        (full_course,) = self.courses(trial)
        course = full_course.only(episode.episode)
        label = Label(run.algorithm, run.seed, episode.level)
        steps: list[Step] = []
        observe = self.observer(run, trial, course, policy)
        (repeated,) = evaluate(policy, course, label, self.config(trial), observe=observe, on_step=steps.append)
        _require_same(repeated, episode)
        title = self.title(run, folder)
        write_film(path, course.world, Flight.from_steps(repeated, steps), title, shape=shape, on_frame=on_frame)


def _require_same(repeated: Episode, row: Episode) -> None:
    """Raise `ResultsError` that names each value in which a repeated flight differs from its row."""
    differing = [
        f"{field.name.rstrip('_')} {getattr(repeated, field.name)!r} now, {getattr(row, field.name)!r} in the results"
        for field in fields(Episode)
        if getattr(repeated, field.name) != getattr(row, field.name)
    ]
    if differing:
        raise ResultsError(f"flown again, start {row.episode} on {row.level} differs: {'; '.join(differing)}")
