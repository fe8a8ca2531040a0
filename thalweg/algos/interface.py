"""Records that pass between a run and an algorithm, and the protocol that every algorithm implements.

Letters: N environments, T steps, D numbers of an observation, K frames seen side by side, A numbers of a raw action,
M costs, F episodes cut off, C numbers that only critics see.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from gymnasium import Space
from torch import Tensor

from thalweg.algos.common.state import CPU
from thalweg.algos.policy.policy import AnyPolicy

RECENT_EPISODES = 100
"""Least number of last episodes whose costs a learner receives, see `recent_episodes`."""
MEAN_EPISODES = 50
"""Number of last episodes in the means that are logged, as in the study's curves."""
ROUNDS = 3
"""Episodes of each of many environments in a window, see `judged_episodes`."""


def judged_episodes(num_envs: int) -> int:
    """Return W, the number of episodes in a row whose mean cost says whether a limit is met.

    Environments that begin together reach the end together, too: of many, fifty episodes in a row may be those of one
    moment, at which hardly any fails, while those that failed did so before. W is several episodes of each.
    """
    return max(MEAN_EPISODES, ROUNDS * num_envs)


def recent_episodes(num_envs: int) -> int:
    """Return the number of last episodes whose costs a learner receives at most, and whose mean length it knows."""
    return max(RECENT_EPISODES, ROUNDS * num_envs)


@dataclass(frozen=True)
class Task:
    """What an algorithm is constructed for."""

    obs_size: int
    """D, the size of one frame."""
    action_space: Space
    """Action space of a single environment."""
    num_envs: int
    """N."""
    seed: int
    context: dict[str, Any]
    """Stored in the policy's file."""
    device: torch.device = CPU
    """Device of the rollouts and of learning."""
    graphs: bool = False
    """Whether gradient steps are recorded as CUDA graphs and replayed, see `thalweg.algos.common.cuda_graphs`."""
    image: tuple[int, int, int] | None = None
    """H, W, C of the images in observations that are rows of bytes, see `thalweg.algos.policy.vision`; None for
    observations that are numbers."""
    critic_size: int = 0
    """C, how many numbers the environment tells critics beyond the observation; 0: none."""


@dataclass(frozen=True)
class Rollout:
    """T steps of N environments, in order; the first may continue episodes of the rollout before."""

    obs: Tensor
    """[T + 1, N, K * D] float32, or uint8 for rows of images, what was seen before each step, and after the last one
    what the next step will start from."""
    fresh: Tensor
    """[T + 1, N] bool, whether that observation begins an episode."""
    actions: Tensor
    """[T, N, A], raw."""
    rewards: Tensor
    """[T, N] float32."""
    costs: Tensor
    """[T, N, M] float32."""
    terminated: Tensor
    """[T, N] bool."""
    truncated: Tensor
    """[T, N] bool, and not terminated."""
    valid: Tensor
    """[T, N] bool; false for a step that only reset an environment (NEXT_STEP), which nothing may be learnt from."""
    final_index: Tensor
    """[F] int64, t * N + n of each step that ended an episode and of which the last observation is known."""
    final_obs: Tensor
    """[F, K * D], of the same type, what was seen at the end of those steps, before the reset; zeros where an episode
    ended by itself and the environment did not say, for nothing comes after it."""
    critic_obs: Tensor | None = None
    """[T + 1, N, C] float32, what critics see beside each observation; None if `Task.critic_size` is 0."""
    final_critic_obs: Tensor | None = None
    """[F, C] float32, the same beside `final_obs`."""


@dataclass(frozen=True)
class Feedback:
    """Statistics of the episodes so far, for limits, multipliers and schedules; the run measures them."""

    progress: float
    """Share of the run's steps taken before this rollout, 0..1."""
    steps_left: int
    """Steps still to come after this rollout, all environments together."""
    new_costs: np.ndarray
    """[E, M] undiscounted costs of the episodes finished since the last update that returned metrics."""
    recent_costs: np.ndarray
    """[E, M] of the last `recent_episodes` at most, the newest last."""
    episodes: int
    """Episodes finished since the run began."""
    largest_costs: tuple[float, ...]
    """[M] the largest cost of any of them."""
    lowest_costs: tuple[float, ...]
    """[M] the lowest mean cost that W episodes in a row have had; NaN before so many have finished."""
    mean_length: float
    """Steps of an episode: the mean of the same last episodes as `recent_costs`; NaN before any."""
    judged: int = MEAN_EPISODES
    """W, see `judged_episodes`."""

    def cost_means(self, window: int = 0, least: int = 1) -> tuple[float, ...]:
        """Return J_c [M]: the mean cost of the new episodes, and at least of the `least` last ones.

        Without new episodes it is the mean of the last W, with a window that of so many last ones. NaN before any
        episode has finished.
        """
        count = len(self.new_costs)
        if window:
            chosen = self.recent_costs[-window:]
        elif count:
            chosen = self.new_costs if count >= least else self.recent_costs[-least:]
        else:
            chosen = self.recent_costs[-self.judged :]
        if not len(chosen):
            return (float("nan"),) * len(self.largest_costs)
        return tuple(float(mean) for mean in chosen.mean(0))


class Learner(Protocol):
    """An algorithm in a run. `run` owns the environment, the loop, files and clocks; a learner owns what it learns."""

    @property
    def policy(self) -> AnyPolicy: ...
    @property
    def rollout_steps(self) -> int:
        """T: steps of each environment between updates."""
        ...

    @property
    def separate_costs(self) -> bool:
        """Whether it takes the costs of `info["costs"]` separately instead of their sum."""
        ...

    @property
    def resets(self) -> bool:
        """Whether all environments are reset after each update that returned metrics."""
        ...

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A] with exploration, for observations [N, K * D] of which `fresh` [N] begin an
        episode."""
        ...

    def warm_up_critics(self) -> None:
        """Let only the critics learn at first, for as many steps as the config says.

        For a policy that another run has trained: critics that have learnt nothing would move it anywhere. To be called
        before the first step; what is left of it belongs to the state.
        """
        ...

    def update(self, rollout: Rollout, feedback: Feedback) -> dict[str, float]:
        """Learn from a rollout and return the metrics.

        An empty dictionary means that there is nothing to report yet; the feedback then keeps accumulating. Raises
        `NotFiniteError` if a loss is NaN.
        """
        ...

    def warnings(self, feedback: Feedback) -> dict[str, str]:
        """Return warnings about what can't work in this run, as sentences by a short code."""
        ...

    def state(self) -> dict[str, Any]:
        """Return everything that learning needs to resume, as nested dictionaries of arrays and plain data."""
        ...

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; learning then continues bit by bit as if never interrupted."""
        ...
