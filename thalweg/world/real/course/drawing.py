"""Contents of a file about a river: ways of water, banks, islands and bridges, sorted by their tags."""

from collections import Counter
from dataclasses import dataclass

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.features import Feature, FeatureList
from thalweg.world.real.sources.tags import is_tagged_water, role_of


@dataclass(frozen=True)
class Drawing:
    """The features of a file by what they are for a river."""

    ways: tuple[Feature, ...]
    """Lines of water."""
    banks: tuple[Feature, ...]
    """Polygons of water."""
    islands: tuple[Feature, ...]
    """Polygons of islands, beside the holes in those of water."""
    bridges: tuple[Feature, ...]
    """Lines of bridges."""
    name: str | None
    """Name of the river, if there is just one."""


def sort_features(found: FeatureList, river_name: str | None) -> Drawing:
    """Return the drawing of a river; `river_name` chooses among several rivers.

    Where some water is tagged as water, lines and polygons without any tags are not water. Raises `WorldError` for a
    file without water, or without water of that name.
    """
    by_role: dict[str, list[Feature]] = {role: [] for role in ("way", "banks", "island", "bridge", "other")}
    for feature in found.features:
        by_role[role_of(feature.kind, feature.tags)].append(feature)
    ways, banks = by_role["way"], by_role["banks"]
    if any(is_tagged_water(feature.tags) for feature in (*ways, *banks)):
        ways, banks = ([each for each in group if is_tagged_water(each.tags)] for group in (ways, banks))
    if not ways and not banks:
        raise WorldError(_without_water(found, by_role))
    if river_name is not None:
        ways, banks = _named(river_name, ways, banks)
    return Drawing(
        tuple(ways), tuple(banks), tuple(by_role["island"]), tuple(by_role["bridge"]), _only_name(ways, banks)
    )


def _without_water(found: FeatureList, by_role: dict[str, list[Feature]]) -> str:
    """Return the message for a file without water."""
    counts = Counter(
        {
            "bridge": len(by_role["bridge"]),
            "island": len(by_role["island"]),
            "other line": sum(each.kind == "line" for each in by_role["other"]),
            "other polygon": sum(each.kind == "polygon" for each in by_role["other"]),
        }
    )
    kinds = (counts + found.others).items()
    seen = ", ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in kinds)
    instead = f", but {seen}" if seen else ": it is empty"
    return (
        f"no water way in it{instead}; expected a line of the river, such as one with waterway=river or without "
        "tags, or a polygon of its banks, such as one with natural=water"
    )


def name_of(feature: Feature) -> str | None:
    """Return the name of a feature, None for one without."""
    name = feature.tags.get("name")
    return " ".join(name.encode("utf-8", "replace").decode().split()) or None if isinstance(name, str) else None


def _named(river_name: str, ways: list[Feature], banks: list[Feature]) -> tuple[list[Feature], list[Feature]]:
    """Return the ways and banks of that name; with ways of that name, banks may have none."""
    wanted = river_name.casefold().strip()
    chosen = [each for each in ways if (name_of(each) or "").casefold() == wanted]
    allowed = (wanted, "") if chosen else (wanted,)
    kept = [each for each in banks if (name_of(each) or "").casefold() in allowed]
    if not chosen and not kept:
        names = sorted({name for each in (*ways, *banks) if (name := name_of(each))})
        known = f"the names are {', '.join(names[:8])}" if names else "no water in it has a name"
        raise WorldError(f"no water is named {river_name!r}; {known}")
    return chosen, kept


def _only_name(ways: list[Feature], banks: list[Feature]) -> str | None:
    """Return the name of all ways that have one, else of all banks; None if there are several or none."""
    for group in (ways, banks):
        names = {name for each in group if (name := name_of(each))}
        if names:
            return names.pop() if len(names) == 1 else None
    return None
