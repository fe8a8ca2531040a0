"""Where do a suite's policies come from and fly? On our rivers, through the encoder that comes with the package.

The runner sees only `Place`, so that tests can put a small problem in its stead.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

from thalweg.bench.baselines import BASELINES, Policy
from thalweg.bench.episodes import Episode
from thalweg.bench.evaluation import Course, EvaluationConfig, Label, Look, Step, evaluate, through_encoder
from thalweg.bench.files import ResultsError
from thalweg.bench.suites import Run, Suite
from thalweg.encoder import Encoder, check_render_version, load_encoder
from thalweg.env import RiverVectorEnv
from thalweg.render import RENDER_VERSION
from thalweg.train import RunResult, load_policy, run
from thalweg.train.latent import LatentVectorEnv
from thalweg.world import level_named, load_or_build

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


def load_fitting_encoder(path: Path | None = None) -> Encoder:
    """An encoder that was trained on frames as this renderer draws them; raises the encoder's own errors."""
    encoder = load_encoder(path)
    check_render_version(encoder, RENDER_VERSION)
    return encoder


def mark(encoder: Encoder) -> str:
    """What tells an encoder from every other: a hash of its file."""
    return hashlib.sha256(Path(encoder.about["path"]).read_bytes()).hexdigest()[:16]


def check_sees_as_trained(policy: Policy, encoder: Encoder) -> None:
    """Raise `ResultsError` if the policy learnt from the codes of another encoder."""
    learnt = getattr(getattr(policy, "about", None), "context", {}).get("encoder")
    if learnt is not None and learnt != mark(encoder):
        raise ResultsError(
            f"the policy was trained on the codes of encoder {learnt}, but this is encoder {mark(encoder)};"
            " give the encoder that it was trained with"
        )


@dataclass(frozen=True)
class TrainingGround:
    """Where a policy is trained."""

    level: str
    num_envs: int
    world_seeds: tuple[int, ...] = ()
    """Rivers of the level; its fixed one if none is given."""

    def train(
        self, algorithm: str, encoder: Encoder, *, steps: int, seed: int, folder: Path, settings: dict | None = None
    ) -> RunResult:
        """Train with a progress bar, going on from what lies in the folder."""
        level = level_named(self.level)
        seeds = self.world_seeds or (level.default_seed,)
        context = {
            "level": level.name,
            "world_seeds": list(seeds),
            "encoder": mark(encoder),
            "render_version": RENDER_VERSION,
        }
        worlds = [load_or_build(level, number) for number in seeds]
        env = LatentVectorEnv(RiverVectorEnv(worlds, self.num_envs), encoder)
        try:
            return run(
                algorithm, env, steps=steps, seed=seed, folder=folder, config=settings, context=context, progress=True
            )
        finally:
            env.close()


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
