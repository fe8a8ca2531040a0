"""Which policies need no training? Four yardsticks behind the same interface as a trained policy.

They see no frames, so nothing is drawn for them. `sees` says what `act` is given as its observation.
"""

from typing import Literal, Protocol, runtime_checkable

import numpy as np
import torch

from thalweg.algos.policy.policy import Player

Sight = Literal["nothing", "pilot", "frames"]
"""What a policy acts on: nothing, the scripted pilot's actions, or (if it does not say) the latents of frames."""

NONE, FORWARD = 1, 0
"""Values of an action branch: 0 up, left or forward; 1 none; 2 down, right or backward."""


@runtime_checkable
class Remembering(Protocol):
    """A policy that may remember its episodes: each is flown by a player of its own."""

    def player(self, num_envs: int, *, deterministic: bool, generator: torch.Generator) -> Player:
        """The policy in so many environments."""
        ...


class Policy(Protocol):
    """A policy that acts on what it sees alone."""

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Actions int [N, 4] for observations float32 [N, D]."""
        ...


class Random:
    """Every branch of every action at random, all values alike."""

    sees: Sight = "nothing"

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Actions int [N, 4]; there is no deterministic form of this policy, so it samples in any case."""
        return torch.randint(3, (len(obs), 4), generator=generator).numpy()


class Constant:
    """The same action in every step."""

    sees: Sight = "nothing"

    def __init__(self, action: tuple[int, int, int, int]) -> None:
        self.action = np.asarray(action)

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Actions int [N, 4]."""
        return np.tile(self.action, (len(obs), 1))


class Pilot:
    """The scripted pilot, which knows the map: what can be reached, not what can be learnt."""

    sees: Sight = "pilot"

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """The actions int [N, 4] that `obs` already is."""
        return np.asarray(obs)


BASELINES: dict[str, Policy] = {
    "random": Random(),
    "hover": Constant((NONE, NONE, NONE, NONE)),
    "forward": Constant((NONE, NONE, FORWARD, NONE)),
    "pilot": Pilot(),
}
