"""Baselines: five policies that need no training, with the interface of a trained policy.

They see no frames, so none are rendered for them. Their attribute `sees` names the observation that `act` takes.
"""

from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
import torch

from thalweg.algos.policy.player import Player
from thalweg.train.observations import IMAGES, PRIVILEGED, observation_of

Sight = Literal["nothing", "scripted", "steady", "privileged", "frames", "images"]
"""Observation of a policy: nothing, the scripted or the steady pilot's actions, the privileged observation
(`thalweg.env.task.ideal_eye`), latents of frames (the default), or images."""
DRAWN: tuple[Sight, ...] = ("frames", "images")
"""Observations for which frames are drawn."""

NONE, FORWARD = 1, 0
"""Values of an action branch: 0 up, left or forward; 1 none; 2 down, right or backward."""


@runtime_checkable
class RecurrentPolicy(Protocol):
    """A policy that may have a memory: a player of its own acts in each episode."""

    def player(self, num_envs: int, *, deterministic: bool, generator: torch.Generator) -> Player:
        """Return a player for a number of environments."""
        ...


class Policy(Protocol):
    """A policy without memory."""

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return actions int [N, 4] for observations float32 [N, D], or images uint8 [N, H, W, C]."""
        ...


def sight_of(policy: Any) -> Sight:
    """Return what a policy sees: what it says itself, or what it was trained on.

    Raises `TrainingError` for a policy that was trained on something that rivers do not show.
    """
    if hasattr(policy, "sees"):
        return policy.sees
    seen = observation_of(policy)
    if seen in IMAGES:
        return "images"
    return "privileged" if seen == PRIVILEGED else "frames"


class Random:
    """Samples every branch of every action uniformly."""

    sees: Sight = "nothing"

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return actions int [N, 4]; they are sampled even if `deterministic`, since the most probable action is not
        unique."""
        return torch.randint(3, (len(obs), 4), generator=generator).numpy()


class Constant:
    """Takes the same action in every step."""

    sees: Sight = "nothing"

    def __init__(self, action: tuple[int, int, int, int]) -> None:
        self.action = np.asarray(action)

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return actions int [N, 4]."""
        return np.tile(self.action, (len(obs), 1))


class Pilot:
    """A pilot that knows the map: it shows what is possible, not what can be learned from frames."""

    def __init__(self, sees: Literal["scripted", "steady"]) -> None:
        """`sees`: which of them."""
        self.sees: Sight = sees

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        """Return `obs`, which are the pilot's actions int [N, 4]."""
        return np.asarray(obs)


BASELINES: dict[str, Policy] = {
    "random": Random(),
    "hover": Constant((NONE, NONE, NONE, NONE)),
    "forward": Constant((NONE, NONE, FORWARD, NONE)),
    "pilot": Pilot("scripted"),
    "steady": Pilot("steady"),
}
