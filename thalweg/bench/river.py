"""Where do a suite's policies come from and fly? On our rivers, through the encoder that comes with the package.

The runner sees only `Place`, so that tests can put a small problem in its stead.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Protocol

from thalweg.bench.baselines import BASELINES, Policy
from thalweg.bench.episodes import Episode
from thalweg.bench.evaluation import Course, EvaluationConfig, Label, Look, Step, evaluate, through_encoder
from thalweg.bench.files import ResultsError
from thalweg.bench.suites import Run, Suite
from thalweg.cache import file_mark, source_hash
from thalweg.encoder import DEFAULT_PATH, Encoder
from thalweg.train import load_policy
from thalweg.train.river import TrainingGround, check_sees_as_trained, load_fitting_encoder

PACKAGED_POLICY = Path(__file__).with_name("flight.safetensors")
"""The best policy so far, which comes with the package."""


SOURCES = ("world", "render", "env", "algos", "train", "encoder", "kernel.py", "bench/evaluation.py")
"""Parts of the package that the episodes of a suite depend on."""


def made_by() -> dict[str, str | None]:
    """What the results of a suite depend on beside the suite: marks of the code, of the encoder and of the packaged
    policy, None where there is no such policy."""
    return {
        "source": source_hash(*SOURCES),
        "encoder": file_mark(DEFAULT_PATH),
        "packaged": file_mark(PACKAGED_POLICY) if PACKAGED_POLICY.exists() else None,
    }


class Place(Protocol):
    """What the runner needs done."""

    def train(self, run: Run, folder: Path) -> None:
        """Train into the folder, going on from what lies there."""
        ...

    def evaluate(self, run: Run, folder: Path, level: str, on_step: Callable[[Step], None]) -> list[Episode]:
        """The evaluated episodes of the run's policy on a level."""
        ...

    def title(self, run: Run, folder: Path) -> str:
        """What the run's policy is called in front of people."""
        ...

    def film(self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None]) -> None:
        """Film an evaluated episode into `path`."""
        ...


class Rivers:
    """The real place: worlds, encoder and courses are made once and kept."""

    def __init__(self, suite: Suite) -> None:
        self.suite = suite
        self.config = EvaluationConfig(episodes=suite.episodes, starts_seed=suite.starts_seed)
        self._courses: dict[str, Course] = {}
        self._looks: dict[str, Look] = {}

    @cached_property
    def encoder(self) -> Encoder:
        return load_fitting_encoder()

    def course(self, level: str) -> Course:
        """The level's river and starts."""
        if level not in self._courses:
            self._courses[level] = Course.of_level(level, self.config)
        return self._courses[level]

    def train(self, run: Run, folder: Path) -> None:
        """Train on the level's fixed river, seen through the encoder."""
        arm = self.suite.arm(run.algorithm)
        ground = TrainingGround(self.suite.train_level, self.suite.num_envs)
        ground.train(
            arm.algorithm,
            self.encoder,
            steps=arm.steps,
            seed=run.seed,
            folder=folder,
            settings=dict(arm.settings) or None,
            preset=arm.preset,
        )

    def policy(self, run: Run, folder: Path) -> Policy:
        """The run's policy."""
        if run.kind == "baseline":
            return BASELINES[run.algorithm]
        return load_policy(PACKAGED_POLICY if run.kind == "packaged" else folder)

    def look(self, level: str, policy: Policy) -> Look | None:
        """What the policy sees on the level; None for one that sees no frames."""
        if hasattr(policy, "sees"):
            return None
        check_sees_as_trained(policy, self.encoder)
        if level not in self._looks:
            self._looks[level] = through_encoder(self.course(level).world, self.encoder)
        return self._looks[level]

    def evaluate(self, run: Run, folder: Path, level: str, on_step: Callable[[Step], None]) -> list[Episode]:
        """The evaluated episodes of the run's policy on a level."""
        policy = self.policy(run, folder)
        label = Label(run.algorithm, run.seed, level)
        return evaluate(policy, self.course(level), label, self.config, look=self.look(level, policy), on_step=on_step)

    def title(self, run: Run, folder: Path) -> str:
        """What the run's policy is called in front of people."""
        if run.kind == "baseline":
            return run.algorithm
        if run.kind == "train":
            return f"{run.algorithm}, seed {run.seed}"
        algorithm = getattr(getattr(self.policy(run, folder), "about", None), "algorithm", "")
        return f"packaged policy ({algorithm})" if algorithm else "packaged policy"

    def film(self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None]) -> None:
        """Fly an evaluated episode again and film it; raises `ResultsError` unless it is the same flight."""
        from thalweg.bench.film import Flight, write_film

        policy = self.policy(run, folder)
        course = self.course(episode.level).only(episode.episode)
        label = Label(run.algorithm, run.seed, episode.level)
        steps: list[Step] = []
        look = self.look(episode.level, policy)
        (again,) = evaluate(policy, course, label, self.config, look=look, on_step=steps.append)
        _require_same(again, episode)
        write_film(path, course.world, Flight.of(again, steps), self.title(run, folder), on_frame=on_frame)


def _require_same(again: Episode, row: Episode) -> None:
    """Raise `ResultsError` that names each value in which a flight flown again differs from its row."""
    differing = [
        f"{field.name.rstrip('_')} {getattr(again, field.name)!r} now, {getattr(row, field.name)!r} in the results"
        for field in fields(Episode)
        if getattr(again, field.name) != getattr(row, field.name)
    ]
    if differing:
        raise ResultsError(f"flown again, start {row.episode} on {row.level} differs: {'; '.join(differing)}")
