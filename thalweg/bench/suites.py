"""What is run? A suite is data: which algorithms, seeds, steps and levels make up a benchmark."""

from dataclasses import asdict, dataclass, field

from thalweg.bench.baselines import BASELINES
from thalweg.bench.files import ResultsError


@dataclass(frozen=True)
class Run:
    """One policy of a suite: trained, a baseline, or the one that comes with the package."""

    kind: str
    """`train`, `baseline` or `packaged`."""
    algorithm: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.algorithm}-{self.seed}"


@dataclass(frozen=True)
class Suite:
    """A benchmark as data."""

    name: str
    algorithms: tuple[str, ...]
    """As in the registry of algorithms."""
    seeds: tuple[int, ...]
    """Each algorithm is trained once with each."""
    steps: int
    """Steps of each training run, over all its environments together."""
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
    settings: dict[str, float | int | str | bool] = field(default_factory=dict)
    """Fields of the algorithms' configs that differ from their defaults."""

    def runs(self) -> tuple[Run, ...]:
        """What there is to do, in order: the quick ones first."""
        quick = [Run("baseline", name, 0) for name in self.baselines]
        packaged = [Run("packaged", PACKAGED, 0)] if self.packaged else []
        trained = [Run("train", algorithm, seed) for algorithm in self.algorithms for seed in self.seeds]
        return (*quick, *packaged, *trained)

    def as_data(self) -> dict[str, object]:
        """The suite as plain data for JSON (lists instead of tuples)."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


PACKAGED = "packaged"
"""Name of the policy that comes with the package, as an algorithm of a result."""

SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("quick", algorithms=("PPO", "FOCOPS"), seeds=(0,), steps=8_192),
        Suite(
            "easy",
            algorithms=("PPO", "FOCOPS"),
            seeds=(0, 1, 2),
            steps=200_000,
            train_level="Easy",
            test_levels=("Easy",),
            packaged=False,
        ),
        Suite("paper", algorithms=("PPO", "FOCOPS"), seeds=(0, 1, 2), steps=200_000),
    )
}


def suite_named(name: str) -> Suite:
    """A suite by name; raises `ResultsError` that lists the known ones."""
    if name.lower() not in SUITES:
        raise ResultsError(f"unknown suite {name!r}; known: {', '.join(SUITES)}")
    return SUITES[name.lower()]


def check(suite: Suite, algorithms: tuple[str, ...], levels: tuple[str, ...]) -> None:
    """Raise `ResultsError`, before anything runs, for a suite that names what does not exist or has nothing to do."""
    for what, names, known in (
        ("algorithm", suite.algorithms, algorithms),
        ("level", (suite.train_level, *suite.test_levels), levels),
        ("baseline", suite.baselines, tuple(BASELINES)),
    ):
        for name in names:
            if name not in known:
                raise ResultsError(f"suite {suite.name}: unknown {what} {name!r}; known: {', '.join(known)}")
    for what, number in (("steps", suite.steps), ("episodes", suite.episodes), ("num_envs", suite.num_envs)):
        if number < 1:
            raise ResultsError(f"suite {suite.name}: {what} must be at least 1, not {number}")
    for what, seed in (("starts_seed", suite.starts_seed), *(("seeds", seed) for seed in suite.seeds)):
        if seed < 0:
            raise ResultsError(f"suite {suite.name}: {what} must be 0 or more, not {seed}")
    if len({run.name for run in suite.runs()}) != len(suite.runs()):
        raise ResultsError(f"suite {suite.name}: an algorithm, baseline or seed is named twice")
    if not suite.runs() or not suite.test_levels:
        raise ResultsError(f"suite {suite.name} has nothing to do")
