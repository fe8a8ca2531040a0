"""Conditions of evaluation: the paper's main one, and others that vary actions, rivers or appearance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import model_validator

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.rivers import (
    NAME,
    RIVERS,
    check_files,
    reaches_of,
    recorded_reach,
    refuse_unknown_levels,
)
from thalweg.core.config import TupleOf, frozen_config, refuse_unknown, to_plain
from thalweg.render.errors import RenderError
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import Reach

SUN = ("sun_azimuth_deg", "sun_elevation_deg")


@frozen_config(ResultsError)
class Condition:
    """How policies are flown: the differences from sampled actions, the fixed rivers of the levels and the default
    appearance."""

    name: str = ""
    """Name of the condition in results; empty for the main one, which every suite has."""
    levels: TupleOf[str] = ()
    """Levels to fly on, also with other banks, such as Medium+meadow; if empty, all test levels of the suite, or none
    if there are `rivers`."""
    rivers: TupleOf[str] = ()
    """Real rivers to fly on, of `RIVERS` or `files`."""
    files: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Files of other real rivers by their names in results: `file`, its path, and options such as `start_m`, which are
    the fields of `thalweg.world.real.selection.Selection`."""
    deterministic: bool = False
    """Whether the most probable action is taken instead of a sampled one."""
    unseen: bool = False
    """Whether each start lies on another river of the level, on which nothing is trained."""
    varied: TupleOf[str] = ()
    """Parameters of the appearance that are drawn for each start, from the ranges of `Randomisation`."""
    blind: bool = True
    """Whether baselines are flown too, if there is no shield. Neither appearance nor action probabilities make a
    difference to them."""
    shield: bool = False
    """Whether the shield replaces moves that would leave the water remembered from past masks."""

    @model_validator(mode="after")
    def _check(self) -> "Condition":
        if self.name and not NAME.fullmatch(self.name):
            raise ValueError(f"a condition is called {self.name!r}; letters, digits, - and . will do")
        self._check_files()
        try:
            refuse_unknown_levels(self.levels)
            refuse_unknown("river", self.rivers, {**RIVERS, **self.files}, ValueError)
        except ValueError as error:
            raise ValueError(f"condition {self.name}: {error}") from error
        for what, names in (("level", self.levels), ("river", self.rivers)):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"{what} {name!r} is named twice in {what}s of condition {self.name}")
        if self.rivers and (self.levels or self.unseen):
            raise ValueError(f"condition {self.name}: real rivers are neither levels nor unseen rivers of a level")
        if self.unseen and self.varied:
            raise ValueError(f"condition {self.name}: the appearance can vary only on the levels' fixed rivers")
        self.randomisation  # noqa: B018  raises the error for unknown parameters
        return self

    def _check_files(self) -> None:
        """Raise `ValueError` for a file that is not there, an option that is wrong, or a name that is taken."""
        for name in self.files:
            if name not in self.rivers:
                raise ValueError(f"condition {self.name}: {name!r} has a file, but is not in its rivers")
        check_files(self.files, f"condition {self.name}: ")

    def river(self, name: str) -> Reach:
        """Return the real river with a name."""
        return RIVERS[name] if name in RIVERS else reaches_of(self.files)[name]

    @property
    def randomisation(self) -> Randomisation | None:
        """Distribution of the appearance; None for the default one. Raises `ResultsError` for unknown parameters."""
        if not self.varied:
            return None
        ranges = Randomisation()
        try:
            return Randomisation.only(**{name: getattr(ranges, name, None) for name in self.varied})
        except RenderError as error:
            raise ResultsError(f"condition {self.name}: {error}") from error

    def as_data(self) -> dict[str, Any]:
        """Return plain data for JSON, in which rivers are identified by their content; without a shield and files as
        before there were any. Raises `WorldFileError` for a file from which no river can be made."""
        data = to_plain(self) | {"rivers": {name: recorded_reach(self.river(name)) for name in self.rivers}}
        return {name: value for name, value in data.items() if name != "files" and (name != "shield" or value)}


MAIN = Condition()


@dataclass(frozen=True)
class Trial:
    """One evaluation of a policy: a river, and the condition."""

    level: str
    """A level, or a real river of the condition or the suite."""
    condition: Condition = MAIN

    def __str__(self) -> str:
        return f"{self.level}, {self.condition.name}" if self.condition.name else self.level


APPEARANCE = (
    "haze",
    "exposure_ev",
    "warmth",
    "water_tint",
    "turbidity",
    "ripple",
    "season",
    "plant_density",
    "pitch_deg",
    "fov_deg",
    "noise",
    "clouds",
)
"""Parameters of the appearance that vary one at a time; both of the sun vary together."""
CONDITIONS = (
    Condition("deterministic", deterministic=True, blind=False),
    Condition("unseen", unseen=True),
    Condition("real", rivers=("Cam",)),
    *(Condition(name, ("Medium",), varied=(name,), blind=False) for name in APPEARANCE),
    Condition("sun", ("Medium",), varied=SUN, blind=False),
    Condition("all_at_once", ("Medium",), varied=(*APPEARANCE, *SUN), blind=False),
)
"""Conditions that go beyond the paper: deterministic actions, other rivers, and each parameter of the appearance."""
SHIELDED = Condition("shield", blind=False, shield=True)
"""The main condition with the shield; no suite has it unless it is named."""
