"""Which algorithms are there? One dictionary; what runs, lists or documents algorithms reads it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from thalweg.algos.ccepets import CCEPETS, CCEPETSConfig
from thalweg.algos.errors import AlgorithmError
from thalweg.algos.focops import FOCOPS, FOCOPSConfig
from thalweg.algos.interface import Learner, Task
from thalweg.algos.ppo import PPO, PPOConfig
from thalweg.algos.presets import settings_of
from thalweg.algos.safeloop import SafeLOOP, SafeLOOPConfig
from thalweg.algos.settings import config_from


@dataclass(frozen=True)
class Entry:
    """An algorithm by its name in the paper."""

    name: str
    config: type
    """A frozen dataclass; each field's docstring is its help text."""
    make: Callable[[Any, Task], Learner]
    about: str
    """One line."""

    def configure(self, given: Any = None, preset: str = "default") -> Any:
        """The config of a preset, with the given values on top; a whole config stands for itself.

        Raises `AlgorithmError` for an unknown preset or key, listing the known ones, and for a value of the wrong type.
        """
        base = settings_of(self.name, preset)
        return config_from(self.config, {**base, **given} if isinstance(given, Mapping) else given or base)


ALGORITHMS: dict[str, Entry] = {
    entry.name: entry
    for entry in (
        Entry("PPO", PPOConfig, PPO, "clipped policy gradient on the reward alone"),
        Entry(
            "FOCOPS", FOCOPSConfig, FOCOPS, "first-order constrained optimisation within a trust region of each state"
        ),
        Entry("CCEPETS", CCEPETSConfig, CCEPETS, "plans by constrained cross-entropy in an ensemble of learnt models"),
        Entry(
            "SafeLOOP", SafeLOOPConfig, SafeLOOP, "plans like CCEPETS, with an actor that proposes and critics beyond"
        ),
    )
}


def algorithm_named(name: str) -> Entry:
    """The algorithm of that name, whatever its case; raises `AlgorithmError` listing the known ones."""
    for known, entry in ALGORITHMS.items():
        if known.lower() == name.lower():
            return entry
    raise AlgorithmError(f"there is no algorithm {name!r}; there are {', '.join(ALGORITHMS)}")
