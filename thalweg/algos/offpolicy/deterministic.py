"""Deterministic policies that learn by the gradient of their critics, and their exploration.

Continuous actions are points in -1..1. Discrete actions are one-hot vectors: while learning they are sampled, and the
gradient passes straight through the sample; otherwise the most probable option is taken. Letters: B states, A
dimensions or branches of an action, P parameters, W numbers of an encoded action, M costs.
"""

from collections.abc import Callable
from typing import Protocol

import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.interface import Task
from thalweg.algos.maths import gumbel_softmax
from thalweg.algos.maths.multiplier import combined
from thalweg.algos.maths.shapes import tensor_like
from thalweg.algos.offpolicy.agent import Agent, AgentSpec
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.offpolicy.replay_buffer import Batch
from thalweg.algos.policy.actions import Actions, actions_of
from thalweg.algos.policy.distributions import Categoricals
from thalweg.core.config import FiniteNonNegative, FinitePositive, Fraction, frozen_config

LEAST_TEMPERATURE = 1e-3
"""Temperature at which sampled choices are practically deterministic."""


@frozen_config(AlgorithmError)
class DeterministicConfig(OffPolicyConfig):
    """Settings that all algorithms with a deterministic policy share."""

    exploration: Fraction = 0.1
    """ε: share of steps with a uniformly random action."""
    exploration_noise: FiniteNonNegative = 0.1
    """Standard deviation of the noise added to a continuous action in -1..1 while collecting."""
    exploration_temperature: FinitePositive = 0.2
    """Temperature of discrete actions while collecting: they are sampled from the softmax of the policy's outputs
    divided by this. If it is high, the multipliers respond to the costs of a policy that differs from the final one."""
    exploration_fades: bool = True
    """Whether ε, the standard deviation and the temperature fall linearly to 0 over the run, so that the multipliers
    respond to the costs of the final policy towards its end."""
    flight_temperature: FiniteNonNegative = 0.5
    """Temperature of discrete actions of the trained policy; 0 for the most probable action. A policy that never draws
    stays for ever where two options seem alike."""
    relaxation: FinitePositive = 1.0
    """τ of the Gumbel-softmax whose gradient replaces that of a discrete choice."""
    output_decay: FiniteNonNegative = 0.001
    """Weight of the policy's mean squared outputs (logits, or the inputs of tanh) in its loss, in the critics' units;
    without it a saturated policy has no gradient, and with much of it small differences in value count for nothing."""

    def exploration_at(self, progress: float) -> float:
        """Return the factor 0..1 of the exploration at a progress 0..1 of the run."""
        return 1.0 - progress if self.exploration_fades else 1.0


def policy_loss(config: DeterministicConfig, values: Tensor, outputs: Tensor, multipliers: tuple[float, ...]) -> Tensor:
    """Return L = -E[(Q_r(s, μ(s)) - Σ_i λ_i Q_ci(s, μ(s))) / (1 + Σ_i λ_i)] + c E[z²], the loss of the policy.

    Args:
        config: Holds c, `output_decay`.
        values: [1 + M, B], the reward's and then each cost's.
        outputs: z [B, P], of the policy's network.
        multipliers: λ [M].
    """
    lagrangian = combined(values[0], values[1:], multipliers, normalised=True)
    return -lagrangian.mean() + config.output_decay * outputs.square().mean()


def policy_grads(
    config: DeterministicConfig, values: Tensor, outputs: Tensor, multipliers: tuple[float, ...]
) -> tuple[Tensor, Tensor]:
    """Return the gradients of `policy_loss` by the values [1 + M, B] and, at constant values, by the outputs [B, P]."""
    weights = tensor_like([-1.0, *multipliers], values) / ((1.0 + sum(multipliers)) * values.shape[1])
    return weights.unsqueeze(1).expand_as(values), (2.0 * config.output_decay / outputs.numel()) * outputs


class ActionForm(Protocol):
    """How a deterministic policy and its critics represent an action."""

    actions: Actions
    width: int
    """W."""

    def encode(self, raw: Tensor) -> Tensor:
        """Return the critics' inputs [B, W] for the executed raw actions [B, A]."""
        ...

    def greedy(self, parameters: Tensor) -> Tensor:
        """Return the policy's own action [B, W], encoded as it would be executed."""
        ...

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Return the policy's own action [B, W] before any rounding, and its backward function.

        A discrete action is a sample. The function takes the gradient of the action and returns that of the parameters
        [B, P].
        """
        ...

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """Return a random action [B, W] near the policy's own, encoded as it would be executed."""
        ...

    def explore(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        """Return raw actions [B, A] for collecting, with the exploration of the config times `strength` 0..1."""
        ...


class ContinuousActions:
    """Actions in -1..1: the tanh of the policy's outputs."""

    def __init__(self, actions: Actions, config: DeterministicConfig) -> None:
        self.actions, self._config, self.width = actions, config, actions.count

    def encode(self, raw: Tensor) -> Tensor:
        """Return the executed actions [B, W]."""
        return self.actions.quantised(raw)

    def greedy(self, parameters: Tensor) -> Tensor:
        """Return tanh z [B, W], as executed."""
        return self.encode(parameters.tanh())

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Return tanh z [B, W], and the backward function of tanh."""
        point = parameters.tanh()
        return point, lambda grad: grad * (1.0 - point.square())

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """Return clip(μ + clip(ε, -c, c), -1, 1), ε ~ N(0, σ̃) (Fujimoto, van Hoof, Meger 2018, equation 14)."""
        clipped = (noise * _normal(parameters, generator)).clamp_(-clip, clip)
        return self.encode((parameters.tanh() + clipped).clamp_(-1.0, 1.0))

    def explore(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        """Return tanh z with Gaussian noise, or with probability ε a uniform action [B, A]."""
        noisy = parameters.tanh() + strength * self._config.exploration_noise * _normal(parameters, generator)
        return _epsilon_uniform(noisy.clamp_(-1.0, 1.0), self, strength * self._config.exploration, generator)


class DiscreteActions:
    """One-hot choices: a Gumbel-softmax sample where a gradient is needed, the most probable option otherwise."""

    def __init__(self, actions: Actions, config: DeterministicConfig) -> None:
        self.actions, self._config = actions, config
        self.width = actions.count * max(actions.sizes)

    def encode(self, raw: Tensor) -> Tensor:
        """Return one-hot vectors of all branches side by side [B, W]."""
        return gumbel_softmax.one_hot(raw, max(self.actions.sizes)).flatten(1)

    def greedy(self, parameters: Tensor) -> Tensor:
        """Return the most probable options [B, W]."""
        return self.encode(self._choices(parameters).mode())

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """Return a one-hot sample [B, W], and the backward function of its softmax relaxation."""
        choices, temperature = self._choices(parameters), self._config.relaxation
        noise = gumbel_softmax.gumbel(
            torch.rand(choices.log_p.shape, dtype=torch.float32, generator=generator, device=parameters.device)
        )
        hard, soft = gumbel_softmax.straight_through(choices.log_p, noise, temperature)

        def backward(grad: Tensor) -> Tensor:
            return choices.logit_grad(gumbel_softmax.straight_through_grad(grad.view_as(soft), soft, temperature))

        return hard.flatten(1), backward

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """Return a sample [B, W] of the softmax of outputs / temperature; at 0 the most probable option."""
        if temperature == 0:
            return self.greedy(parameters)
        return self.encode(self._choices(parameters / temperature).sample(generator))

    def explore(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        """Return a sample at the exploration temperature, or with probability ε a uniform action [B, A]."""
        temperature = max(strength * self._config.exploration_temperature, LEAST_TEMPERATURE)
        sample = self._choices(parameters / temperature).sample(generator)
        return _epsilon_uniform(sample, self, strength * self._config.exploration, generator)

    def _choices(self, parameters: Tensor) -> Categoricals:
        return Categoricals.from_logits(parameters, self.actions.sizes)


def action_form_of(config: DeterministicConfig, task: Task) -> ContinuousActions | DiscreteActions:
    """Return the representation of the task's actions."""
    actions = actions_of(task.action_space, config.adapter, "point")
    return (DiscreteActions if actions.kind == "categorical" else ContinuousActions)(actions, config)


def deterministic_spec(
    algorithm: str,
    action_form: ContinuousActions | DiscreteActions,
    config: DeterministicConfig,
    *,
    reward_critics: int,
) -> AgentSpec:
    """Return the properties of an algorithm's networks: a policy without noise, or near its most probable options."""
    draws = isinstance(action_form, DiscreteActions) and config.flight_temperature > 0.0
    return AgentSpec(
        algorithm,
        action_form.actions,
        action_form.width,
        reward_critics=reward_critics,
        greedy=not draws,
        temperature=config.flight_temperature if draws else 1.0,
    )


@torch.no_grad()
def policy_gradient_step(agent: Agent, action_form: ActionForm, config: DeterministicConfig, batch: Batch) -> None:
    """Take one step of Adam of the policy, whose gradient passes through the critics and the action (chain rule)."""
    critics, multipliers = agent.critics, agent.multipliers.values
    outputs, actor_backward = agent.policy.actor.forward_and_backward(batch.obs)
    action, action_backward = action_form.rsample_and_backward(outputs, agent.generator)
    values, critics_backward = critics.stack.forward_and_input_backward(
        torch.cat([batch.seen, action], 1), critics.one_per_signal
    )
    value_grads, output_grads = policy_grads(config, values[..., 0], outputs, multipliers)
    # The critics' inputs are what they see and actions; only the actions' gradient concerns the policy.
    action_grads = critics_backward(value_grads.unsqueeze(-1))[:, batch.seen.shape[1] :]
    actor_backward(action_backward(action_grads) + output_grads)
    agent.update_policy(policy_loss(config, values[..., 0], outputs, multipliers))


def _epsilon_uniform(raw: Tensor, action_form: ActionForm, epsilon: float, generator: torch.Generator) -> Tensor:
    """Return raw actions [B, A], each replaced by a uniform one with probability `epsilon`."""
    replaced = torch.rand(len(raw), 1, dtype=torch.float32, generator=generator, device=raw.device) < epsilon
    return torch.where(replaced, action_form.actions.uniform(len(raw), generator), raw)


def _normal(like: Tensor, generator: torch.Generator) -> Tensor:
    return torch.randn(like.shape, dtype=torch.float32, generator=generator, device=like.device)
