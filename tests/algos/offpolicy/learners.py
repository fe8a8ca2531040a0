"""Off-policy learners for tests: small ones, and rollouts that say which action pays."""

import itertools
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from tests.algos import rollouts
from thalweg.algos import ALGORITHMS
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.offpolicy.replay import Batch

N, T, D = 4, 32, 5
NAMES = ("DDPGLag", "TD3Lag", "SACLag")
SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]),
    "Discrete": gym.spaces.Discrete(3),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}


def learner_for(name: str, space: Any = SPACES["MultiDiscrete"], seed: Any = 0, **settings: Any) -> Any:
    entry = ALGORITHMS[name]
    small = {"steps_per_update": N * T, "minibatch": 32, "hidden": (16, 16), "random_steps": 0}
    return entry.make(entry.config(**(small | settings)), Task(D, space, N, 0, {}))


def rollout_of(learner: Any, seed: int = 0, steps: int = T, **changes: Any) -> Rollout:
    """Steps whose reward is 1 for the first option or a positive number, and whose cost is 1 for the others."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randn(steps + 1, N, D * learner.config.frame_stack, generator=generator)
    ends = torch.rand(steps, N, generator=generator) < 0.2
    fresh = torch.cat([torch.ones(1, N, dtype=torch.bool), ends])
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(steps)])
    kind = learner.policy.actions
    good = kind.options(actions)[..., 0] == 0 if kind.sizes else actions[..., 0] > 0
    costs = (~good).float().unsqueeze(-1).expand(-1, -1, len(learner.config.limits))
    fields = {"actions": actions, "rewards": good.float(), "costs": costs, "terminated": ends, "fresh": fresh}
    return rollouts.rollout_of(obs, **(fields | changes))


def share_of_good(learner: Any) -> float:
    """Of what its policy does first in an episode."""
    obs = np.random.default_rng(9).standard_normal((512, D)).astype(np.float32)
    player = learner.policy.player(len(obs), generator=torch.Generator().manual_seed(0))
    actions = player(obs, np.ones(len(obs), dtype=bool)).reshape(len(obs), -1)
    return float(((actions[:, 0] == 0) if learner.policy.actions.sizes else (actions[:, 0] > 0)).mean())


def batch_of(learner: Any, raw: torch.Tensor, seed: int = 0, ends: int = 2) -> Batch:
    """A batch with raw actions [B, A], of which the first `ends` steps ended an episode."""
    generator = torch.Generator().manual_seed(seed)
    size, seen = len(raw), D * learner.config.frame_stack
    actions = learner.form.coded(raw)
    obs, next_obs = torch.randn(size, seen, generator=generator), torch.randn(size, seen, generator=generator)
    paid = torch.rand(1 + len(learner.config.limits), size, generator=generator)
    going_on = (torch.arange(size) >= ends).float()
    return Batch(obs, actions, torch.cat([obs, actions], 1), next_obs, paid, going_on)


def one_by_one(stack: Any, x: torch.Tensor) -> torch.Tensor:
    """[K, B, outputs] of a stack, layer by layer and perceptron by perceptron, in float64."""
    sizes, flat, at = stack.sizes, stack.flat.detach().double(), 0
    hidden = [x.double()] * stack.count
    for layer, (before, after) in enumerate(itertools.pairwise(sizes)):
        weight = flat[at : at + stack.count * before * after].view(stack.count, before, after)
        at += weight.numel()
        bias = flat[at : at + stack.count * after].view(stack.count, after)
        at += bias.numel()
        hidden = [each @ weight[k] + bias[k] for k, each in enumerate(hidden)]
        if layer < len(sizes) - 2:
            hidden = [each.clamp(min=0.0) if stack.activation == "relu" else each.tanh() for each in hidden]
    return torch.stack(hidden)


def shake(learner: Any, seed: int = 0) -> None:
    """Let networks and their slow copies differ, and no output be near 0."""
    generator = torch.Generator().manual_seed(seed)
    slow = learner.agent.slow
    for vector in (slow.fast, slow.slow):
        vector += 0.3 * torch.randn(vector.shape, generator=generator)
