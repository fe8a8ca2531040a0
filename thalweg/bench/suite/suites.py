"""What is run? A suite is data: what is trained with which seeds, and on which levels it is flown afterwards."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES
from thalweg.bench.evaluate.conditions import BEYOND, MAIN, NAME, Condition, Trial, check_conditions

STUDIED = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "DDPGLag", "TD3Lag", "SACLag", "SafeLOOP", "CCEPETS")
"""The study's algorithms, in its order."""


@dataclass(frozen=True)
class Stage:
    """What is trained before something else, which begins as the policy that this leaves."""

    algorithm: str
    level: str
    steps: int
    preset: str = "default"
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Arm:
    """What is trained once with each seed."""

    algorithm: str
    """As in the registry of algorithms."""
    preset: str = "default"
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Of the algorithm, on top of the preset; plain data."""
    seeds: tuple[int, ...] = (0, 1, 2)
    steps: int = 200_000
    """Of each run, over all environments together, stages before it aside."""
    level: str = ""
    """That it is trained on; if empty the suite's."""
    before: tuple[Stage, ...] = ()
    """What is trained first, in order and with the same seed: a curriculum, or a transfer from another algorithm."""
    name: str = ""
    """What its results are called; if empty the algorithm, with the preset unless that is the default one."""

    @property
    def label(self) -> str:
        return self.name or (self.algorithm if self.preset == "default" else f"{self.algorithm}-{self.preset}")

    def as_data(self) -> dict[str, Any]:
        """As plain data for JSON, by its label."""
        return {**asdict(self), "settings": dict(self.settings), "seeds": list(self.seeds), "name": self.label}


@dataclass(frozen=True)
class Run:
    """One policy of a suite: trained, a baseline, or the one that comes with the package."""

    kind: str
    """`train`, `baseline` or `packaged`."""
    algorithm: str
    """The label of the arm, or the name of the baseline."""
    seed: int

    @property
    def name(self) -> str:
        return f"{self.algorithm}-{self.seed}"


@dataclass(frozen=True)
class Suite:
    """A benchmark as data."""

    name: str
    arms: tuple[Arm, ...]
    train_level: str = "Medium"
    test_levels: tuple[str, ...] = ("Easy", "Medium", "Hard")
    episodes: int = 20
    """Starts per level, each flown once by each policy."""
    starts_seed: int = 0
    """Chooses the list of starts of every level."""
    num_envs: int = 16
    """Environments that are stepped together in training."""
    baselines: tuple[str, ...] = ("random", "hover", "forward", "pilot")
    """Policies that need no training."""
    packaged: bool = True
    """Whether the policy that comes with the package is evaluated beside them."""
    conditions: tuple[Condition, ...] = ()
    """How they are flown beside the main way."""

    def runs(self) -> tuple[Run, ...]:
        """What there is to do, in order: the quick ones first."""
        quick = [Run("baseline", name, 0) for name in self.baselines]
        packaged = [Run("packaged", PACKAGED, 0)] if self.packaged else []
        trained = [Run("train", arm.label, seed) for arm in self.arms for seed in arm.seeds]
        return (*quick, *packaged, *trained)

    def trials(self, run: Run) -> tuple[Trial, ...]:
        """Where and how the run's policy is flown: the main ones first."""
        chosen = [each for each in self.conditions if each.blind or run.kind != "baseline"]
        return tuple(
            Trial(level, condition)
            for condition in (MAIN, *chosen)
            for level in condition.rivers or condition.levels or self.test_levels
        )

    def arm(self, label: str) -> Arm:
        """The arm of a label."""
        return next(arm for arm in self.arms if arm.label == label)

    def level_of(self, arm: Arm) -> str:
        """Where an arm is trained, in its last stage."""
        return arm.level or self.train_level

    def as_data(self) -> dict[str, Any]:
        """The suite as plain data for JSON (lists instead of tuples)."""
        data = {key: list(value) if isinstance(value, tuple) else value for key, value in vars(self).items()}
        conditions = [condition.as_data() for condition in self.conditions]
        return {**data, "arms": [arm.as_data() for arm in self.arms], "conditions": conditions}


PACKAGED = "packaged"
"""Name of the policy that comes with the package, as an algorithm of a result."""


def _variants(algorithm: str, seeds: tuple[int, ...], **settings: Mapping[str, Any]) -> tuple[Arm, ...]:
    """An algorithm as it is, and once more with each of the settings, by what they are called."""
    usual = Arm(algorithm, seeds=seeds, steps=50_000)
    return usual, *(replace(usual, settings=each, name=f"{algorithm}-{name}") for name, each in settings.items())


_ACTIONS = {"box_scaled": {"adapter": "box_scaled"}, "box_literal": {"adapter": "box_literal"}}
_THREE = (0, 1, 2)
_OPEN = (
    *_variants("DDPGLag", _THREE, **_ACTIONS),
    *_variants(
        "FOCOPS",
        _THREE,
        broken_mask={"mask": "batch"},
        ascent={"multiplier_gain": 0.0},
        adam={"multiplier_gain": 0.0, "multiplier_rule": "adam", "multiplier_rate": 0.035},
        pid={"multiplier_derivative": 10.0, "multiplier_smoothing": 0.5},
    ),
    *_variants("SACLag", _THREE, **_ACTIONS),
    *_variants("SafeLOOP", (0,), drop_terminal={"drop_terminal": True}),
    *_variants("CCEPETS", (0,), **_ACTIONS),
)
"""What the paper left open: which actions, which mask and multiplier, and whether planners see what ends an episode."""
_PROTOCOLS = (
    Arm("FOCOPS", level="Hard", name="FOCOPS-Hard"),
    Arm(
        "FOCOPS",
        level="Hard",
        steps=80_000,
        before=(Stage("FOCOPS", "Easy", 60_000), Stage("FOCOPS", "Medium", 60_000)),
        name="FOCOPS-curriculum",
    ),
    Arm("FOCOPS", steps=100_000, before=(Stage("PPO", "Medium", 100_000),), name="FOCOPS-after-PPO"),
    Arm("FOCOPS"),
)
"""Ways of training with the same number of steps each."""

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", tuple(Arm(name, seeds=(0,), steps=8_192) for name in ("PPO", "FOCOPS"))),
        Suite("easy", (Arm("PPO"), Arm("FOCOPS")), train_level="Easy", test_levels=("Easy",), packaged=False),
        Suite("open", _OPEN, baselines=(), packaged=False),
        Suite("protocols", _PROTOCOLS, baselines=(), packaged=False),
        Suite("paper", (*map(Arm, STUDIED), Arm("PPO", "paper"), Arm("FOCOPS", "paper")), conditions=BEYOND),
    )
}


def suite_named(name: str) -> Suite:
    """A suite by name; raises `ResultsError` that lists the known ones."""
    if name.lower() not in SUITES:
        raise ResultsError(f"unknown suite {name!r}; known: {', '.join(SUITES)}, or a file of your own: my.yaml")
    return SUITES[name.lower()]


def arms_of(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The arms of a suite's record, also of one from before there were any, as `Arm.as_data` gives them."""
    if "arms" in record:
        return list(record["arms"])
    common = {"seeds": record.get("seeds", []), "steps": record.get("steps", 0)}
    return [{"name": name, "algorithm": name, **common} for name in record.get("algorithms", [])]


def check(suite: Suite, algorithms: tuple[str, ...], levels: tuple[str, ...]) -> None:
    """Raise `ResultsError`, before anything runs, for a suite that names what does not exist or has nothing to do.

    Presets and settings are checked by the algorithms themselves.
    """
    stages = [stage for arm in suite.arms for stage in arm.before]
    own = [arm.level for arm in suite.arms if arm.level]
    for what, names, known in (
        ("algorithm", [each.algorithm for each in (*suite.arms, *stages)], algorithms),
        ("level", (suite.train_level, *suite.test_levels, *own, *(stage.level for stage in stages)), levels),
        ("baseline", suite.baselines, tuple(BASELINES)),
    ):
        for name in names:
            if name not in known:
                raise ResultsError(f"suite {suite.name}: unknown {what} {name!r}; known: {', '.join(known)}")
    for arm in suite.arms:
        if not NAME.fullmatch(arm.label):
            raise ResultsError(f"suite {suite.name}: an arm is called {arm.label!r}; letters, digits, - and . will do")
        for steps in (arm.steps, *(stage.steps for stage in arm.before)):
            if steps < 1:
                raise ResultsError(f"suite {suite.name}: steps of {arm.label} must be at least 1, not {steps}")
    for what, number in (("episodes", suite.episodes), ("num_envs", suite.num_envs)):
        if number < 1:
            raise ResultsError(f"suite {suite.name}: {what} must be at least 1, not {number}")
    seeds = [("seeds", seed) for arm in suite.arms for seed in arm.seeds]
    for what, seed in (("starts_seed", suite.starts_seed), *seeds):
        if seed < 0:
            raise ResultsError(f"suite {suite.name}: {what} must be 0 or more, not {seed}")
    check_conditions(suite.conditions, levels)
    labels = [*(arm.label for arm in suite.arms), *suite.baselines, PACKAGED]
    for label in labels:
        if labels.count(label) > 1:
            raise ResultsError(f"suite {suite.name}: {label} is named twice; give one of them a name of its own")
    for arm in suite.arms:
        if not arm.seeds:
            raise ResultsError(f"suite {suite.name}: {arm.label} has no seeds; give at least one, such as 0")
    _check_once(suite)
    if not suite.runs() or not suite.test_levels:
        raise ResultsError(f"suite {suite.name} has nothing to do")


def _check_once(suite: Suite) -> None:
    """Raise `ResultsError` where what is done once is named twice: its results would count twice."""
    for what, where, named in (
        ("level", "test_levels", suite.test_levels),
        *(("seed", f"seeds of {arm.label}", arm.seeds) for arm in suite.arms),
        *(("level", f"levels of condition {each.name}", each.levels) for each in suite.conditions),
        *(("river", f"rivers of condition {each.name}", each.rivers) for each in suite.conditions),
    ):
        for value in named:
            if named.count(value) > 1:
                raise ResultsError(f"suite {suite.name}: {what} {value!r} is named twice in {where}")
