"""The meaning of tags, mostly of OpenStreetMap: what is water, an island or a bridge, and how wide it is."""

import re
from collections.abc import Mapping
from typing import Any, Literal

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.json_values import is_number, shortened

Role = Literal["way", "banks", "island", "bridge", "other"]
FLOWING = ("river", "stream", "canal", "tidal_channel", "drain", "ditch", "link", "fairway", "wadi")
"""Values of `waterway` that are lines of water; others are dams, weirs, docks and the like."""
RIVER_WATER = ("river", "stream", "canal", "oxbow", "ditch", "drain", "lock", "tidal")
"""Values of `water` that are parts of a river; others are ponds, lakes and the like."""
FOREIGN = (
    "highway", "railway", "aeroway", "aerialway", "barrier", "power", "building", "landuse", "leisure", "amenity",
    "boundary", "man_made", "natural", "place", "route", "water", "landcover", "tourism", "historic",
)  # fmt: skip
"""Keys of features that are neither water nor over it."""
NO = ("no", "false", "0", False, 0)
WIDTH_KEYS = ("width_m", "width", "est_width")
"""Properties with a width, the first that is there counts."""
METRES_OF = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "cm": 0.01,
    "km": 1000.0,
    "ft": 0.3048,
    "feet": 0.3048,
    "foot": 0.3048,
}
LENGTH = re.compile(r"~?\s*(\d{1,6}(?:[.,]\d{1,2}|\.\d+)?)\s*(m|cm|km|ft|feet|foot|met(?:re|er)s?)?\.?", re.IGNORECASE)
FEET = re.compile(r"(\d{1,4})'\s*(?:(\d{1,2}(?:\.\d+)?)\")?")
LANES = re.compile(r"[1-9][0-9]?")
DECK_M = {
    "footway": 3.0, "path": 3.0, "cycleway": 3.5, "pedestrian": 4.0, "steps": 3.0, "bridleway": 3.0, "track": 4.0,
    "service": 4.0,
}  # fmt: skip
"""Width of the deck of a bridge without a width, by its `highway`."""
LANE_M, ROAD_LANES, RAILWAY_M, PLAIN_DECK_M = 3.25, 2, 5.0, 3.2
"""Width of a lane, number of lanes of other roads, and width of a railway's deck and of one without tags."""


def role_of(kind: str, tags: Mapping[str, Any]) -> Role:
    """Return what a line or a polygon with these tags is for a river; without tags it is the river itself."""
    if kind == "line":
        if "waterway" in tags:
            return "way" if tags["waterway"] in FLOWING else "other"
        if tags.get("bridge", "no") not in NO or tags.get("man_made") == "bridge":
            return "bridge"
        return "other" if any(key in tags for key in FOREIGN) else "way"
    if tags.get("place") in ("islet", "island"):
        return "island"
    if tags.get("natural") == "water":
        return "banks" if tags.get("water", "river") in RIVER_WATER else "other"
    if "waterway" in tags:
        return "banks" if tags["waterway"] in ("riverbank", *FLOWING) else "other"
    return "other" if any(key in tags for key in FOREIGN) else "banks"


def is_tagged_water(tags: Mapping[str, Any]) -> bool:
    """Return whether the tags say that it is water, not only that it is nothing else."""
    return "waterway" in tags or tags.get("natural") == "water"


def metres(value: Any, name: str) -> float:
    """Return a length in metres: a number, or text such as "14 m", "14,5", "46 ft" or "16'3\\"".

    Raises `WorldError`, in which `name` says whose length it is, for anything else and for 0 or less.
    """
    found = value
    if isinstance(value, str):
        found = _metres_of_text(value.strip())
    if found is None or not isinstance(found, int | float) or not is_number(found) or found <= 0:
        raise WorldError(f"{name} is {shortened(value)}; expected a number of metres above 0, or text such as 14 m")
    return float(found)


def _metres_of_text(text: str) -> float | None:
    """Return the metres that a text means, or None."""
    if feet := FEET.fullmatch(text):
        return 0.3048 * (int(feet[1]) + float(feet[2] or 0) / 12)
    match = LENGTH.fullmatch(text)
    if match is None:
        return None
    unit = (match[2] or "m").lower()
    return float(match[1].replace(",", ".")) * METRES_OF[unit.rstrip("s") if unit.startswith("met") else unit]


def width_value(tags: Mapping[str, Any]) -> tuple[str, Any] | None:
    """Return the property that gives a width and its value; None if there is none."""
    return next(((key, tags[key]) for key in WIDTH_KEYS if tags.get(key) is not None), None)


def deck_width(tags: Mapping[str, Any], label: str) -> float:
    """Return the width of a bridge's deck in metres: its own, or that of its kind of road."""
    if (given := width_value(tags)) is not None:
        return metres(given[1], f"{given[0]} of {label}")
    if "highway" in tags:
        lanes = tags.get("lanes", ROAD_LANES)
        count = float(lanes) if LANES.fullmatch(str(lanes)) else ROAD_LANES
        return DECK_M.get(str(tags["highway"]), LANE_M * count)
    return RAILWAY_M if "railway" in tags else PLAIN_DECK_M
