"""Distributions over plans, from which candidates are sampled and which the weights of the candidates update.

Each option of a discrete action has a probability; a continuous action has a mean and a variance. Dimensions: N
environments, S candidates, H steps ahead, A branches or dimensions of an action, K options.
"""

from typing import Protocol

import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU
from thalweg.algos.maths import categorical, planning
from thalweg.algos.planning.config import PlanningConfig
from thalweg.algos.policy.actions import Actions


class PlanDistribution(Protocol):
    """Distribution over plans, with parameters [N, H, A, W] whose meaning only the distribution knows."""

    def first(self, envs: int) -> Tensor:
        """Return the initial parameters for `envs` environments, without any knowledge."""
        ...

    def shifted(self, plan: Tensor) -> Tensor:
        """Return the initial parameters for the next decision: the previous plan, shifted by one step."""
        ...

    def samples(self, plan: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """Sample `count` plans of raw actions [N, S, H, A]."""
        ...

    def updated(self, plan: Tensor, samples: Tensor, weights: Tensor) -> Tensor:
        """Return parameters updated by samples [N, S, H, A] with weights [N, S]."""
        ...

    def drawn_to(self, plan: Tensor, proposals: Tensor, share: float) -> Tensor:
        """Return parameters that proposed plans [N, G, H, A], equally weighted, replace by a share 0..1."""
        ...

    def variance(self, plan: Tensor) -> Tensor:
        """Return [N], the largest variance of any action in the plan."""
        ...

    def draw(self, plan: Tensor, generator: torch.Generator) -> Tensor:
        """Sample raw actions [N, A] of the first step."""
        ...

    def mode(self, plan: Tensor) -> Tensor:
        """Return the most probable raw actions [N, A] of the first step."""
        ...


def plan_distribution_of(
    actions: Actions, config: PlanningConfig, mean_momentum: float, device: torch.device = CPU
) -> "PlanDistribution":
    """Return the distribution for an action space: categorical for discrete actions, else Gaussian."""
    if actions.kind == "categorical":
        return CategoricalPlans(actions.sizes, config, device)
    return GaussianPlans(actions.count, config, mean_momentum, device)


class CategoricalPlans:
    """Independent categorical distributions with probabilities [N, H, A, K]."""

    def __init__(self, sizes: tuple[int, ...], config: PlanningConfig, device: torch.device = CPU) -> None:
        """Raises `AlgorithmError` for a floor that leaves no probability to a plan."""
        if config.floor * max(sizes) >= 1:
            raise AlgorithmError(
                f"floor must be less than 1/{max(sizes)} where a choice has {max(sizes)} options, got {config.floor}"
            )
        self.config = config
        counts = torch.tensor(sizes, device=device)
        self.exists = torch.arange(max(sizes), device=device) < counts.unsqueeze(-1)
        """[A, K] bool: whether branch a has an option k."""
        self.uniform = self.exists.float() / counts.unsqueeze(-1)

    def first(self, envs: int) -> Tensor:
        return self.uniform.expand(envs, self.config.sizes.horizon, *self.uniform.shape).clone()

    def shifted(self, plan: Tensor) -> Tensor:
        keep = self.config.carry_over
        guess = self.first(len(plan))
        guess[:, :-1] = keep * plan[:, 1:] + (1.0 - keep) * guess[:, :-1]
        return guess

    def samples(self, plan: Tensor, count: int, generator: torch.Generator) -> Tensor:
        shape = (len(plan), count, *plan.shape[1:3])
        return categorical.drawn(
            plan.unsqueeze(1), torch.rand(shape, dtype=torch.float32, generator=generator, device=plan.device)
        )

    def updated(self, plan: Tensor, samples: Tensor, weights: Tensor) -> Tensor:
        return planning.categorical_step(plan, samples, weights, self.exists, self.config.momentum, self.config.floor)

    def drawn_to(self, plan: Tensor, proposals: Tensor, share: float) -> Tensor:
        weights = _equal_weights(proposals)
        return planning.categorical_step(plan, proposals, weights, self.exists, 1.0 - share, self.config.floor)

    def variance(self, plan: Tensor) -> Tensor:
        return (plan * (1.0 - plan)).flatten(1).amax(1)

    def draw(self, plan: Tensor, generator: torch.Generator) -> Tensor:
        uniform = torch.rand(plan[:, 0, :, 0].shape, dtype=torch.float32, generator=generator, device=plan.device)
        return categorical.drawn(plan[:, 0], uniform)

    def mode(self, plan: Tensor) -> Tensor:
        return categorical.mode(plan[:, 0])


class GaussianPlans:
    """Independent Gaussian distributions clipped to -1..1, with mean and variance [N, H, A, 2]."""

    def __init__(self, count: int, config: PlanningConfig, mean_momentum: float, device: torch.device = CPU) -> None:
        self.count, self.config, self.mean_momentum, self.device = count, config, mean_momentum, device

    def first(self, envs: int) -> Tensor:
        plan = torch.zeros(envs, self.config.sizes.horizon, self.count, 2, dtype=torch.float32, device=self.device)
        plan[..., 1] = self.config.initial_std**2
        return plan

    def shifted(self, plan: Tensor) -> Tensor:
        """Shift the means by one step and reset the variances, since small ones would end the next search too soon."""
        guess = self.first(len(plan))
        guess[:, :-1, :, 0] = plan[:, 1:, :, 0]
        return guess

    def samples(self, plan: Tensor, count: int, generator: torch.Generator) -> Tensor:
        mean, variance = plan.unsqueeze(1).unbind(-1)
        noise = torch.randn(
            len(plan), count, *plan.shape[1:3], dtype=torch.float32, generator=generator, device=plan.device
        )
        return torch.addcmul(mean, variance.sqrt(), noise).clamp_(-1.0, 1.0)

    def updated(self, plan: Tensor, samples: Tensor, weights: Tensor) -> Tensor:
        config, mean, variance = self.config, plan[..., 0], plan[..., 1]
        improved = planning.gaussian_step(
            mean, variance, samples, weights, config.momentum, self.mean_momentum, config.largest_variance
        )
        return torch.stack(improved, -1)

    def drawn_to(self, plan: Tensor, proposals: Tensor, share: float) -> Tensor:
        """The means move; the variances stay, as those of the proposals would end the search."""
        mean, variance = plan.unbind(-1)
        return torch.stack([torch.lerp(mean, proposals.mean(1), share), variance], -1)

    def variance(self, plan: Tensor) -> Tensor:
        return plan[..., 1].flatten(1).amax(1)

    def draw(self, plan: Tensor, generator: torch.Generator) -> Tensor:
        return self.samples(plan[:, :1], 1, generator)[:, 0, 0]

    def mode(self, plan: Tensor) -> Tensor:
        return plan[:, 0, :, 0].clamp(-1.0, 1.0)


def _equal_weights(proposals: Tensor) -> Tensor:
    """Return weights [N, G] of proposals [N, G, H, A] that sum to 1."""
    return torch.full(proposals.shape[:2], 1.0 / proposals.shape[1], dtype=torch.float32, device=proposals.device)
