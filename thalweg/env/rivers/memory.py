"""Memory of rivers: the size of one, and how many fit into the free memory."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from thalweg.env.config import ConfigError
from thalweg.world import World

SHARE = 0.5
"""Share of the free memory that rivers may take; the encoder, the learner and its buffers need the rest."""

RIVERS_EACH = 3
"""Rivers that an environment needs in memory, where not all of them are there."""

DRAWN = 2.4
"""Bytes of a world and of the tables from which it is drawn, for each byte of the world: 2.2 to 2.4 on all levels."""


def drawn_bytes(world: World) -> int:
    """Return about how many bytes a world takes where it is drawn."""
    return int(DRAWN * bytes_of(world))


def bytes_of(record: Any) -> int:
    """Return the bytes of all arrays in a record, nested ones included."""
    if isinstance(record, np.ndarray):
        return record.nbytes
    return sum(bytes_of(getattr(record, each.name)) for each in fields(record)) if is_dataclass(record) else 0


def slots_in_memory(rivers: int, in_memory: int | None, num_envs: int, each: int, free: int | None) -> int:
    """Return the number of slots for a list of rivers of `each` bytes: all of them if they fit, else fewer.

    Without room for all, an environment needs up to three rivers: that of its episode, that of the last one, whose
    final observation is still to be made, and the next one, which is being prepared outside the slots. Raises
    `ConfigError`, with the number that fits, for fewer than that.
    """
    least = RIVERS_EACH * num_envs
    if in_memory is None:
        most = _most_that_fit(rivers, each, free)
        if rivers > most and most < least:
            raise ConfigError(
                f"{num_envs:,} environments that change river need {min(rivers, least):,} rivers of"
                f" {each / 1e6:.1f} MB in memory, and {free_words(free)}, of which rivers may take half: at most"
                f" {most:,} rivers fit, enough for {most // RIVERS_EACH:,} environments, or for lists of at most"
                f" {most:,} rivers"
            )
    else:
        check_enough(rivers, in_memory, num_envs)
        most = in_memory
        needed = min(rivers, most) * each
        if free is not None and needed > free:
            raise ConfigError(
                f"in_memory = {most:,} rivers of {each / 1e6:.1f} MB take {needed / 1e9:.2f} GB, and"
                f" {free_words(free)}: at most {free // max(each, 1):,} fit"
            )
    return rivers if rivers <= most else most - num_envs


def check_enough(rivers: int, in_memory: int, num_envs: int) -> None:
    """Raise `ConfigError` for fewer rivers in memory than environments need that change among so many rivers."""
    least = min(rivers, RIVERS_EACH * num_envs)
    if in_memory < least:
        raise ConfigError(
            f"in_memory must be at least {least:,} for {rivers:,} rivers and {num_envs:,}"
            f" environments, not {in_memory:,}: three rivers for each environment, or all of them"
        )


def check_all_fit(rivers: int, each: int, free: int | None) -> None:
    """Raise `ConfigError`, with the number that fits, for rivers of `each` bytes of which none may be left out."""
    most = _most_that_fit(rivers, each, free)
    if rivers > most:
        raise ConfigError(
            f"{rivers:,} rivers of {each / 1e6:.1f} MB need {rivers * each / 1e9:.2f} GB, and {free_words(free)}, of"
            f" which rivers may take half: at most {most:,} fit"
        )


def _most_that_fit(rivers: int, each: int, free: int | None) -> int:
    """Return how many rivers of `each` bytes fit into the share of the free memory; all if that is unknown."""
    return rivers if free is None else int(SHARE * free) // max(each, 1)


def free_words(free: int | None) -> str:
    """Return the free memory in words."""
    return "the free memory is unknown" if free is None else f"{free / 1e9:.2f} GB of memory are free"
