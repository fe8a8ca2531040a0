"""Kinds of banks along a river as data: which reaches of which bank are meadow, reeds or quay; the rest is forest."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from numbers import Real
from typing import Any

from thalweg.core.suggestion import did_you_mean
from thalweg.world.errors import WorldError

KINDS = ("forest", "meadow", "reeds", "quay")
"""`forest`: sand, grass and a wall of trees, the banks of the levels. `meadow`: grass to the water's edge, the forest
set back. `reeds`: a belt of reeds in the shallows and on the wet bank, before the forest. `quay`: a steep wall of stone
at the water's edge, paved behind, with a row of trees."""
SIDES = ("both", "left", "right")
"""Banks, as seen in the direction of growing arc length."""
QUAY_WALL_M = 1.15
"""Height of a quay's wall above the water."""
QUAY_SLOPE = 2.2
"""Slope of the wall, above and under water, on a map whose nodes are not too far apart for it: about 66 degrees."""
QUAY_CELLS = 2.0
"""Least width of the wall in nodes; a steeper one would look like a staircase."""
QUAY_TOE_M, QUAY_TOE_SLOPE = 0.25, 0.4
"""Width and slope of the stones at the foot of the wall, on either side of the water's edge. Nodes in the water hold
its level: right at a steep wall the surface between them and those on land would stand out of the water."""
QUAY_FALL = 0.02
"""Slope of the pavement, which drains to the water."""
QUAY_COPING_M = 0.45
"""Width of the stones along the edge."""
QUAY_PAVED_M = 4.7
"""Width of the pavement, from the edge to the curb."""
MOST_REACHES = 100
"""Most reaches of a river."""
FORM = "a kind, such as meadow, or a reach, such as quay_120-180_left (from 120 to 180 m along the course)"
NUMBER = r"\d{1,6}(?:\.\d{1,3})?"
SPAN = re.compile(rf"({NUMBER})-({NUMBER})(?:m)?")


@dataclass(frozen=True)
class BankReach:
    """A stretch of one bank or both, and its kind."""

    kind: str
    """One of `KINDS`."""
    start_m: float = 0.0
    """Arc length at which it begins, rounded to millimetres."""
    end_m: float | None = None
    """Arc length at which it ends, rounded too, on a loop also before `start_m`; None for the end of the course."""
    side: str = "both"
    """One of `SIDES`."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise WorldError(
                f"banks: unknown kind {self.kind!r}{did_you_mean(str(self.kind), KINDS)}; known: {', '.join(KINDS)}"
            )
        if self.side not in SIDES:
            raise WorldError(f"banks: the side of {self.kind} is {self.side!r}; expected {', '.join(SIDES)}")
        for name in ("start_m", "end_m"):
            value = getattr(self, name)
            if name == "end_m" and value is None:
                continue
            if (metres := _metres(value)) is None:
                raise WorldError(f"banks: {name} of {self.kind} is {value!r:.40}; expected metres of at least 0")
            # What is written of a reach is then the reach itself: names of levels and caches are made of it.
            object.__setattr__(self, name, round(metres, 3))
        if self.end_m == self.start_m:
            raise WorldError(f"banks: the reach of {self.kind} begins and ends at {self.start_m:g} m; it has no length")

    @property
    def text(self) -> str:
        """The reach as `read_banks` reads it, such as quay_120-180_left."""
        words = [self.kind]
        if self.end_m is not None:
            words.append(f"{_written(self.start_m)}-{_written(self.end_m)}")
        elif self.start_m > 0:
            words.append(f"{_written(self.start_m)}-")
        return "_".join(words if self.side == "both" else [*words, self.side])


Banks = tuple[BankReach, ...]
"""Reaches of a river; where several overlap, the last one counts. Empty for forest alone."""


def read_banks(value: Any) -> Banks:
    """Return the reaches that a value says.

    A text is a kind for all banks, or reaches joined by `+`: `meadow`, `reeds_left`, `meadow+quay_120-180_left`; spaces
    stand for `_` as well. Also a `BankReach`, a dictionary of its fields, or a sequence of any of these; None and an
    empty sequence are forest alone. Raises `WorldError` for anything else, and says what would be right.
    """
    reaches = parse_banks(value)
    # What a later reach covers altogether, and forest that nothing lies under, changes nothing.
    whole = [index for index, reach in enumerate(reaches) if _is_whole(reach)]
    reaches = reaches[whole[-1] if whole else 0 :]
    while reaches and reaches[0].kind == "forest":
        reaches = reaches[1:]
    return reaches


def parse_banks(value: Any) -> Banks:
    """Return every reach that a value names, as `read_banks` reads it, those without an effect too."""
    reaches = tuple(_reaches(value))
    if len(reaches) > MOST_REACHES:
        raise WorldError(f"banks: {len(reaches)} reaches; limit {MOST_REACHES}")
    return reaches


def text_of(banks: Banks) -> str:
    """Return banks as a text that `read_banks` reads; that of forest alone is `forest`."""
    return "+".join(reach.text for reach in banks) or "forest"


def as_data(banks: Banks) -> list[dict[str, Any]]:
    """Return banks as plain data that `read_banks` reads."""
    return [asdict(reach) for reach in banks]


def has_kind(banks: Banks, kind: str) -> bool:
    """Return whether some reach is of a kind."""
    return any(reach.kind == kind for reach in banks)


def quay_slope(cell_m: float) -> float:
    """Return the slope of a quay's wall on a map whose nodes are `cell_m` apart."""
    return min(QUAY_SLOPE, QUAY_WALL_M / (QUAY_CELLS * cell_m))


def quay_run_m(cell_m: float) -> float:
    """Return the distance from the water's edge to the top of a quay's wall."""
    return QUAY_TOE_M + QUAY_WALL_M / quay_slope(cell_m)


def check_banks(banks: Banks, length_m: float, closed: bool) -> None:
    """Raise `WorldError` for a reach that is not on a course of this length."""
    for reach in banks:
        end = length_m if reach.end_m is None else reach.end_m
        # Ends are rounded to millimetres, which may lead past that of the course.
        if end > length_m + 1e-3 or reach.start_m >= length_m:
            raise WorldError(
                f"banks: {reach.text} is not on the course, which is {length_m:.1f} m long; expected 0 to "
                f"{length_m:.1f} m"
            )
        if end < reach.start_m and not closed:
            raise WorldError(
                f"banks: {reach.text} ends before it begins; on an open course, give the smaller distance first"
            )


def _reaches(value: Any) -> Iterable[BankReach]:
    if value is None:
        return
    if isinstance(value, BankReach):
        yield value
    elif isinstance(value, str):
        for part in value.split("+"):
            yield _reach_of_text(part)
    elif isinstance(value, Mapping):
        known = [field.name for field in fields(BankReach)]
        if unknown := [key for key in value if key not in known]:
            raise WorldError(f"banks: unknown key {unknown[0]!r}; known: {', '.join(known)}")
        if "kind" not in value:
            raise WorldError(f"banks: {dict(value)!r} has no kind; expected one of {', '.join(KINDS)}")
        yield BankReach(**value)
    elif isinstance(value, Iterable) and not isinstance(value, bytes):
        for part in value:
            yield from _reaches(part)
    else:
        raise WorldError(f"banks are {value!r}; expected {FORM}")


def _reach_of_text(text: str) -> BankReach:
    """Return the reach of a text: a kind, then a span and a side, which may be left out."""
    words = text.replace("_", " ").split()
    if not words or len(words) > 3:
        raise WorldError(f"banks: {text!r} is no reach; expected {FORM}")
    kind, *rest = words
    BankReach(kind.lower())
    given: dict[str, Any] = {}
    for word in rest:
        span = SPAN.fullmatch(word) or re.fullmatch(rf"({NUMBER})-()", word)
        if span is not None and "start_m" not in given:
            given |= {"start_m": float(span[1]), "end_m": float(span[2]) if span[2] else None}
        elif word.lower() in SIDES and "side" not in given:
            given["side"] = word.lower()
        else:
            raise WorldError(f"banks: {word!r} in {text!r} is neither a span such as 120-180 nor left, right or both")
    return BankReach(kind.lower(), **given)


def _is_whole(reach: BankReach) -> bool:
    """Return whether a reach is all of both banks."""
    return reach.start_m == 0.0 and reach.end_m is None and reach.side == "both"


def _metres(value: Any) -> float | None:
    """Return a number of at least 0 as a float, None for anything else and for one that no float holds."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        return metres if 0 <= (metres := float(value)) < math.inf else None
    except OverflowError:
        return None


def _written(metres: float) -> str:
    return f"{metres:.3f}".rstrip("0").rstrip(".")
