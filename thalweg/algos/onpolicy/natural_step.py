"""Natural-gradient steps of a policy: gradients, Fisher products and the line search.

Letters: P parameters of the policy, B states.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn.utils import parameters_to_vector

from thalweg.algos.constraint.multiplier import SETTLING
from thalweg.algos.maths import losses
from thalweg.algos.maths.trust_region import conjugate_gradient
from thalweg.algos.onpolicy.agent import Agent, KLMonitor
from thalweg.algos.onpolicy.config import NaturalConfig
from thalweg.algos.onpolicy.rollout_samples import Samples


class NaturalStep:
    """One natural-gradient step of a policy from a rollout: gradients of E[ρ A], curvature of the KL, line search."""

    def __init__(
        self, agent: Agent, samples: Samples, monitor: KLMonitor, config: NaturalConfig, progress: float = 0.0
    ) -> None:
        """Prepare a step; `progress` is the share of the run's steps taken before this rollout."""
        self._agent, self._samples, self._drift, self._config = agent, samples, monitor, config
        self._actor = agent.policy.actor
        self._start = parameters_to_vector(self._actor.parameters()).detach().clone()
        dimensions = agent.policy.actions.count if config.kl_per_dimension else 1
        self._share = 1.0 / dimensions
        settled = min(1.0, (1.0 - progress) / SETTLING) if config.radius_settles else 1.0
        self.radius = config.trust_radius * settled * min(1.0, samples.rollout_steps / agent.rollout_steps)
        """Trust region δ. A shorter last rollout reduces it in proportion, as its gradient is noisier."""

    def gradient(self, advantages: Tensor) -> Tensor:
        """Return ∇ E[ρ A] [P] at the policy that acted, for advantages [B]."""
        log_prob = self._agent.policy.distribution_of(self._samples.inputs).log_prob(self._samples.actions)
        return self._flat(losses.surrogate(log_prob, self._drift.old_log_prob, advantages))

    def solve(self, gradient: Tensor) -> Tensor:
        """Return H⁻¹ g [P], where H is the curvature of the mean KL plus the damping."""
        old = self._agent.policy.actions.distribution(self._drift.old_parameters)
        new = self._agent.policy.actions.distribution(self._actor(self._samples.inputs, twice_differentiable=True))
        slope = self._flat(self._share * old.kl(new).mean(), create_graph=True)

        def product(vector: Tensor) -> Tensor:
            bent = torch.autograd.grad(slope.dot(vector), list(self._actor.parameters()), retain_graph=True)
            return parameters_to_vector(bent) + self._config.damping * vector

        return conjugate_gradient(product, gradient, self._config.conjugate_iterations)

    @torch.no_grad()
    def search(self, step: Tensor, accepts: Callable[[Tensor], bool]) -> int:
        """Take the longest accepted step along `step` [P] within the trust region; return how many were rejected.

        Each trial is shorter than the one before. `accepts` is called with log π(a|s) [B] after the step. If all trials
        are rejected, the policy stays unchanged. While critics warm up, nothing is tried.
        """
        if self._agent.critics_warm_up:
            return 0
        for tried in range(self._config.backtracks):
            self._put(self._start + self._config.backtrack_factor**tried * step)
            new = self._agent.policy.distribution_of(self._samples.inputs)
            old = self._agent.policy.actions.distribution(self._drift.old_parameters)
            kl = self._share * float(old.kl(new).mean())
            if kl <= self.radius and accepts(new.log_prob(self._samples.actions)):
                return tried
        self._put(self._start)
        return self._config.backtracks

    def _put(self, vector: Tensor) -> None:
        """Copy a vector [P] into the parameters in place, so that views of them stay valid."""
        parameters = list(self._actor.parameters())
        for parameter, part in zip(parameters, vector.split([each.numel() for each in parameters]), strict=True):
            parameter.copy_(part.view_as(parameter))

    def _flat(self, scalar: Tensor, create_graph: bool = False) -> Tensor:
        parameters = list(self._actor.parameters())
        return parameters_to_vector(torch.autograd.grad(scalar, parameters, create_graph=create_graph))


def most_violated(means: tuple[float, ...], limits: tuple[float, ...]) -> tuple[int, float]:
    """Return the cost furthest above its limit, and by how much; -inf if its mean is NaN, before any episode."""
    gaps = [mean - limit for mean, limit in zip(means, limits, strict=True)]
    gaps = [-float("inf") if gap != gap else gap for gap in gaps]
    worst = max(range(len(gaps)), key=gaps.__getitem__)
    return worst, gaps[worst]
