"""The known name that a misspelt one is closest to, for error messages."""

import difflib
from collections.abc import Iterable

NEAR = 0.75
"""Least similarity of a suggestion, by `difflib`: one wrong letter in four, or two swapped ones, are near."""
MIN_PART = 3
"""Least number of letters of a part, such as SAC, by which a whole name, such as SACLag, is suggested."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ` (did you mean 'X'?)` for the known name closest to `name`, ignoring case; empty if none is near.

    A part of just one known name counts as near to that one, and so does a name of three letters, such as PP0, that
    differs in one of them from just one known name.
    """
    by_lower = {each.lower(): each for each in known}
    given = name.lower()
    near = difflib.get_close_matches(given, by_lower, 1, NEAR)
    if not near and len(given) == MIN_PART:
        alike = [each for each in by_lower if _differs_in_one_letter(given, each)]
        near = alike if len(alike) == 1 else []
    if not near and len(given) >= MIN_PART:
        wholes = [each for each in by_lower if given in each]
        near = wholes if len(wholes) == 1 else []
    return f" (did you mean {by_lower[near[0]]!r}?)" if near else ""


def _differs_in_one_letter(one: str, other: str) -> bool:
    return len(one) == len(other) and sum(a != b for a, b in zip(one, other, strict=True)) == 1
