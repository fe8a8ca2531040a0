"""Where do a suite's policies come from and fly? On our rivers, through the encoder that comes with the package.

The runner sees only `Place`, so that tests can put a small problem in its stead.
"""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Protocol

from thalweg.bench.baselines import BASELINES, Policy
from thalweg.bench.episodes import Episode
from thalweg.bench.evaluation import Course, EvaluationConfig, Label, Look, Step, evaluate, through_encoder
from thalweg.bench.suites import Run, Suite
from thalweg.encoder import Encoder
from thalweg.train import load_policy
from thalweg.train.river import TrainingGround, check_sees_as_trained, load_fitting_encoder

PACKAGED_POLICY = Path(__file__).with_name("flight.safetensors")
"""The best policy so far, which comes with the package."""


class Place(Protocol):
    """What the runner needs done."""

    def train(self, run: Run, folder: Path) -> None:
        """Train into the folder, going on from what lies there."""
        ...

    def evaluate(self, run: Run, folder: Path, level: str, on_step: Callable[[Step], None]) -> list[Episode]:
        """The evaluated episodes of the run's policy on a level."""
        ...

    def film(self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None]) -> str:
        """Film an evaluated episode into `path`; returns the caption."""
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
        ground = TrainingGround(self.suite.train_level, self.suite.num_envs)
        ground.train(
            run.algorithm,
            self.encoder,
            steps=self.suite.steps,
            seed=run.seed,
            folder=folder,
            settings=self.suite.settings or None,
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

    def film(self, run: Run, folder: Path, episode: Episode, path: Path, on_frame: Callable[[], None]) -> str:
        """Fly an evaluated episode again and film it."""
        from thalweg.bench.film import Flight, write_film

        policy = self.policy(run, folder)
        course = self.course(episode.level).only(episode.episode)
        label = Label(run.algorithm, run.seed, episode.level)
        steps: list[Step] = []
        look = self.look(episode.level, policy)
        (again,) = evaluate(policy, course, label, self.config, look=look, on_step=steps.append)
        write_film(path, course.world, Flight.of(again, steps), _title(run, policy), on_frame=on_frame)
        return (
            f"{_title(run, policy)} on {again.level}, start {again.episode} of the list: {again.length} steps, "
            f"return {again.return_:.2f}, cost {again.cost:.1f}, {again.reason}."
        )


def _title(run: Run, policy: Policy) -> str:
    if run.kind == "packaged":
        algorithm = getattr(getattr(policy, "about", None), "algorithm", "")
        return f"packaged policy ({algorithm})" if algorithm else "packaged policy"
    return run.algorithm if run.kind == "baseline" else f"{run.algorithm}, seed {run.seed}"
