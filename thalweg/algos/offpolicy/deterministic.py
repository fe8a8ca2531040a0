"""How can a policy that knows one action per state learn by a gradient through its critics, and how does it explore?

Numbers are points in -1..1. Choices are one-hot vectors: the gradient passes through the draw (straight through), and
the policy in use is its most probable choice. Letters: B states, A numbers or branches, P parameters, W numbers of a
coded action.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from thalweg.algos.interface import Task
from thalweg.algos.maths import gumbel_softmax
from thalweg.algos.maths.multiplier import combined
from thalweg.algos.maths.shapes import tensor_like
from thalweg.algos.offpolicy.agent import Agent
from thalweg.algos.offpolicy.config import OffPolicyConfig
from thalweg.algos.offpolicy.replay import Batch
from thalweg.algos.policy.actions import Actions, actions_of
from thalweg.algos.policy.distributions import Categoricals

COLDEST = 1e-3
"""Temperature at which choices are as good as certain."""


@dataclass(frozen=True)
class DeterministicConfig(OffPolicyConfig):
    """Settings that all algorithms with a deterministic policy share."""

    exploration: float = 0.1
    """ε: share of steps with a uniformly random action."""
    exploration_noise: float = 0.1
    """Standard deviation of the noise added to a continuous action in -1..1 while collecting."""
    exploration_temperature: float = 0.2
    """Temperature of discrete actions while collecting: they are sampled from the softmax of the policy's outputs
    divided by this. If it is high, the multipliers respond to the costs of a policy that differs from the final one."""
    exploration_fades: bool = True
    """Whether ε, the standard deviation and the temperature fall linearly to 0 over the run, so that the multipliers
    respond to the costs of the final policy towards its end."""
    relaxation: float = 1.0
    """τ of the Gumbel-softmax whose gradient replaces that of a discrete choice."""
    output_decay: float = 0.03
    """Weight of the policy's mean squared outputs (logits, or the inputs of tanh) in its loss; without it a saturated
    policy has no gradient."""

    def conditions(self) -> dict[str, tuple[bool, str]]:
        return super().conditions() | {
            "exploration": (0 <= self.exploration <= 1, "must be in 0..1"),
            "exploration_noise": (self.exploration_noise >= 0, "must not be negative"),
            "exploration_temperature": (self.exploration_temperature > 0, "must be positive"),
            "relaxation": (self.relaxation > 0, "must be positive"),
            "output_decay": (self.output_decay >= 0, "must not be negative"),
        }

    def exploration_at(self, progress: float) -> float:
        """Share 0..1 of the usual exploration at this share of the run."""
        return 1.0 - progress if self.exploration_fades else 1.0


def policy_loss(config: DeterministicConfig, values: Tensor, outputs: Tensor, multipliers: tuple[float, ...]) -> Tensor:
    """L = -E[(Q_r(s, μ(s)) - Σ_i λ_i Q_ci(s, μ(s))) / (1 + Σ_i λ_i)] + c E[z²]: what the policy minimises.

    Args:
        config: With c, `output_decay`.
        values: [1 + M, B], the reward's and then each cost's.
        outputs: z [B, P], of the policy's network.
        multipliers: λ [M].
    """
    lagrangian = combined(values[0], values[1:], multipliers, normalised=True)
    return -lagrangian.mean() + config.output_decay * outputs.square().mean()


def policy_slopes(
    config: DeterministicConfig, values: Tensor, outputs: Tensor, multipliers: tuple[float, ...]
) -> tuple[Tensor, Tensor]:
    """The gradient of `policy_loss` in the values [1 + M, B] and, while these stay as they are, in the outputs."""
    weights = tensor_like([-1.0, *multipliers], values) / ((1.0 + sum(multipliers)) * values.shape[1])
    return weights.unsqueeze(1).expand_as(values), (2.0 * config.output_decay / outputs.numel()) * outputs


class Deterministic(Protocol):
    """What an action is to a deterministic policy and its critics."""

    actions: Actions
    width: int
    """W."""

    def coded(self, raw: Tensor) -> Tensor:
        """[B, W] what critics see of raw actions [B, A] that were executed."""
        ...

    def chosen(self, parameters: Tensor) -> Tensor:
        """[B, W] the policy's own action, coded, as it would be executed."""
        ...

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        """[B, W] the policy's own action before any rounding, for choices a draw; and what gives from its gradient that
        of the parameters [B, P]."""
        ...

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """[B, W] an action near the policy's own, coded, as it would be executed."""
        ...

    def explored(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        """Raw actions [B, A] for collecting, at this share 0..1 of the usual exploration."""
        ...


class Numbers:
    """Numbers in -1..1: the tanh of the policy's outputs."""

    def __init__(self, actions: Actions, config: DeterministicConfig) -> None:
        self.actions, self._config, self.width = actions, config, actions.count

    def coded(self, raw: Tensor) -> Tensor:
        return self.actions.quantised(raw)

    def chosen(self, parameters: Tensor) -> Tensor:
        return self.coded(parameters.tanh())

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        point = parameters.tanh()
        return point, lambda above: above * (1.0 - point.square())

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """clip(μ + clip(ε, -c, c), -1, 1), ε ~ N(0, σ̃) (Fujimoto, van Hoof, Meger 2018, equation 14)."""
        drawn = (noise * _normal(parameters, generator)).clamp_(-clip, clip)
        return self.coded((parameters.tanh() + drawn).clamp_(-1.0, 1.0))

    def explored(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        noisy = parameters.tanh() + strength * self._config.exploration_noise * _normal(parameters, generator)
        return _mixed(noisy.clamp_(-1.0, 1.0), self, strength * self._config.exploration, generator)


class Choices:
    """One-hot choices: the draw of a Gumbel-softmax for the gradient, the most probable option otherwise."""

    def __init__(self, actions: Actions, config: DeterministicConfig) -> None:
        self.actions, self._config = actions, config
        self.width = actions.count * max(actions.sizes)

    def coded(self, raw: Tensor) -> Tensor:
        return gumbel_softmax.one_hot(raw, max(self.actions.sizes)).flatten(1)

    def chosen(self, parameters: Tensor) -> Tensor:
        return self.coded(self._choices(parameters).mode())

    def rsample_and_backward(
        self, parameters: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Callable[[Tensor], Tensor]]:
        choices, temperature = self._choices(parameters), self._config.relaxation
        noise = gumbel_softmax.gumbel(torch.rand(choices.log_p.shape, generator=generator, device=parameters.device))
        hard, soft = gumbel_softmax.straight_through(choices.log_p, noise, temperature)

        def back(above: Tensor) -> Tensor:
            return choices.logit_grad(gumbel_softmax.straight_through_grad(above.view_as(soft), soft, temperature))

        return hard.flatten(1), back

    def smoothed(
        self, parameters: Tensor, generator: torch.Generator, *, noise: float, clip: float, temperature: float
    ) -> Tensor:
        """A draw from the softmax of the outputs divided by the temperature."""
        if temperature == 0:
            return self.chosen(parameters)
        return self.coded(self._choices(parameters / temperature).sample(generator))

    def explored(self, parameters: Tensor, generator: torch.Generator, strength: float = 1.0) -> Tensor:
        temperature = max(strength * self._config.exploration_temperature, COLDEST)
        drawn = self._choices(parameters / temperature).sample(generator)
        return _mixed(drawn, self, strength * self._config.exploration, generator)

    def _choices(self, parameters: Tensor) -> Categoricals:
        return Categoricals.from_logits(parameters, self.actions.sizes)


def deterministic(config: DeterministicConfig, task: Task) -> Numbers | Choices:
    """How the task's action space is learnt."""
    actions = actions_of(task.action_space, config.adapter, "point")
    return (Choices if actions.kind == "categorical" else Numbers)(actions, config)


@torch.no_grad()
def climb(agent: Agent, form: Deterministic, config: DeterministicConfig, batch: Batch) -> None:
    """One step of Adam of the policy, whose gradient passes through the critics and its action, by the chain rule."""
    critics, multipliers = agent.critics, agent.multipliers.values
    outputs, through_policy = agent.policy.actor.forward_and_backward(batch.obs)
    action, through_action = form.rsample_and_backward(outputs, agent.generator)
    values, through_critics = critics.stack.forward_and_input_backward(
        torch.cat([batch.obs, action], 1), critics.leading
    )
    of_values, of_outputs = policy_slopes(config, values[..., 0], outputs, multipliers)
    of_action = through_critics(of_values.unsqueeze(-1))[:, batch.obs.shape[1] :]
    through_policy(through_action(of_action) + of_outputs)
    agent.improve(policy_loss(config, values[..., 0], outputs, multipliers))


def _mixed(raw: Tensor, form: Deterministic, share: float, generator: torch.Generator) -> Tensor:
    """Raw actions [B, A], of which about so large a share is replaced by uniform ones."""
    replaced = torch.rand(len(raw), 1, generator=generator, device=raw.device) < share
    return torch.where(replaced, form.actions.uniform(len(raw), generator), raw)


def _normal(like: Tensor, generator: torch.Generator) -> Tensor:
    return torch.randn(like.shape, generator=generator, device=like.device)
