"""Conditions of evaluation: the paper's main one, and others that vary actions, rivers or appearance."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import model_validator

import thalweg.world
from thalweg.bench.csv_files import ResultsError
from thalweg.core.config import TupleOf, frozen_config, to_plain
from thalweg.render.errors import RenderError
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import LEVELS, Reach

NAME = re.compile(r"\w+([-.]\w+)*")
"""Names that arms and conditions may have, since files and folders are named after them."""
_FILES = Path(thalweg.world.__file__).parent / "real" / "rivers"
RIVERS = {
    "Cam": Reach(_FILES / "cam.geojson", start_m=700.0, length_m=300.0),
    "Wear": Reach(_FILES / "wear.geojson", start_m=450.0, length_m=300.0),
    "Cherwell": Reach(_FILES / "cherwell.geojson", start_m=450.0, length_m=300.0),
}
"""Real rivers, by the name that stands in place of a level in results."""
SUN = ("sun_azimuth_deg", "sun_elevation_deg")


@frozen_config(ResultsError)
class Condition:
    """How policies are flown: the differences from sampled actions, the fixed rivers of the levels and the default
    appearance."""

    name: str = ""
    """Name of the condition in results; empty for the main one, which every suite has."""
    levels: TupleOf[str] = ()
    """Levels to fly on; if empty, all test levels of the suite, or none if there are `rivers`."""
    rivers: TupleOf[str] = ()
    """Real rivers to fly on, of `RIVERS`."""
    deterministic: bool = False
    """Whether the most probable action is taken instead of a sampled one."""
    unseen: bool = False
    """Whether each start lies on another river of the level, on which nothing is trained."""
    varied: TupleOf[str] = ()
    """Parameters of the appearance that are drawn for each start, from the ranges of `Randomisation`."""
    blind: bool = True
    """Whether baselines are flown too. Neither appearance nor action probabilities make a difference to them."""
    shield: bool = False
    """Whether the shield replaces moves that would leave the water remembered from past masks."""

    @model_validator(mode="after")
    def _check(self) -> "Condition":
        if self.name and not NAME.fullmatch(self.name):
            raise ValueError(f"a condition is called {self.name!r}; letters, digits, - and . will do")
        for what, names, known in (("level", self.levels, LEVELS), ("river", self.rivers, RIVERS)):
            for name in names:
                if name not in known:
                    raise ValueError(f"condition {self.name}: unknown {what} {name!r}; known: {', '.join(known)}")
                if names.count(name) > 1:
                    raise ValueError(f"{what} {name!r} is named twice in {what}s of condition {self.name}")
        if self.rivers and (self.levels or self.unseen):
            raise ValueError(f"condition {self.name}: real rivers are neither levels nor unseen rivers of a level")
        if self.unseen and self.varied:
            raise ValueError(f"condition {self.name}: the appearance can vary only on the levels' fixed rivers")
        self.randomisation  # noqa: B018  raises the error for unknown parameters
        return self

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
        """Return plain data for JSON, in which rivers are identified by their content; without a shield as before there
        was one."""
        data = to_plain(self) | {"rivers": {name: RIVERS[name].as_data() for name in self.rivers}}
        return {name: value for name, value in data.items() if name != "shield" or value}


MAIN = Condition()


@dataclass(frozen=True)
class Trial:
    """One evaluation of a policy: a river, and the condition."""

    level: str
    """A level, or one of `RIVERS`."""
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
