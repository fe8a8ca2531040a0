"""Small off-policy learners for tests, and rollouts whose rewards depend on the action."""

import itertools
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from tests.algos import rollouts
from thalweg.algos import ALGORITHMS
from thalweg.algos.interface import Rollout, Task
from thalweg.algos.offpolicy.replay_buffer import Batch

N, T, D, C = 4, 32, 5, 3
NAMES = ("DDPGLag", "TD3Lag", "SACLag")
SPACES = {
    "MultiDiscrete": gym.spaces.MultiDiscrete([3, 3]),
    "Discrete": gym.spaces.Discrete(3),
    "Box": gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
}


def learner_for(name: str, space: Any = SPACES["MultiDiscrete"], critic_size: Any = 0, **settings: Any) -> Any:
    """A small learner; with a `critic_size`, its critics see as many numbers beside the observation."""
    entry = ALGORITHMS[name]
    small: dict[str, Any] = {"steps_per_update": N * T, "minibatch": 32, "hidden": (16, 16), "random_steps": 0}
    small["asymmetric_critics"] = critic_size > 0
    return entry.make(entry.config(**(small | settings)), Task(D, space, N, 0, {}, critic_size=critic_size))


def rollout_of(learner: Any, seed: int = 0, steps: int = T, **changes: Any) -> Rollout:
    """A rollout whose reward is 1 for the first option or a positive number, and whose cost is 1 for the others."""
    generator = torch.Generator().manual_seed(seed)
    obs = torch.randn(steps + 1, N, D * learner.config.frame_stack, generator=generator)
    ends = torch.rand(steps, N, generator=generator) < 0.2
    fresh = torch.cat([torch.ones(1, N, dtype=torch.bool), ends])
    actions = torch.stack([learner.act(obs[t], fresh[t]) for t in range(steps)])
    kind = learner.policy.actions
    rewarded = kind.options(actions)[..., 0] == 0 if kind.sizes else actions[..., 0] > 0
    costs = (~rewarded).float().unsqueeze(-1).expand(-1, -1, len(learner.config.limits))
    told = {"critic_obs": torch.randn(steps + 1, N, C, generator=generator), "final_critic_obs": torch.zeros(0, C)}
    fields = told if learner.agent.critic_size else {}
    fields |= {"actions": actions, "rewards": rewarded.float(), "costs": costs, "terminated": ends, "fresh": fresh}
    return rollouts.rollout_of(obs, **(fields | changes))


def share_of_rewarded(learner: Any) -> float:
    """Share of the policy's first actions in an episode that are rewarded."""
    obs = np.random.default_rng(9).standard_normal((512, D)).astype(np.float32)
    player = learner.policy.player(len(obs), generator=torch.Generator().manual_seed(0))
    actions = player(obs, np.ones(len(obs), dtype=bool)).reshape(len(obs), -1)
    return float(((actions[:, 0] == 0) if learner.policy.actions.sizes else (actions[:, 0] > 0)).mean())


def batch_of(learner: Any, raw: torch.Tensor, seed: int = 0, ends: int = 2) -> Batch:
    """A batch with raw actions [B, A] whose first `ends` steps terminated an episode."""
    generator = torch.Generator().manual_seed(seed)
    size, width = len(raw), D * learner.config.frame_stack
    actions = learner.action_form.encode(raw)
    obs, next_obs = torch.randn(size, width, generator=generator), torch.randn(size, width, generator=generator)
    signals = torch.rand(1 + len(learner.config.limits), size, generator=generator)
    continues = (torch.arange(size) >= ends).float().expand(len(signals), -1)
    told, next_told = torch.randn(2, size, learner.agent.critic_size, generator=generator)
    seen, next_seen = torch.cat([obs, told], 1), torch.cat([next_obs, next_told], 1)
    return Batch(obs, seen, actions, torch.cat([seen, actions], 1), next_obs, next_seen, signals, continues)


def layer_by_layer(stack: Any, x: torch.Tensor) -> torch.Tensor:
    """Outputs [K, B, outputs] of a stack in float64, computed layer by layer and perceptron by perceptron."""
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


def perturb(learner: Any, seed: int = 0) -> None:
    """Add noise to all parameters, so that target networks differ and no output is near 0."""
    generator = torch.Generator().manual_seed(seed)
    targets = learner.agent.targets
    for vector in (targets.online, targets.target):
        vector += 0.3 * torch.randn(vector.shape, generator=generator)
