"""What is run? A suite is data: what is trained with which seeds, and on which levels it is flown afterwards."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from thalweg.bench.baselines import BASELINES
from thalweg.bench.files import ResultsError

STUDIED = ("PPO", "PPOLag", "FOCOPS", "P3O", "OnCRPO", "DDPGLag", "TD3Lag", "SACLag", "SafeLOOP", "CCEPETS")
"""The study's algorithms, in its order."""
NAME = re.compile(r"\w+([-.]\w+)*")
"""What an arm may be called: files bear its name."""


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
    """Of each run, over all environments together."""
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

    def runs(self) -> tuple[Run, ...]:
        """What there is to do, in order: the quick ones first."""
        quick = [Run("baseline", name, 0) for name in self.baselines]
        packaged = [Run("packaged", PACKAGED, 0)] if self.packaged else []
        trained = [Run("train", arm.label, seed) for arm in self.arms for seed in arm.seeds]
        return (*quick, *packaged, *trained)

    def arm(self, label: str) -> Arm:
        """The arm of a label."""
        return next(arm for arm in self.arms if arm.label == label)

    def as_data(self) -> dict[str, Any]:
        """The suite as plain data for JSON (lists instead of tuples)."""
        data = {key: list(value) if isinstance(value, tuple) else value for key, value in vars(self).items()}
        return {**data, "arms": [arm.as_data() for arm in self.arms]}


PACKAGED = "packaged"
"""Name of the policy that comes with the package, as an algorithm of a result."""

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", tuple(Arm(name, seeds=(0,), steps=8_192) for name in ("PPO", "FOCOPS"))),
        Suite("easy", (Arm("PPO"), Arm("FOCOPS")), train_level="Easy", test_levels=("Easy",), packaged=False),
        Suite("paper", (*map(Arm, STUDIED), Arm("PPO", "paper"), Arm("FOCOPS", "paper"))),
    )
}


def suite_named(name: str) -> Suite:
    """A suite by name; raises `ResultsError` that lists the known ones."""
    if name.lower() not in SUITES:
        raise ResultsError(f"unknown suite {name!r}; known: {', '.join(SUITES)}")
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
    for what, names, known in (
        ("algorithm", [arm.algorithm for arm in suite.arms], algorithms),
        ("level", (suite.train_level, *suite.test_levels), levels),
        ("baseline", suite.baselines, tuple(BASELINES)),
    ):
        for name in names:
            if name not in known:
                raise ResultsError(f"suite {suite.name}: unknown {what} {name!r}; known: {', '.join(known)}")
    for arm in suite.arms:
        if not NAME.fullmatch(arm.label):
            raise ResultsError(f"suite {suite.name}: an arm is called {arm.label!r}; letters, digits, - and . will do")
        if arm.steps < 1:
            raise ResultsError(f"suite {suite.name}: steps of {arm.label} must be at least 1, not {arm.steps}")
    for what, number in (("episodes", suite.episodes), ("num_envs", suite.num_envs)):
        if number < 1:
            raise ResultsError(f"suite {suite.name}: {what} must be at least 1, not {number}")
    seeds = [("seeds", seed) for arm in suite.arms for seed in arm.seeds]
    for what, seed in (("starts_seed", suite.starts_seed), *seeds):
        if seed < 0:
            raise ResultsError(f"suite {suite.name}: {what} must be 0 or more, not {seed}")
    if len({run.name for run in suite.runs()}) != len(suite.runs()):
        raise ResultsError(f"suite {suite.name}: an arm, baseline or seed is named twice")
    if not suite.runs() or not suite.test_levels:
        raise ResultsError(f"suite {suite.name} has nothing to do")
