"""Under which conditions are policies flown? As the paper did, and beyond it: data, like the suite that names them."""

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import thalweg.world
from thalweg.bench.csv_files import ResultsError
from thalweg.render.errors import RenderError
from thalweg.render.records.randomisation import Randomisation
from thalweg.world import Reach

NAME = re.compile(r"\w+([-.]\w+)*")
"""What arms and conditions may be called: files and folders bear their names."""
RIVERS = {
    "Cam": Reach(Path(thalweg.world.__file__).parent / "real" / "rivers" / "cam.geojson", start_m=700.0, length_m=300.0)
}
"""Real rivers, by what stands for a level's name in results."""
SUN = ("sun_azimuth_deg", "sun_elevation_deg")


@dataclass(frozen=True)
class Condition:
    """How policies are flown: what differs from sampled actions, the levels' own rivers and the usual day."""

    name: str = ""
    """What its results are called; empty for the main one, which every suite has."""
    levels: tuple[str, ...] = ()
    """If empty all that the suite tests on; none where there are rivers."""
    rivers: tuple[str, ...] = ()
    """Real ones, of `RIVERS`."""
    deterministic: bool = False
    """Whether the most probable action is taken instead of a sampled one."""
    unseen: bool = False
    """Whether each start lies on another river of the level, on which nothing is trained."""
    varied: tuple[str, ...] = ()
    """Parts of the look that are drawn for each start, over the ranges of `Randomisation`."""
    blind: bool = True
    """Whether baselines are flown too, to which neither looks nor probabilities make a difference."""

    @property
    def randomisation(self) -> Randomisation | None:
        """From what looks are drawn; None for the usual day. Raises `ResultsError` for a part that there is not."""
        if not self.varied:
            return None
        whole = Randomisation()
        try:
            return Randomisation.only(**{part: getattr(whole, part, None) for part in self.varied})
        except RenderError as error:
            raise ResultsError(f"condition {self.name}: {error}") from error

    def as_data(self) -> dict[str, Any]:
        """As plain data for JSON, with what tells its rivers from others."""
        data = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}
        return data | {"rivers": {name: RIVERS[name].as_data() for name in self.rivers}}


@dataclass(frozen=True)
class Trial:
    """Where a policy is flown, and how."""

    level: str
    """Or a real river."""
    condition: Condition = Condition()

    def __str__(self) -> str:
        return f"{self.level}, {self.condition.name}" if self.condition.name else self.level


MAIN = Condition()
DAYS = (
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
)
"""Parts of a look that can vary by themselves; the sun does as a whole."""
BEYOND = (
    Condition("deterministic", deterministic=True, blind=False),
    Condition("unseen", unseen=True),
    Condition("real", rivers=tuple(RIVERS)),
    *(Condition(part, ("Medium",), varied=(part,), blind=False) for part in DAYS),
    Condition("sun", ("Medium",), varied=SUN, blind=False),
    Condition("all_at_once", ("Medium",), varied=(*DAYS, *SUN), blind=False),
)
"""What the paper's comparison is taken beyond: other choices of action, other rivers, and each part of the look."""


def check_conditions(conditions: tuple[Condition, ...], levels: tuple[str, ...]) -> None:
    """Raise `ResultsError` for a condition that names what there is not, or that cannot be told from another."""
    names = [condition.name for condition in conditions]
    for condition in conditions:
        if not NAME.fullmatch(condition.name):
            raise ResultsError(f"a condition is called {condition.name!r}; letters, digits, - and . will do")
        if names.count(condition.name) > 1:
            raise ResultsError(f"condition {condition.name} is named twice")
        for what, chosen, known in (("level", condition.levels, levels), ("river", condition.rivers, tuple(RIVERS))):
            for name in set(chosen) - set(known):
                raise ResultsError(f"condition {condition.name}: unknown {what} {name!r}; known: {', '.join(known)}")
        if condition.rivers and (condition.levels or condition.unseen):
            raise ResultsError(f"condition {condition.name}: real rivers are neither levels nor unseen ones of them")
        if condition.unseen and condition.varied:
            raise ResultsError(f"condition {condition.name}: looks vary on the levels' own rivers only")
        condition.randomisation  # noqa: B018  raises what is wrong with its parts
