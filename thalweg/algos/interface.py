"""What passes between learning and the rest: what an algorithm is given, and what it must be able to do.

Letters: N environments, T steps, D numbers of an observation, A numbers of a raw action, F episodes cut off.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium import Space
from torch import Tensor

from thalweg.algos.policy import Policy


@dataclass(frozen=True)
class Task:
    """What an algorithm is made for."""

    obs_size: int
    """D."""
    action_space: Space
    """Of a single environment."""
    num_envs: int
    """N."""
    seed: int
    context: dict[str, Any]
    """Kept in the policy's file."""


@dataclass(frozen=True)
class Rollout:
    """T steps of N environments under one policy, in order; the first may continue episodes of the rollout before."""

    obs: Tensor
    """[T + 1, N, D] float32, what was seen before each step, and after the last one what the next step will start
    from."""
    actions: Tensor
    """[T, N, A], raw."""
    rewards: Tensor
    """[T, N] float32."""
    costs: Tensor
    """[T, N] float32."""
    terminated: Tensor
    """[T, N] bool."""
    truncated: Tensor
    """[T, N] bool, and not terminated."""
    valid: Tensor
    """[T, N] bool; false for a step that only reset an environment (NEXT_STEP), which nothing may be learnt from."""
    final_index: Tensor
    """[F] int64, t * N + n of each truncated step."""
    final_obs: Tensor
    """[F, D] float32, what was seen at the end of those steps, before the reset."""


@dataclass(frozen=True)
class Feedback:
    """What the episodes so far say, for multipliers and schedules; measured by the run, never by a logger."""

    progress: float
    """Share of the run's steps taken before this update's rollout, 0..1."""
    updates_left: int
    """Updates still to come, this one included."""
    cost_mean: float
    """J_c: mean undiscounted cost of the episodes finished in this rollout, or else of the last ones; NaN before
    any."""
    cost_episodes: int
    """How many episodes finished in this rollout: 0 means that `cost_mean` is older."""
    episodes: int
    """Episodes finished since the run began."""
    largest_cost: float
    """The largest cost of any of them."""


class Learner(Protocol):
    """An algorithm at work. `run` owns the environment, the loop, files and clocks; a learner owns its numbers."""

    policy: Policy
    rollout_steps: int
    """T: steps of each environment between updates."""

    def act(self, obs: np.ndarray) -> Tensor:
        """Raw actions [N, A] with exploration, for observations float32 [N, D]."""
        ...

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Learn; returns the metrics of this update. Raises `NotFiniteError` if a loss is NaN."""
        ...

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """What can't work in this run, as sentences by a short code; empty if nothing is known to be wrong."""
        ...

    def state(self) -> dict[str, Any]:
        """Everything that learning needs to go on: nested dictionaries of arrays and plain data."""
        ...

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`; afterwards learning goes on to the last bit as if never interrupted."""
        ...
