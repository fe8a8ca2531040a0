"""Trainings of a suite: arms and their earlier stages, and the runs of all that it executes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.rivers import NAME
from thalweg.bench.suite.policy_files import Begun
from thalweg.core.config import TupleOf, WholeNumber, frozen_config, to_plain
from thalweg.core.seeds import MAX_SEED, compact_seeds, parse_seeds

Count = Annotated[WholeNumber, Field(ge=1)]
Seed = Annotated[WholeNumber, Field(ge=0, le=MAX_SEED)]


def _seeds(value: Any) -> tuple[int, ...]:
    """Return seeds of rivers as numbers."""
    return parse_seeds(value, "seeds of rivers")


RiverSeeds = Annotated[tuple[int, ...], BeforeValidator(_seeds)]
"""Seeds of rivers to train on: numbers, and ranges such as "1000:1016", whose end is excluded."""
Observation = Literal["frames", "privileged", "rgb+mask", "rgb", "mask"]
"""What trained policies see: frames through a packaged encoder, the privileged observation, or, with the setting
policy=cnn, images."""
EncoderName = str
"""An encoder that comes with the package, see `thalweg.encoder.PACKAGED`, or one of a plug-in."""


@frozen_config(ResultsError)
class Stage:
    """An earlier stage of training, whose policy the next stage starts from."""

    algorithm: str
    level: str
    """Training level; if empty, that of the suite."""
    steps: Count
    preset: str = "default"
    settings: Mapping[str, Any] = field(default_factory=dict)
    world_seeds: RiverSeeds = ()
    """Seeds of the level's rivers; if empty, those of the arm."""


@frozen_config(ResultsError)
class Arm:
    """An algorithm with its settings, trained once with each seed."""

    algorithm: str
    """Name of the algorithm in the registry, or of a plug-in."""
    preset: str = "default"
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the algorithm that replace those of the preset; plain data."""
    seeds: TupleOf[Seed] = (0, 1, 2)
    steps: Count = 200_000
    """Steps of each run, over all environments together, without earlier stages."""
    level: str = ""
    """Training level; if empty, that of the suite."""
    before: TupleOf[Stage] = ()
    """Earlier stages in order, with the same seed: a curriculum, or a transfer from another algorithm."""
    name: str = ""
    """Name of its results; if empty, the algorithm, with the preset unless that is the default one, and with the
    observation and the encoder if the arm has them of its own."""
    observation: Observation | None = None
    """What it sees in all stages; if None, what the suite says."""
    encoder: EncoderName | None = None
    """Encoder of the frames in all stages; if None, that of the suite."""
    world_seeds: RiverSeeds = ()
    """Seeds of the level's rivers; if empty, those of the suite."""
    begin_with: Begun | None = None
    """Policy that the first stage starts from: `packaged` or `packaged-rgb`, a run's folder, or a policy file; if None,
    weights drawn by the seed."""

    @model_validator(mode="after")
    def _check(self) -> "Arm":
        if not NAME.fullmatch(self.label):
            raise ValueError(f"an arm is called {self.label!r}; letters, digits, - and . will do")
        if not self.seeds:
            raise ValueError(f"{self.label} has no seeds; give at least one, such as 0")
        refuse_repeated("seed", f"seeds of {self.label}", self.seeds)
        return self

    @property
    def label(self) -> str:
        preset = None if self.preset == "default" else self.preset
        seen = self.observation and self.observation.replace("+", "-")
        return self.name or "-".join(part for part in (self.algorithm, preset, seen, self.encoder) if part)

    def as_data(self) -> dict[str, Any]:
        """Return plain data for JSON, with the label as the name; without an observation, an encoder or rivers
        that are the suite's, and a policy to begin with if there is none, as before arms had them."""
        before = [without(to_plain(stage), world_seeds=[]) | seeds_as_data(stage.world_seeds) for stage in self.before]
        own = without(to_plain(self), observation=None, encoder=None, world_seeds=[]) | seeds_as_data(self.world_seeds)
        del own["begin_with"]
        own |= {} if self.begin_with is None else {"begin_with": self.begin_with.as_data()}
        return own | {"before": before, "name": self.label}


@dataclass(frozen=True)
class Run:
    """A policy of a suite: trained, a baseline, the one that comes with the package, a function, or one of files."""

    kind: str
    """`train`, `baseline`, `packaged`, `function` or `policy`."""
    algorithm: str
    """Label of the arm, the function or the policy, or name of the baseline."""
    seed: int

    @property
    def name(self) -> str:
        return f"{self.algorithm}-{self.seed}"


def seeds_as_data(seeds: tuple[int, ...]) -> dict[str, Any]:
    """Return seeds of rivers under their key as plain data, or nothing if there are none."""
    return {"world_seeds": compact_seeds(seeds)} if seeds else {}


def without(data: dict[str, Any], **values: Any) -> dict[str, Any]:
    """Return the data without the keys that have these values."""
    return {key: value for key, value in data.items() if key not in values or value != values[key]}


def refuse_repeated(what: str, where: str, values: Sequence[Any]) -> None:
    """Raise `ValueError` for a value that stands twice in a list."""
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"{what} {value!r} is named twice in {where}")
