"""Rollouts and feedback by hand, for tests of what learns."""

from typing import Any

import numpy as np
import torch

from thalweg.algos.interface import Feedback, Rollout


def feedback(
    *costs: float,
    count: int = 3,
    episodes: int = 30,
    largest: float = 1.0,
    progress: float = 0.1,
    steps_left: int = 1000,
    length: float = 5.0,
    lowest: float = 0.0,
) -> Feedback:
    """What is known after `count` new episodes that cost as much as each other: `costs` [M]."""
    told = np.tile(np.array(costs, dtype=np.float64), (count, 1))
    return Feedback(
        progress=progress,
        steps_left=steps_left,
        new_costs=told,
        recent_costs=told,
        episodes=episodes,
        largest_costs=(largest,) * len(costs),
        lowest_costs=(lowest,) * len(costs),
        mean_length=length,
    )


def rollout_of(obs: torch.Tensor, **changes: Any) -> Rollout:
    """Steps through observations [T + 1, N, D] in which nothing ends; every reward is 1, every cost 0."""
    steps, count, size = obs.shape[0] - 1, obs.shape[1], obs.shape[2]
    never = torch.zeros(steps, count, dtype=torch.bool)
    fields = {
        "obs": obs,
        "fresh": torch.zeros(steps + 1, count, dtype=torch.bool),
        "actions": torch.zeros(steps, count, 1, dtype=torch.int64),
        "rewards": torch.ones(steps, count),
        "costs": torch.zeros(steps, count, 1),
        "terminated": never,
        "truncated": never,
        "valid": ~never,
        "final_index": torch.zeros(0, dtype=torch.int64),
        "final_obs": torch.zeros(0, size),
    }
    return Rollout(**(fields | changes))


def cut_off(obs: torch.Tensor, length: int, **changes: Any) -> Rollout:
    """Steps through observations [T + 1, N, D] of episodes that a limit of `length` steps cuts off, T of them or a
    multiple: the last step pays and costs 0.2, and critics are told the share of steps, which is 1 at the limit."""
    steps, count, size = obs.shape[0] - 1, obs.shape[1], obs.shape[2]
    at = (torch.arange(steps + 1) % length).unsqueeze(1).expand(-1, count)
    last = at[:-1] == length - 1
    ends = last.flatten().nonzero().squeeze(-1)
    fields = {
        "fresh": at == 0,
        "rewards": 0.2 * last,
        "costs": 0.2 * last.unsqueeze(-1),
        "truncated": last,
        "final_index": ends,
        "final_obs": torch.zeros(len(ends), size),
        "critic_obs": at.unsqueeze(-1) / length,
        "final_critic_obs": torch.ones(len(ends), 1),
    }
    return rollout_of(obs, **(fields | changes))
