"""What is asked of a river? The three levels as data, and the record for levels of one's own.

The paper's scenes are not public; these follow its order of difficulty and its stated features.
"""

import hashlib
import math
import operator
import re
from dataclasses import astuple, dataclass, fields
from typing import Any, NamedTuple

from thalweg.world.errors import WorldError
from thalweg.world.validation import CLEARANCE_M, LEAST_LENGTH_M, LEAST_SAMPLES, MOST_SAMPLES


class Limits(NamedTuple):
    """What a number of a level may be."""

    whole: bool
    low: float
    high: float
    pair: bool = False

    def __str__(self) -> str:
        kind = ("two " if self.pair else "a ") + ("whole number" if self.whole else "number") + "s" * self.pair
        span = f"of at least {self.low:g}" if self.high == math.inf else f"from {self.low:g} to {self.high:g}"
        return f"{kind} {span}" + ", the smaller first" * self.pair


LIMITS = {
    "samples": Limits(True, LEAST_SAMPLES[True], MOST_SAMPLES),
    "length_m": Limits(False, LEAST_LENGTH_M[True], 10_000),
    "bends": Limits(True, 2, 100, pair=True),
    "width_m": Limits(False, 2 * CLEARANCE_M, 100, pair=True),
    "bridges": Limits(True, 0, 100),
    "islands": Limits(True, 0, 100),
    "tributaries": Limits(True, 0, 100),
    "depth_m": Limits(False, 0.05, 100),
    "depth_variation": Limits(False, 0, 0.95),
    "fall_m": Limits(False, 0, 1000),
    "cut_banks": Limits(False, 0, 1),
    "hills_m": Limits(False, 0, 1000),
    "ponds": Limits(True, 0, 100),
    "plant_density": Limits(False, 0, 10),
    "default_seed": Limits(True, 0, math.inf),
}
"""For each number of a `Level`. Within them a level may still ask for more than any river has room for."""
NAME = re.compile(r"\w[\w .+-]{0,63}", re.ASCII)
"""A level's name stands in tables, file names and on pictures."""
WIDTHS_APART_M = 0.3
"""The widest place is at least so much wider than the narrowest."""


@dataclass(frozen=True)
class Level:
    """Everything the generator may choose from; two levels with the same data give the same rivers.

    Numbers are brought to one form, so that 280 and 280.0 are the same; raises `WorldError` that names a bad field.
    """

    name: str
    """What it is called in files and tables."""
    samples: int
    """Exact number of river samples and, the course being closed, of segments."""
    length_m: float
    """Length of the loop; a river differs from it by at most one percent."""
    bends: tuple[int, int]
    """Fewest and most bends over 30 degrees, as `geometry.bend_count` counts them."""
    width_m: tuple[float, float]
    """Narrowest and widest place; each river comes near both."""
    bridges: int
    """Number of arch bridges."""
    islands: int
    """Number of sand islands."""
    tributaries: int
    """Number of side channels that leave the course."""
    depth_m: float
    """Mean depth on the centre line."""
    depth_variation: float
    """Half the range of the depth as a share of its mean."""
    fall_m: float
    """How far the water level falls round the loop before it is regained in one rapid."""
    cut_banks: float
    """0..1, how steep the outer banks of bends are cut."""
    hills_m: float
    """Height of the hills above the flood plain, far from the river."""
    ponds: int
    """Still water inside the loop, beside the course."""
    plant_density: float
    """Plants per area relative to a dense forest."""
    default_seed: int
    """The seed of the fixed river that stands for this level."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not NAME.fullmatch(self.name):
            raise WorldError(
                f"level {self.name!r}: name must be letters, digits, spaces and . + - _, not {self.name!r}"
            )
        for field in fields(self)[1:]:
            given, limits = getattr(self, field.name), LIMITS[field.name]
            value = pair_within(given, limits) if limits.pair else number_within(given, limits)
            if value is None:
                raise WorldError(f"level {self.name!r}: {field.name} must be {limits}, not {given!r}")
            object.__setattr__(self, field.name, value)
        if self.width_m[1] - self.width_m[0] < WIDTHS_APART_M:
            raise WorldError(
                f"level {self.name!r}: width_m must differ by at least {WIDTHS_APART_M} m, not {self.width_m}"
            )

    @property
    def key(self) -> int:
        """A 64-bit number that depends on all the data except the default seed."""
        data = repr(astuple(self)[:-1]).encode()
        return int.from_bytes(hashlib.sha256(data).digest()[:8], "little")


def number_within(given: Any, limits: Limits) -> int | float | None:
    """The number as a plain `int` or `float`; None for what is no such number or out of its limits."""
    if isinstance(given, bool | str | bytes):
        return None
    try:
        value = operator.index(given) if limits.whole else float(given)
    except (TypeError, ValueError, OverflowError):
        return None
    return value if limits.low <= value <= limits.high else None


def pair_within(given: Any, limits: Limits) -> tuple[int | float, int | float] | None:
    """Two numbers within the limits, the smaller first; None for anything else."""
    try:
        low, high = (number_within(each, limits) for each in given)
    except (TypeError, ValueError):
        return None
    return (low, high) if low is not None and high is not None and low <= high else None


LEVELS: dict[str, Level] = {
    level.name: level
    for level in (
        Level(
            name="Easy",
            samples=216,
            length_m=280.0,
            bends=(3, 3),
            width_m=(7.0, 12.0),
            bridges=1,
            islands=0,
            tributaries=0,
            depth_m=1.1,
            depth_variation=0.08,
            fall_m=0.0,
            cut_banks=0.0,
            hills_m=6.0,
            ponds=0,
            plant_density=1.0,
            default_seed=1,
        ),
        Level(
            name="Medium",
            samples=288,
            length_m=374.0,
            bends=(5, 6),
            width_m=(4.0, 16.0),
            bridges=2,
            islands=2,
            tributaries=1,
            depth_m=1.1,
            depth_variation=0.4,
            fall_m=0.0,
            cut_banks=0.6,
            hills_m=8.0,
            ponds=0,
            plant_density=1.0,
            default_seed=1,
        ),
        Level(
            name="Hard",
            samples=328,
            length_m=425.0,
            bends=(8, 12),
            width_m=(3.3, 20.0),
            bridges=4,
            islands=4,
            tributaries=2,
            depth_m=1.2,
            depth_variation=0.75,
            fall_m=3.0,
            cut_banks=1.0,
            hills_m=11.0,
            ponds=1,
            plant_density=1.0,
            default_seed=1,
        ),
    )
}


def level_named(name: str) -> Level:
    """The level of that name, whatever its case; raises `WorldError` that lists the known ones."""
    if not isinstance(name, str):
        raise WorldError(f"a level is a name or a Level, not {name!r}; known: {', '.join(LEVELS)}")
    for known, level in LEVELS.items():
        if known.lower() == name.lower():
            return level
    raise WorldError(f"unknown level {name!r}; known: {', '.join(LEVELS)}")
