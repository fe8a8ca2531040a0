"""Which algorithms are there? One dictionary; what runs, lists or documents algorithms reads it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from thalweg.algos.errors import AlgorithmError
from thalweg.algos.focops import FOCOPS, FOCOPSConfig
from thalweg.algos.interface import Learner, Task
from thalweg.algos.ppo import PPO, PPOConfig


@dataclass(frozen=True)
class Entry:
    """An algorithm by its name in the paper."""

    name: str
    config: type
    """A frozen dataclass; each field's docstring is its help text."""
    make: Callable[[Any, Task], Learner]
    about: str
    """One line."""


ALGORITHMS: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        Entry("PPO", PPOConfig, PPO, "clipped policy gradient on the reward alone"),
        Entry(
            "FOCOPS", FOCOPSConfig, FOCOPS, "first-order constrained optimisation within a trust region of each state"
        ),
    )
}


def algorithm_named(name: str) -> Entry:
    """The algorithm of that name, whatever its case; raises `AlgorithmError` listing the known ones."""
    for known, entry in ALGORITHMS.items():
        if known.lower() == name.lower():
            return entry
    raise AlgorithmError(f"there is no algorithm {name!r}; there are {', '.join(ALGORITHMS)}")
