"""Config of a suite: what is trained with which seeds, and how the policies are evaluated.

A suite is checked when it is constructed: it names only what exists, and nothing twice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ValidationInfo, model_validator

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.constraint.cost_limits import check_cost_episodes
from thalweg.algos.registry import algorithm_named, algorithm_names
from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.conditions import CONDITIONS, MAIN, SHIELDED, Condition, Trial
from thalweg.bench.evaluate.rivers import (
    RIVERS,
    Files,
    check_files,
    reaches_of,
    recorded_reach,
    refuse_unknown_levels,
)
from thalweg.bench.evaluate.shielded import check_masks
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
    refuse_repeated,
    seeds_as_data,
    without,
)
from thalweg.bench.suite.flown import Flown, Function, SavedPolicy, flown
from thalweg.bench.suite.names import refuse_long_names
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.bench.suite.views import TrainingViews
from thalweg.core.config import TupleOf, frozen_config, refuse_unknown, to_plain
from thalweg.core.plugins.record import PluginError
from thalweg.encoder import encoder_names, encoder_size
from thalweg.env.config import EnvConfig
from thalweg.env.forces.options import ForceOptions
from thalweg.env.tasks import task_names
from thalweg.train.encoder_of_run import check_size_fits
from thalweg.train.errors import TrainingError
from thalweg.train.observations import FRAMES, IMAGES, PRIVILEGED, action_of, check_policy_fits
from thalweg.train.river import RiverTraining, load_compatible_encoder
from thalweg.train.run import check_warmup, sees_images
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
        try:
            check_files(self.files)
            self._check_known()
            self._check_rivers()
            self._check_repeated()
            self._check_actions()
            self._check_views()
            self._check_saved()
            self._check_names()
        except ValueError as error:
            raise ValueError(f"suite {self.name}: {error}") from error
        if not self.runs() or not self.test_levels:
            raise ValueError(f"suite {self.name} has nothing to do")
        for arm in self.arms:
            for index, each in enumerate((*arm.before, arm)):
                try:
                    config = algorithm_named(each.algorithm).configure(dict(each.settings), each.preset, self.num_envs)
                    check_cost_episodes(config, self.num_envs)
                    if index or arm.begin_with is not None:  # begins with the policy of the stage before, or another
                        check_warmup(config, each.steps, self.num_envs)
                    self._check_sight(arm, sees_images(config))
                except (AlgorithmError, PluginError, TrainingError) as error:
                    stage = f", stage {index + 1}" if arm.before else ""
                    raise ValueError(f"suite {self.name}, {arm.label}{stage}: {error}") from error
            self._check_begun(arm)
        return self

    def _check_sight(self, arm: Arm, has_convolutions: bool) -> None:
        """Raise `TrainingError` unless what an arm's policies see goes with whether they have convolutions."""
        seen = arm.observation or self.observation
        if has_convolutions and seen not in IMAGES:
            raise TrainingError(f"policy=cnn sees images: set observation to {' or '.join(IMAGES)}, not {seen}")
        if seen in IMAGES and not has_convolutions:
            raise TrainingError(f"the observation {seen} is for policies with convolutions: set policy=cnn")
        if arm.begin_with is not None and seen != (sees := arm.begin_with.observation):
            how = f"set policy=cnn and observation to {sees}" if sees in IMAGES else f"set observation to {sees}"
            raise TrainingError(
                f"the policy {arm.begin_with.given} sees {sees}, not {seen}: leave begin_with out, or {how}"
            )

    def _check_known(self) -> None:
        """Raise `ValueError` for an algorithm, a level or a baseline that does not exist."""
        stages = [stage for arm in self.arms for stage in arm.before]
        refuse_unknown_levels(self.grounds, self.reaches)
        for what, names, known in (
            ("algorithm", [each.algorithm for each in (*self.arms, *stages)], algorithm_names()),
            ("baseline", self.baselines, BASELINES),
            ("task", [self.task], task_names()),
            ("encoder", {self.encoder, *(arm.encoder or self.encoder for arm in self.arms)}, encoder_names()),
        ):
            refuse_unknown(what, names, known, ValueError)

    def _check_rivers(self) -> None:
        """Raise `ValueError` for a file that is not used, a real river with two files, for trainings and flights that
        are for levels alone, and for rivers that nothing is trained on."""
        for condition in self.conditions:
            for name in condition.files:
                if name in self.files and condition.river(name) != self.reaches[name]:
                    raise ValueError(f"river {name}: condition {condition.name} has another file, or other options")
        used = {*self.grounds, *(name for condition in self.conditions for name in condition.rivers)}
        if unused := [name for name in self.files if name not in used]:
            raise ValueError(f"{unused[0]!r} of files is neither trained on nor flown on: leave it out")
        real = [name for name in self.test_levels if name in self.reaches]
        unseen = [each.name for each in self.conditions if each.unseen and not each.levels]
        if real and unseen:
            raise ValueError(
                f"condition {unseen[0]}: {real[0]} is a real river, whose seeds change plants and hills, not its"
                f" course: give the condition levels of its own, such as {{name: {unseen[0]}, unseen: true, levels:"
                " [Medium]}"
            )
        for arm in self.arms:
            for stage in (*arm.before, arm):
                ground = self.ground(self.level_of(stage))
                RiverTraining(ground, self.num_envs, self.seeds_of(arm, stage), self.training_rules)

    def _check_actions(self) -> None:
        """Raise `ValueError` for rules that do not go together, and for discrete actions where they are continuous."""
        if self.training_rules.action == "multidiscrete":
            return
        if self.packaged:
            raise ValueError(
                "the packaged policy has no continuous actions, which the flights take: set packaged: false"
            )
        for arm in self.arms:
            if arm.begin_with is not None and action_of(arm.begin_with.policy) != self.training_rules.action:
                raise ValueError(
                    f"arm {arm.label}: the policy {arm.begin_with.given} has no continuous actions, which the flights"
                    " take: leave begin_with out"
                )
        shields = [condition.name for condition in self.conditions if condition.shield]
        if shields:
            raise ValueError(f"condition {shields[0]}: the shield judges no continuous actions, which the flights take")

    def _check_views(self) -> None:
        """Raise `ValueError` for settings of frames where no policy is trained on any, since reports would tell of
        them, and for a camera whose frames do not fit an encoder."""
        of_frames = [name for name in self.views.as_data() if name != "action"]
        if of_frames and self.arms and {arm.observation or self.observation for arm in self.arms} == {PRIVILEGED}:
            raise ValueError(
                f"policies see the privileged observation, for which nothing is drawn: leave {' and '.join(of_frames)}"
                " of the views out"
            )
        for arm in self.arms:
            if (arm.observation or self.observation) == FRAMES:
                encoder = arm.encoder or self.encoder
                try:
                    check_size_fits(self.views.camera, encoder_size(encoder), encoder)
                except TrainingError as error:
                    raise ValueError(f"{arm.label}: {error}") from error

    def _check_begun(self, arm: Arm) -> None:
        """Raise `ValueError` for a policy to begin with that does not fit the training of its arm.

        The one that comes with the package is compared by what it sees alone.
        """
        rules, begun, seen = self.training_rules, arm.begin_with, arm.observation or self.observation
        if begun is None or begun.is_packaged:
            return
        encoder = load_compatible_encoder(arm.encoder or self.encoder) if seen == FRAMES else None
        try:
            check_policy_fits(begun.policy, encoder, offered=seen, task=rules.task, action=rules.action)
        except TrainingError as error:
            raise ValueError(f"suite {self.name}, arm {arm.label}: {begun.given}: {error}") from error

    def _check_saved(self) -> None:
        """Raise `ValueError` for a policy that was trained before and does not fit the flights."""
        rules, shielded = self.rules, any(condition.shield for condition in self.conditions)
        for file in (file for saved in self.policies if isinstance(saved, SavedPolicy) for file in saved.policy):
            encoder = None if file.encoder is None else load_compatible_encoder(file.encoder)
            try:
                check_policy_fits(file.policy, encoder, task=rules.task, action=rules.action, dynamics=rules.dynamics)
                if shielded and file.observation != PRIVILEGED:
                    check_masks(file.policy, encoder)
            except (TrainingError, ResultsError) as error:
                raise ValueError(f"{file.given}: {error}") from error

    def _check_names(self) -> None:
        """Raise `ValueError` for names that are too long for the files of the results."""
        flown = [(run, [trial.level for trial in self.trials(run)]) for run in self.runs()]
        refuse_long_names(flown, [condition.name for condition in self.conditions])

    def _check_repeated(self) -> None:
        """Raise `ValueError` for anything that is named twice: its results would count twice.

        Labels and conditions are names of folders, which macOS and Windows do not tell apart by capitals.
        """
        labels = [*(each.label for each in (*self.arms, *self.policies)), *self.baselines, PACKAGED]
        if repeated := _same_folder(labels):
            raise ValueError(f"{repeated}; give one of them a name of its own")
        refuse_repeated("level", "test_levels", self.test_levels)
        if repeated := _same_folder(self.test_levels):
            raise ValueError(f"test_levels: {repeated}")
        names = [condition.name for condition in self.conditions]
        for name in names:
            if not name:
                raise ValueError("a condition is called ''; letters, digits, - and . will do")
        if repeated := _same_folder(names):
            raise ValueError(f"condition {repeated}")

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

    def observation_of(self, run: Run) -> str | None:
        """Return what a run's policy sees of rivers; None for a baseline."""
        if run.kind == "baseline":
            return None
        if run.kind == "function":
            return self.function(run.algorithm).observation
        if run.kind == "policy":
            return self.saved(run.algorithm).observation
        return "frames" if run.kind == "packaged" else self.arm(run.algorithm).observation or self.observation

    def encoder_of(self, run: Run) -> EncoderName:
        """Return the name of the encoder of the frames that a run's policy sees, if it sees any."""
        own = "default" if run.kind in ("baseline", "packaged") else None
        own = self.saved(run.algorithm).encoder if run.kind == "policy" else own
        own = self.arm(run.algorithm).encoder if run.kind == "train" else own
        return own or self.encoder

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


def _same_folder(names: Sequence[str]) -> str:
    """Return what is wrong with the first name that stands twice, capitals aside; empty if none does."""
    seen: dict[str, str] = {}
    for name in names:
        if (before := seen.setdefault(name.casefold(), name)) != name:
            return f"{before} and {name} differ in capitals alone"
        if names.count(name) > 1:
            return f"{name} is named twice"
    return ""
