"""Soft actor-critic of a planner: terminal values, sampled actions and the terms of its losses.

Expectations over discrete actions are exact sums; over continuous actions they use one sample. Dimensions: R rows, B
states of a batch, J joint actions.
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


class SoftActorCriticConfig(Protocol):
    """Config fields that the soft actor-critic needs."""

    @property
    def hidden(self) -> tuple[int, ...]: ...
    @property
    def entropy_share(self) -> float: ...
    @property
    def entropy_per_number(self) -> float: ...


class DiscreteSoftActorCritic:
    """Soft actor-critic for discrete actions: critics output one value per joint action, and expectations are sums."""

    def __init__(
        self, actions: Actions, config: SoftActorCriticConfig, inputs: int, generator: torch.Generator
    ) -> None:
        """Raises `AlgorithmError` if there are too many joint actions for exact sums."""
        count = actions.joint_count("SafeLOOP")
        self.actions, shape = actions, NetworkShape(config.hidden, "relu")
        self.actor = Actor(inputs, actions, shape, generator)
        self.critics = StackedMLP(2, inputs, shape.hidden, count, activation="relu", generator=generator)
        self.target_entropy = config.entropy_share * math.log(count)
        self.entropy_range = (0.0, math.log(count))
        self._selected = joint_actions.selection(actions.sizes).to(generator.device)

    def value(self, obs: Tensor) -> Tensor:
        """Return Σ_a π(a|s) min Q(s, a) [R] of normalised observations [R, K * D]."""
        return joint_actions.expectation(self._log_p(obs), self.critics(obs).amin(0))

    def action_value(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Return min Q(s, a) [R] of raw actions [R, A]."""
        return _select(self.critics(obs).amin(0), joint_actions.numbers(raw, self.actions.sizes))

    def sample(self, obs: Tensor, generator: torch.Generator) -> Tensor:
        """Sample raw actions [R, A] from the actor."""
        return self._policy(obs).sample(generator)

    def next_values(self, target_critics: StackedMLP, obs: Tensor, alpha: Tensor, generator: torch.Generator) -> Tensor:
        """Return V(s') [B] = Σ_a π(a|s') (min Q'(s', a) - α log π(a|s'))."""
        log_p = self._log_p(obs)
        return joint_actions.expectation(log_p, target_critics(obs).amin(0) - alpha * log_p)

    def q_values(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Return Q(s, a) [2, B] of raw actions [B, A]."""
        return _select(self.critics(obs), joint_actions.numbers(raw, self.actions.sizes))

    def objective(self, obs: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return E_a[min Q(s, a)] [B] and the entropy H(s) [B], with the actor's gradient."""
        log_p = self._log_p(obs)
        return joint_actions.expectation(log_p, self.critics(obs, frozen=True).amin(0)), -joint_actions.expectation(
            log_p, log_p
        )

    def _policy(self, obs: Tensor) -> Categoricals:
        return Categoricals.from_logits(self.actor(obs), self.actions.sizes)

    def _log_p(self, obs: Tensor) -> Tensor:
        """Return log π(a|s) [B, J]."""
        return joint_actions.log_prob(self._policy(obs).log_p, self._selected)


class ContinuousSoftActorCritic:
    """Soft actor-critic for continuous actions: critics take the action as input, and expectations use one sample."""

    def __init__(
        self, actions: Actions, config: SoftActorCriticConfig, inputs: int, generator: torch.Generator
    ) -> None:
        self.actions, shape = actions, NetworkShape(config.hidden, "relu")
        self.actor = Actor(inputs, actions, shape, generator)
        self.critics = StackedMLP(2, inputs + actions.count, shape.hidden, 1, activation="relu", generator=generator)
        self.target_entropy = config.entropy_per_number * actions.count
        self.entropy_range = (-math.inf, actions.count * math.log(2.0))  # at most that of uniform actions in -1..1

    def value(self, obs: Tensor) -> Tensor:
        """Return min Q(s, tanh μ) [R] at the actor's mode, for normalised observations [R, K * D]."""
        return self.action_value(obs, self._policy(obs).mode())

    def action_value(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Return min Q(s, a) [R] of raw actions [R, A]."""
        return self.q_values(obs, raw).amin(0)

    def sample(self, obs: Tensor, generator: torch.Generator) -> Tensor:
        """Sample raw actions [R, A] from the actor."""
        return self._policy(obs).sample(generator)

    def next_values(self, target_critics: StackedMLP, obs: Tensor, alpha: Tensor, generator: torch.Generator) -> Tensor:
        """Return V(s') [B] = min Q'(s', a') - α log π(a'|s'), with a' sampled from the actor."""
        raw, log_prob = self._policy(obs).rsample(generator)
        pairs = torch.cat([obs, self.actions.quantised(raw)], -1)
        return target_critics(pairs).squeeze(-1).amin(0) - alpha * log_prob

    def q_values(self, obs: Tensor, raw: Tensor) -> Tensor:
        """Return Q(s, a) [2, B] of the executed actions, given as raw actions [B, A]."""
        return self.critics(torch.cat([obs, self.actions.quantised(raw)], -1)).squeeze(-1)

    def objective(self, obs: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return min Q(s, a) [B] and -log π(a|s) [B] of one reparameterised sample, with the actor's gradient."""
        raw, log_prob = self._policy(obs).rsample(generator)
        return self.critics(torch.cat([obs, raw], -1), frozen=True).squeeze(-1).amin(0), -log_prob

    def _policy(self, obs: Tensor) -> SquashedGaussian:
        return SquashedGaussian(*self.actor(obs).chunk(2, dim=-1))


def soft_actor_critic(
    actions: Actions, config: SoftActorCriticConfig, inputs: int, generator: torch.Generator
) -> DiscreteSoftActorCritic | ContinuousSoftActorCritic:
    """Return the soft actor-critic for an action space and observations of `inputs` numbers."""
    return (DiscreteSoftActorCritic if actions.kind == "categorical" else ContinuousSoftActorCritic)(
        actions, config, inputs, generator
    )


def _select(values: Tensor, numbers: Tensor) -> Tensor:
    """Select from values [..., B, J] those of the joint actions with indices [B]; returns [..., B]."""
    return values.gather(-1, numbers.expand(values.shape[:-1]).unsqueeze(-1)).squeeze(-1)
