"""Policies of the benchmark of the shield, the cells in which each is flown, and the key of a cell's row.

A row tells a policy by what made it, not by its name: a student that is trained anew under the same name has cells of
its own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from thalweg.bench.csv_files import ResultsError
from thalweg.bench.evaluate.baselines import BASELINES, Policy, Sight, sight_of
from thalweg.bench.packaged import PACKAGED, PACKAGED_POLICY
from thalweg.core import versions
from thalweg.core.cache import file_hash
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.train import load_policy
from thalweg.train.run_in_folder import policy_file

KINDS, LEVELS = ("fixed", "unseen", "varied"), ("Medium", "Hard")
EPISODES = 100
"""Flights of each side of a cell."""
VERSIONS = {
    "render": versions.RENDER,
    "world": versions.WORLD,
    "rules": versions.RULES,
    "evaluation": versions.EVALUATION,
    "shield": versions.SHIELD,
}
"""Versions that a cell depends on, by their columns."""
KEY = ("made_by", "kind", "level", "episodes", "settings", *VERSIONS)
"""Columns that identify a cell."""


class Noisy:
    """The steady pilot, some of whose moves are random."""

    sees: Sight = "steady"

    def __init__(self, share: float) -> None:
        self.share = share

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return actions int [N, 4]: `obs`, the pilot's, or random ones."""
        drawn = torch.rand(len(obs), generator=generator).numpy() < self.share
        moves = MOVE_OPTIONS[torch.randint(len(MOVE_OPTIONS), (len(obs),), generator=generator).numpy()]
        return np.where(drawn[:, None], moves, obs)


PILOTS: dict[str, Policy] = {"noise20": Noisy(0.2), "noise50": Noisy(0.5), "random": BASELINES["random"]}
"""Policies without a file."""


@dataclass(frozen=True)
class Arm:
    """A policy and the shield's settings, flown in the cells of some kinds on some levels."""

    policy: str
    """Name on the page."""
    kinds: tuple[str, ...] = KINDS
    levels: tuple[str, ...] = LEVELS
    settings: tuple[str, ...] = ()
    """Settings of the shield that differ from its defaults."""
    path: Path | None = None
    """Of the policy's file, or of the folder of its run; None for one of `PILOTS`."""

    @property
    def made_by(self) -> str:
        """Hash of the policy's file; of a pilot, name and version.

        Raises `OSError` or `AlgorithmError` for a path without a policy.
        """
        if self.path is not None:
            return file_hash(policy_file(self.path))
        steady = sight_of(PILOTS[self.policy]) == "steady"
        return f"{self.policy}/{versions.STEADY if steady else versions.EVALUATION}"


ARMS = (
    Arm(PACKAGED, path=PACKAGED_POLICY),
    Arm("noise20", ("fixed", "unseen")),
    Arm("noise50", ("fixed", "unseen")),
    Arm("random", ("fixed", "unseen")),
    Arm("random", ("fixed",), ("Hard",), ("unknown_is_water=false",)),
)
"""What the table has once every cell is flown."""
NAMES = tuple(dict.fromkeys(arm.policy for arm in ARMS))


@dataclass(frozen=True)
class Pair:
    """A cell: flights of one kind on one level by the policy of an arm, without and with the shield."""

    arm: Arm
    made_by: str
    """That of the arm when the cell was planned."""
    kind: str
    level: str
    episodes: int

    @property
    def key(self) -> tuple[str, ...]:
        """Values of `KEY`."""
        mine = self.made_by, self.kind, self.level, str(self.episodes), " ".join(self.arm.settings)
        return *mine, *map(str, VERSIONS.values())

    def policy(self) -> Any:
        """Return the policy; raises `ResultsError` if its file is no longer that which the cell was planned for."""
        if self.arm.path is None:
            return PILOTS[self.arm.policy]
        policy = load_policy(self.arm.path)
        if self.arm.made_by != self.made_by:
            raise ResultsError(f"{self.arm.path} has changed since its flights were planned")
        return policy


def chosen_arms(
    policies: Sequence[str] | None, others: Sequence[Arm], settings: Sequence[str] | None
) -> tuple[Arm, ...]:
    """Return the arms of `ARMS` with the named policies, then others; None: all, or none beside others.

    `settings` are flown in place of the arms' own, if they are given.
    """
    names = policies if policies is not None else () if others else NAMES
    arms = (*(arm for arm in ARMS if arm.policy in names), *others)
    return arms if settings is None else tuple(replace(arm, settings=tuple(sorted(settings))) for arm in arms)


def names_of(arms: Iterable[Arm]) -> dict[str, str]:
    """Return the names of the arms' policies by what made them; of one that has two, the first."""
    found: dict[str, str] = {}
    for arm in arms:
        found.setdefault(arm.made_by, arm.policy)
    return found


def planned(arms: Sequence[Arm], kinds: Sequence[str], levels: Sequence[str], episodes: int) -> list[Pair]:
    """Return the cells of arms, each once, that are of these kinds and levels."""
    pairs = [
        Pair(arm, made_by, kind, level, episodes)
        for arm, made_by in [(arm, arm.made_by) for arm in arms]
        for kind in arm.kinds
        for level in arm.levels
        if kind in kinds and level in levels
    ]
    return list({pair.key: pair for pair in pairs}.values())


def arm_of_file(text: str) -> Arm:
    """Return the arm of NAME=PATH; raises `ValueError` for another text, or the name of another policy."""
    name, _, path = text.partition("=")
    if not name or not path:
        raise ValueError(f"--policy takes NAME=PATH, not {text!r}")
    if name in NAMES:
        raise ValueError(f"--policy: {name} is the name of another policy")
    return Arm(name, path=Path(path))
