"""Small ensembles, random actions and rollouts for the tests of planners."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch

from thalweg.algos.interface import Rollout
from thalweg.algos.planning.model.ensemble import Ensemble
from thalweg.algos.policy.actions import Actions, actions_of

OPTIONS = gym.spaces.MultiDiscrete([3, 2])
BOX = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def ensemble_for(space: gym.Space = OPTIONS, frame: int = 3, frames: int = 1, costs: int = 1, **settings) -> Ensemble:
    """An ensemble with random weights, large enough for models to differ, and scales that are not 1."""
    given: dict[str, Any] = {"members": 4, "hidden": (16, 16)} | settings
    actions: Actions = actions_of(space, "native", "squashed")
    ensemble = Ensemble(frame, frames, actions, costs, given["members"], given["hidden"], generator(3))
    ensemble.stack.flat.data += 0.3 * torch.randn(ensemble.stack.flat.shape, generator=generator(4))
    ensemble.observed.update(2.0 + 3.0 * torch.randn(500, frame, generator=generator(5)))
    ensemble.change.update(0.1 + 0.2 * torch.randn(500, frame, generator=generator(6)))
    ensemble.reward.update(1.0 + 0.5 * torch.randn(500, 1, generator=generator(7)))
    ensemble.ranges = torch.tensor([[0.0] * costs, [0.2] * costs])
    return ensemble


def raw_actions(actions: Actions, *shape: int, seed: int = 0) -> torch.Tensor:
    """Uniformly random raw actions [*shape, A]."""
    uniform = torch.rand(*shape, actions.count, generator=generator(seed))
    return (uniform * torch.tensor(actions.sizes)).long() if actions.kind == "categorical" else 2 * uniform - 1


def rollout_of(steps: int = 6, envs: int = 2, size: int = 3, costs: int = 1, **changes) -> Rollout:
    """A rollout with observations 10 n + t at step t of environment n, actions (0, 0), rewards t and no ends."""
    obs = (torch.arange(steps + 1.0)[:, None, None] + 10 * torch.arange(float(envs))[:, None]).repeat(1, 1, size)
    never = torch.zeros(steps, envs, dtype=torch.bool)
    fields: dict[str, Any] = {
        "obs": obs,
        "fresh": torch.zeros(steps + 1, envs, dtype=torch.bool),
        "actions": torch.zeros(steps, envs, 2, dtype=torch.int64),
        "rewards": torch.arange(float(steps)).unsqueeze(1).repeat(1, envs),
        "costs": torch.zeros(steps, envs, costs),
        "terminated": never,
        "truncated": never.clone(),
        "valid": ~never,
        "final_index": torch.zeros(0, dtype=torch.int64),
        "final_obs": torch.zeros(0, size),
    }
    return Rollout(**(fields | changes))
