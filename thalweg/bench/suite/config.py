"""Config of a suite: what is trained with which seeds, and how the policies are evaluated.

A suite is checked when it is constructed, see `thalweg.bench.suite.checks`.
"""

from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ValidationInfo, model_validator

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.conditions import CONDITIONS, MAIN, SHIELDED, Condition, Trial
from thalweg.bench.evaluate.rivers import (
    RIVERS,
    Files,
    reaches_of,
    recorded_reach,
)
from thalweg.bench.packaged import PACKAGED
from thalweg.bench.suite.arms import (
    Arm,
    Count,
    EncoderName,
    Observation,
    RiverSeeds,
    Run,
    Seed,
    Stage,
    seeds_as_data,
    without,
)
from thalweg.bench.suite.checks import check_suite
from thalweg.bench.suite.flown import Flown, Function, SavedPolicy, flown
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.bench.suite.views import TrainingViews
from thalweg.core.config import TupleOf, frozen_config, to_plain
from thalweg.env.config import EnvConfig
from thalweg.env.forces.options import ForceOptions
from thalweg.world import Reach


def _film(value: Any) -> Any:
    """Return `none` for false, and any other value unchanged."""
    return "none" if value is False else value


Film = Annotated[Literal["packaged", "best", "none"], BeforeValidator(_film)]
"""Which flight the main film of a suite shows."""


def _condition(value: Any, info: ValidationInfo) -> Any:
    """Return the predefined condition of a name; a mapping with the files of the suite that its rivers name; other
    values unchanged."""
    if isinstance(value, Mapping) and isinstance(named := value.get("rivers"), list | tuple):
        of_suite = info.data.get("files") or {}
        own = {name: of_suite[name] for name in named if isinstance(name, str) and name in of_suite}
        files = value.get("files") or {}
        return {**value, "files": {**own, **files}} if own and isinstance(files, Mapping) else value
    known = {condition.name: condition for condition in (*CONDITIONS, SHIELDED)}
    if isinstance(value, str) and value not in known:
        raise ValueError(f"unknown condition {value!r}; known: {', '.join(known)}, or a mapping of your own")
    return known[value] if isinstance(value, str) else value


@frozen_config(ResultsError)
class Suite:
    """A benchmark as data."""

    name: str
    arms: TupleOf[Arm]
    train_level: str = "Medium"
    """Level to train on, also with other banks, such as Medium+meadow; or a real river, of `files` or the package."""
    test_levels: TupleOf[str] = ("Easy", "Medium", "Hard")
    """Levels to fly on, and real rivers."""
    episodes: Count = 20
    """Starts per level, each flown once by each policy."""
    starts_seed: Seed = 0
    """Seed of the list of starts of every level."""
    num_envs: Count = 16
    """Number of parallel environments in training."""
    baselines: TupleOf[str] = ("random", "hover", "forward", "pilot")
    """Policies that need no training."""
    policies: TupleOf[Annotated[Flown, BeforeValidator(flown)]] = ()
    """Functions and policies that were trained before, flown without training."""
    packaged: bool = True
    """Whether the policy that comes with the package is evaluated too."""
    files: Files = field(default_factory=dict)
    """Files of real rivers by the names that stand in place of a level, here and in results: `file`, its path, and
    options such as `start_m`, which are the fields of `thalweg.world.real.selection.Selection`."""
    conditions: TupleOf[Annotated[Condition, BeforeValidator(_condition)]] = ()
    """Conditions under which policies are flown, besides the main one."""
    observation: Observation = "frames"
    """What policies see that are trained, unless their arm says otherwise."""
    encoder: EncoderName = "default"
    """Encoder of the frames that they see, unless their arm says otherwise."""
    world_seeds: RiverSeeds = ()
    """Seeds of the rivers to train on, unless the arm has its own; if empty, the fixed river of the level."""
    task: str = "River"
    """Task that is trained and flown, see `thalweg.env.tasks`."""
    hard: bool = False
    """Whether the first cost of the task ends an episode; not for River."""
    forces: ForceOptions = field(default_factory=ForceOptions)
    """Wind, current and dynamics in training and flights."""
    views: TrainingViews = field(default_factory=TrainingViews)
    """Camera, quality and looks of the frames in training, and the kind of actions."""
    film: Film = "packaged"
    """Whose best flight the main film shows: that of the `packaged` policy, if it is evaluated, or the `best` trained
    one's; `none`, or false: nothing is filmed. It does not belong to the results, and may be changed."""

    @model_validator(mode="after")
    def _check(self) -> "Suite":
        check_suite(self)
        return self

    def runs(self) -> tuple[Run, ...]:
        """Return all runs in order: those without training first."""
        baselines = [Run("baseline", name, 0) for name in self.baselines]
        packaged = [Run("packaged", PACKAGED, 0)] if self.packaged else []
        trained = [Run("train", arm.label, seed) for arm in self.arms for seed in arm.seeds]
        flown = [
            Run("function" if isinstance(each, Function) else "policy", each.label, seed)
            for each in self.policies
            for seed in each.seeds
        ]
        return (*baselines, *packaged, *flown, *trained)

    def trials(self, run: Run) -> tuple[Trial, ...]:
        """Return the evaluations of a run's policy, those under the main condition first.

        A policy of the privileged observation flies under no condition that only changes the appearance, and, as
        baselines do, without a shield, which reads masks.
        """
        flies_all = run.kind != "baseline"
        conditions = [each for each in self.conditions if flies_all or (each.blind and not each.shield)]
        if self.observation_of(run) == "privileged":
            conditions = [each for each in conditions if not (each.varied or each.shield)]
        return tuple(
            Trial(level, condition)
            for condition in (MAIN, *conditions)
            for level in condition.rivers or condition.levels or self.test_levels
        )

    @property
    def rules(self) -> EnvConfig:
        """Rules of training and flights; raises `ConfigError` for what does not go together."""
        return self.forces.applied(EnvConfig(task=self.task, hard=self.hard, action=self.views.action))

    @property
    def training_rules(self) -> EnvConfig:
        """Rules of training, with what is seen in it; raises `ConfigError` for what does not go together."""
        return self.views.in_training(self.rules)

    def function(self, label: str) -> Function:
        """Return the function with a label."""
        return next(each for each in self.policies if isinstance(each, Function) and each.label == label)

    def saved(self, label: str) -> SavedPolicy:
        """Return the policy that was trained before with a label."""
        return next(each for each in self.policies if isinstance(each, SavedPolicy) and each.label == label)

    def policy_file(self, run: Run) -> PolicyFile:
        """Return the file of a run of a policy that was trained before."""
        return self.saved(run.algorithm).policy[run.seed]

    def arm(self, label: str) -> Arm:
        """Return the arm with a label."""
        return next(arm for arm in self.arms if arm.label == label)

    def plugins_of(self, run: Run) -> list[str]:
        """Return the algorithms, the encoder and the task that a run depends on; each may be a plug-in."""
        coded = self.observation_of(run) == "frames" and run.kind != "packaged"
        return [*self.algorithms_of(run), *([self.encoder_of(run)] if coded else []), self.task]

    def algorithms_of(self, run: Run) -> list[str]:
        """Return the algorithms of all stages of a run's training; none for a policy that is not trained."""
        if run.kind != "train":
            return []
        arm = self.arm(run.algorithm)
        return [stage.algorithm for stage in (*arm.before, arm)]

    @property
    def reaches(self) -> dict[str, Reach]:
        """Real rivers that may stand in place of a level, by name."""
        return {**RIVERS, **reaches_of(self.files)}

    @property
    def grounds(self) -> list[str]:
        """Names of all levels and real rivers that are trained on, or flown on in place of a level."""
        trained = [self.level_of(stage) for arm in self.arms for stage in (*arm.before, arm)]
        return list(dict.fromkeys([self.train_level, *trained, *self.test_levels]))

    @property
    def reaches_flown(self) -> dict[tuple[str, str], Reach]:
        """Real rivers that are trained on or flown on, by condition and name; the condition of those in place of levels
        is empty."""
        reaches = self.reaches
        in_place = {("", name): reaches[name] for name in self.grounds if name in reaches}
        return in_place | {(each.name, name): each.river(name) for each in self.conditions for name in each.rivers}

    def ground(self, name: str) -> str | Reach:
        """Return the real river with a name, or the name itself if it is a level's."""
        return self.reaches.get(name, name)

    def level_of(self, stage: Stage | Arm) -> str:
        """Return the level of a stage of training, or of an arm's last stage, the arm itself."""
        return stage.level or self.train_level

    def seeds_of(self, arm: Arm, stage: Stage | Arm) -> tuple[int, ...]:
        """Return the seeds of the rivers of a stage of an arm, or of its last stage, the arm itself."""
        return stage.world_seeds or arm.world_seeds or self.world_seeds

    def seen_by(self, arm: Arm) -> Observation:
        """Return what an arm's policies see."""
        return arm.observation or self.observation

    def coded_by(self, arm: Arm) -> EncoderName:
        """Return the name of the encoder of the frames of an arm, if its policies see codes."""
        return arm.encoder or self.encoder

    def observation_of(self, run: Run) -> str | None:
        """Return what a run's policy sees of rivers; None for a baseline."""
        if run.kind == "baseline":
            return None
        if run.kind == "function":
            return self.function(run.algorithm).observation
        if run.kind == "policy":
            return self.saved(run.algorithm).observation
        return "frames" if run.kind == "packaged" else self.seen_by(self.arm(run.algorithm))

    def encoder_of(self, run: Run) -> EncoderName:
        """Return the name of the encoder of the frames that a run's policy sees, if it sees any."""
        if run.kind == "train":
            return self.coded_by(self.arm(run.algorithm))
        own = "default" if run.kind in ("baseline", "packaged") else None
        return (self.saved(run.algorithm).encoder if run.kind == "policy" else own) or self.encoder

    def _reaches_as_data(self) -> dict[str, Any]:
        """Return the real rivers in place of levels as plain data, identified by their content, and which of them have
        other banks; nothing without any, as before there were some."""
        reaches = self.reaches
        rivers = {name: recorded_reach(reaches[name]) for name in self.grounds if name in reaches}
        return {"rivers": rivers} if rivers else {}

    def as_data(self) -> dict[str, Any]:
        """Return the suite as plain data for JSON; without an observation of frames, the default encoder, seeds of
        rivers if there are none, and the paper's task in still air, as before there were others, and without what is
        filmed, which changes no result."""
        conditions = [condition.as_data() for condition in self.conditions]
        usual = {"observation": "frames", "encoder": "default", "world_seeds": [], "film": self.film}
        usual |= {"task": "River", "hard": False, "forces": {}, "views": {}}
        functions = {"policies": [each.as_data() for each in self.policies]} if self.policies else {}
        chosen = {"forces": self.forces.as_data(), "views": self.views.as_data()}
        data = without(to_plain(self) | chosen, **usual) | seeds_as_data(self.world_seeds)
        del data["policies"], data["files"]
        return (
            data
            | self._reaches_as_data()
            | functions
            | {"arms": [arm.as_data() for arm in self.arms], "conditions": conditions}
        )
