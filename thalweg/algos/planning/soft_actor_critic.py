"""Soft actor-critic of a planner: terminal values, sampled actions, and the terms of its losses. Discrete actions use
exact expectations, continuous ones samples.

Letters: R rows, B states of a batch, J joint actions.
"""

import math
from typing import Protocol

import torch
from torch import Tensor

from thalweg.algos.maths import joint_actions
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.distributions import Categoricals, SquashedGaussian
from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.networks import Actor, NetworkShape


class SoftConfig(Protocol):
    """What it asks of a config."""

    @property
    def hidden(self) -> tuple[int, ...]: ...
    @property
    def entropy_share(self) -> float: ...
    @property
    def entropy_per_number(self) -> float: ...


class Exact:
    """Choices: critics say one number for each of the J joint actions, and expectations are sums."""

    def __init__(self, actions: Actions, config: SoftConfig, inputs: int, generator: torch.Generator) -> None:
        """Raises `AlgorithmError` for more joint actions than can be summed over."""
        count = actions.joint_count("SafeLOOP")
        self.actions, shape = actions, NetworkShape(config.hidden, "relu")
        self.actor = Actor(inputs, actions, shape, generator)
        self.critics = StackedMLP(2, inputs, shape.hidden, count, activation="relu", generator=generator)
        self.target_entropy = config.entropy_share * math.log(count)
        self._selected = joint_actions.selection(actions.sizes).to(generator.device)

    def value(self, obs: Tensor) -> Tensor:
        """Σ_a π(a|s) min Q(s, a) [R] of normalised observations [R, K * D]."""
        return joint_actions.expectation(self._log_p(obs), self.critics(obs).amin(0))

    def action_value(self, obs: Tensor, raw: Tensor) -> Tensor:
        """min Q(s, a) [R] of raw actions [R, A]."""
        return _chosen(self.critics(obs).amin(0), joint_actions.numbers(raw, self.actions.sizes))

    def drawn(self, obs: Tensor, generator: torch.Generator) -> Tensor:
        """Raw actions [R, A] of the actor."""
        return self._policy(obs).sample(generator)

    def next_values(self, slow: StackedMLP, obs: Tensor, alpha: Tensor, generator: torch.Generator) -> Tensor:
        """V(s') [B] = Σ_a π(a|s') (min Q'(s', a) - α log π(a|s'))."""
        log_p = self._log_p(obs)
        return joint_actions.expectation(log_p, slow(obs).amin(0) - alpha * log_p)

    def q_values(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Q(s, a) [2, B] of raw actions [B, A]."""
        return _chosen(self.critics(obs), joint_actions.numbers(raw, self.actions.sizes))

    def objective(self, obs: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """E_a[min Q(s, a)] [B] and H(s) [B] with the actor's gradient."""
        log_p = self._log_p(obs)
        return joint_actions.expectation(log_p, self.critics(obs, frozen=True).amin(0)), -joint_actions.expectation(
            log_p, log_p
        )

    def _policy(self, obs: Tensor) -> Categoricals:
        return Categoricals.from_logits(self.actor(obs), self.actions.sizes)

    def _log_p(self, obs: Tensor) -> Tensor:
        """log π(a|s) [B, J]."""
        return joint_actions.log_prob(self._policy(obs).log_p, self._selected)


class Sampled:
    """Numbers: critics see the action, and an expectation is one draw."""

    def __init__(self, actions: Actions, config: SoftConfig, inputs: int, generator: torch.Generator) -> None:
        self.actions, shape = actions, NetworkShape(config.hidden, "relu")
        self.actor = Actor(inputs, actions, shape, generator)
        self.critics = StackedMLP(2, inputs + actions.count, shape.hidden, 1, activation="relu", generator=generator)
        self.target_entropy = config.entropy_per_number * actions.count

    def value(self, obs: Tensor) -> Tensor:
        """min Q(s, tanh μ) [R]: at the actor's middle, for normalised observations [R, K * D]."""
        return self.action_value(obs, self._policy(obs).mode())

    def action_value(self, obs: Tensor, raw: Tensor) -> Tensor:
        """min Q(s, a) [R] of raw actions [R, A]."""
        return self.q_values(obs, raw).amin(0)

    def drawn(self, obs: Tensor, generator: torch.Generator) -> Tensor:
        """Raw actions [R, A] of the actor."""
        return self._policy(obs).sample(generator)

    def next_values(self, slow: StackedMLP, obs: Tensor, alpha: Tensor, generator: torch.Generator) -> Tensor:
        """V(s') [B] = min Q'(s', a') - α log π(a'|s'), a' drawn from the actor."""
        raw, log_prob = self._policy(obs).rsample(generator)
        pairs = torch.cat([obs, self.actions.quantised(raw)], -1)
        return slow(pairs).squeeze(-1).amin(0) - alpha * log_prob

    def q_values(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Q(s, a) [2, B] of raw actions [B, A]: of what was executed."""
        return self.critics(torch.cat([obs, self.actions.quantised(raw)], -1)).squeeze(-1)

    def objective(self, obs: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """min Q(s, a) and -log π(a|s) [B] of one draw that carries the actor's gradient."""
        raw, log_prob = self._policy(obs).rsample(generator)
        return self.critics(torch.cat([obs, raw], -1), frozen=True).squeeze(-1).amin(0), -log_prob

    def _policy(self, obs: Tensor) -> SquashedGaussian:
        return SquashedGaussian(*self.actor(obs).chunk(2, dim=-1))


def soft_actor_critic(actions: Actions, config: SoftConfig, inputs: int, generator: torch.Generator) -> Exact | Sampled:
    """Of the kind that the actions have, for observations of so many numbers."""
    return (Exact if actions.kind == "categorical" else Sampled)(actions, config, inputs, generator)


def _chosen(values: Tensor, numbers: Tensor) -> Tensor:
    """[..., B] of values [..., B, J], at the joint actions of those numbers [B]."""
    return values.gather(-1, numbers.expand(values.shape[:-1]).unsqueeze(-1)).squeeze(-1)
