"""Lists of seeds as people write them: whole numbers, and ranges such as 1000:1016, whose end is excluded."""

import contextlib
import operator
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

UNSEEN = 100_000
"""Seed of the first unseen river of a level; trainings refuse it and later seeds."""
RANGE = re.compile(r"([0-9](?:_?[0-9]){0,39}):([0-9](?:_?[0-9]){0,39})")
MAX_SEED = 2**63 - 1
"""Greatest seed that commands and suites take: compiled code and PyTorch hold whole numbers of 64 bits."""
MAX_SEEDS = 1_000_000
"""Greatest number of seeds in a list: more is a slip, such as a date."""
LONGEST_LISTED = 16
"""Consecutive seeds up to this number are listed one by one in files, more are written as a range."""


def parse_seeds(given: Any, what: str = "seeds", error: type[ValueError] = ValueError) -> tuple[int, ...]:
    """Return the seeds in a whole number, a `range`, a text such as "0 5 1000:1016", or a list of these.

    Raises `error`, whose message begins with `what`, for anything else, a negative seed, a range without a seed, and a
    seed that is given twice.
    """
    seeds: list[int] = []
    for part in _parts(given, what, error):
        found = _range(part, what, error) if isinstance(part, str | range) else [_seed(part, what, error)]
        if len(seeds) + _count(found) > MAX_SEEDS:
            raise error(f"{what}: {part} has too many seeds; at most {MAX_SEEDS:,} can be given")
        seeds.extend(found)
    known: set[int] = set()
    for seed in seeds:
        if seed in known:
            raise error(f"{what}: the seed {seed} is given twice")
        known.add(seed)
    return tuple(seeds)


def refuse_unseen(seeds: Sequence[int], what: str, error: type[ValueError]) -> None:
    """Raise `error`, whose message begins with `what`, for seeds of levels' rivers to train on that are `UNSEEN` or
    later."""
    if (seed := max(seeds, default=0)) >= UNSEEN:
        raise error(
            f"{what}: rivers from seed {UNSEEN:,} on are kept for flights on unseen rivers, and nothing is trained on"
            f" them; give lower seeds, not {seed:,}"
        )


def compact_seeds(seeds: Iterable[int]) -> list[int | str]:
    """Return seeds as plain data for files: long runs of consecutive ones as "1000:1256", others as numbers.

    `parse_seeds` returns the same seeds again.
    """
    seeds = list(seeds)
    ends = [0, *(i for i, (a, b) in enumerate(pairwise(seeds), 1) if b != a + 1), len(seeds)]
    data: list[int | str] = []
    for first, end in pairwise(ends):
        run = seeds[first:end]
        data += run if len(run) <= LONGEST_LISTED else [f"{run[0]}:{run[-1] + 1}"]
    return data


def _parts(given: Any, what: str, error: type[ValueError]) -> list[Any]:
    """Return the parts of a list of seeds: whole numbers, ranges, and words of texts."""
    if isinstance(given, str):
        return given.split()
    if isinstance(given, range) or not hasattr(given, "__iter__") or getattr(given, "ndim", 1) == 0:
        return [given]  # an array without axes cannot be iterated, though it has the method
    if isinstance(given, dict | bytes):
        raise error(f"{what} must be a list of seeds and ranges such as 1000:1016, not {given!r}")
    return [part for each in given for part in (each.split() if isinstance(each, str) else [each])]


def _range(part: str | range, what: str, error: type[ValueError]) -> range:
    """Return the seeds of a word or a range."""
    if isinstance(part, range):
        if not part:
            raise error(f"{what}: {part} holds no seed")
        if (least := min(part[0], part[-1])) < 0:
            raise error(f"{what}: a seed must be 0 or more, not {least}")
        return part
    if (match := RANGE.fullmatch(part)) is None:
        seed = _seed(_number(part), what, error, part)
        return range(seed, seed + 1)
    first, end = (int(number) for number in match.groups())
    if end <= first:
        hint = f"write {end}:{first}" if end < first else f"its end is excluded: write {first}:{first + 1}"
        raise error(f"{what}: {part} holds no seed; {hint}")
    return range(first, end)


def _count(seeds: range | list[int]) -> int:
    """Return the number of seeds; that of a range may be too large for `len`."""
    return len(seeds) if isinstance(seeds, list) else -((seeds.start - seeds.stop) // seeds.step)


def _number(word: str) -> int | float | None:
    """Return the number that a word such as 5, 1_000 or 2e5 stands for, or None."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(word)
    return None


def _seed(value: object, what: str, error: type[ValueError], written: str = "") -> int:
    """Return a seed as an integer; `written` is how it was given."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    try:
        seed = None if isinstance(value, bool) else operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        seed = None
    if seed is None:
        raise error(
            f"{what} must be whole numbers of at least 0, or ranges such as 1000:1016, whose end is excluded;"
            f" not {written or value!r}"
        )
    if seed < 0:
        raise error(f"{what}: a seed must be 0 or more, not {seed}")
    return seed
