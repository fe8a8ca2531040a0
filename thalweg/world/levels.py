"""The difficulty levels as data, and the `Level` record for custom ones.

The scenes of the paper are not public; these levels follow its order of difficulty and its stated features.
"""

import hashlib
import math
import operator
import re
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from thalweg.core.suggestion import did_you_mean
from thalweg.world.banks import Banks, parse_banks, read_banks, text_of
from thalweg.world.errors import WorldError
from thalweg.world.validation import CLEARANCE_M, MAX_SAMPLES, MIN_LENGTH_M, MIN_SAMPLES


class Limits(NamedTuple):
    """The allowed values of a number or a pair of numbers of a `Level`."""

    integer: bool
    low: float
    high: float
    pair: bool = False

    def __str__(self) -> str:
        kind = ("two " if self.pair else "a ") + ("whole number" if self.integer else "number") + "s" * self.pair
        span = f"of at least {self.low:g}" if self.high == math.inf else f"from {self.low:g} to {self.high:g}"
        return f"{kind} {span}" + ", the smaller first" * self.pair


LIMITS = {
    "samples": Limits(True, MIN_SAMPLES[True], MAX_SAMPLES),
    "length_m": Limits(False, MIN_LENGTH_M[True], 10_000),
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
"""Limits of each number of a `Level`. Within them, a level may still ask for more than fits along a river."""
NAME = re.compile(r"\w[\w .+-]{0,63}", re.ASCII)
"""Characters of a level's name, which appears in tables, file names and pictures."""
MIN_WIDTH_RANGE_M = 0.3
"""Minimum difference between the widest and the narrowest width."""


@dataclass(frozen=True)
class Level:
    """Everything the generator may choose from; two levels with the same data give the same rivers.

    Numbers are converted to one type, so that 280 and 280.0 are the same. Raises `WorldError` that names an invalid
    field.
    """

    name: str
    """Name in files and tables."""
    samples: int
    """Exact number of river samples and, the course being closed, of segments."""
    length_m: float
    """Length of the loop; a river differs from it by at most one percent."""
    bends: tuple[int, int]
    """Minimum and maximum number of bends over 30 degrees, as `geometry.bend_count` counts them."""
    width_m: tuple[float, float]
    """Minimum and maximum width; each river comes near both."""
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
    """Fall of the water level along the loop, regained in one rapid."""
    cut_banks: float
    """0 to 1, steepness of the outer banks of bends."""
    hills_m: float
    """Height of the hills above the flood plain, far from the river."""
    ponds: int
    """Number of ponds inside the loop."""
    plant_density: float
    """Number of plants per area, relative to a dense forest."""
    default_seed: int
    """Seed of the level's fixed river."""
    banks: Banks = ()
    """Reaches whose banks are not forest, as `thalweg.world.banks.read_banks` takes them. They stand in the name too,
    such as `Medium+meadow`, in place of others that it ends with, and change no course."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "banks", read_banks(self.banks))
        if not isinstance(self.name, str) or not NAME.fullmatch(self.base_name):
            raise WorldError(
                f"level {self.name!r}: name must be letters, digits, spaces and . + - _, not {self.name!r}"
            )
        for field in fields(self)[1:-1]:
            value, limits = getattr(self, field.name), LIMITS[field.name]
            parsed = parse_pair(value, limits) if limits.pair else parse_number(value, limits)
            if parsed is None:
                raise WorldError(f"level {self.name!r}: {field.name} must be {limits}, not {value!r}")
            object.__setattr__(self, field.name, parsed)
        if self.width_m[1] - self.width_m[0] < MIN_WIDTH_RANGE_M:
            raise WorldError(
                f"level {self.name!r}: width_m must differ by at least {MIN_WIDTH_RANGE_M} m, not {self.width_m}"
            )
        object.__setattr__(self, "name", self.base_name + (f"+{text_of(self.banks)}" if self.banks else ""))

    @property
    def base_name(self) -> str:
        """Name of the level with banks of forest."""
        for place, character in enumerate(self.name):
            if character == "+" and _names_banks(self.name[place + 1 :]):
                return self.name[:place]
        return self.name

    @property
    def key(self) -> int:
        """A 64-bit hash of all the data except the default seed and the banks: levels that differ in those alone have
        the same courses."""
        names = [field.name for field in fields(self) if field.name not in ("name", "default_seed", "banks")]
        data = repr((self.base_name, *(getattr(self, name) for name in names))).encode()
        return int.from_bytes(hashlib.sha256(data).digest()[:8], "little")

    def with_banks(self, banks: Any) -> "Level":
        """Return the level with banks that `thalweg.world.banks.read_banks` takes, such as "meadow"."""
        return replace(self, banks=banks)


def _names_banks(text: str) -> bool:
    """Return whether a text names reaches of banks."""
    try:
        parse_banks(text)
    except WorldError:
        return False
    return True


def parse_number(value: Any, limits: Limits) -> int | float | None:
    """Return the number as a plain `int` or `float`, or None if it is not such a number or outside its limits."""
    if isinstance(value, bool | str | bytes):
        return None
    try:
        number = operator.index(value) if limits.integer else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return number if limits.low <= number <= limits.high else None


def parse_pair(values: Any, limits: Limits) -> tuple[int | float, int | float] | None:
    """Return two numbers within the limits, the smaller first, or None for anything else."""
    try:
        low, high = (parse_number(each, limits) for each in values)
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


DEEP_LEVELS: dict[str, Level] = {
    level.name: level
    for level in (
        replace(LEVELS["Medium"], name="Medium-Deep", width_m=(4.5, 16.0), depth_m=1.6, depth_variation=0.3),
        replace(LEVELS["Hard"], name="Hard-Deep", width_m=(4.2, 20.0), depth_m=2.2, depth_variation=0.4),
    )
}
"""Medium and Hard with water enough for a boat of 2 m by 1.08 m that draws 0.32 m, beside every island too. On Hard
itself it would lie on the ground, and on Medium it could not always avoid shallows; Easy has room as it is."""
ALL_LEVELS: dict[str, Level] = LEVELS | DEEP_LEVELS
"""Everything that has a name."""


def level_named(name: str) -> Level:
    """Return the level with that name, in any case; raises `WorldError` that lists the known levels.

    Kinds of banks may follow, such as `Medium+meadow` or `Hard+reeds+quay_120-180_left`.
    """
    if not isinstance(name, str):
        raise WorldError(f"a level is a name or a Level, not {name!r}; known: {', '.join(ALL_LEVELS)}")
    base, plus, banks = name.partition("+")
    for known, level in ALL_LEVELS.items():
        if known.lower() == base.strip().lower():
            return level.with_banks(banks) if plus else level
    raise WorldError(f"unknown level {base!r}{did_you_mean(base, ALL_LEVELS)}; known: {', '.join(ALL_LEVELS)}")


def on_banks(level: str, banks: Any) -> str:
    """Return the name of a level with banks in place of its own; raises `WorldError` for an unknown level or kind."""
    return level_named(level).with_banks(banks).name
