"""Natural-gradient steps of a policy: gradients, Fisher products and the line search.

Letters: P parameters of the policy, B states.
"""

from collections.abc import Callable, Iterable, Iterator

import torch
from torch import Tensor

from thalweg.algos.constraint.multiplier import SETTLING
from thalweg.algos.maths import losses
from thalweg.algos.maths.trust_region import conjugate_gradient
from thalweg.algos.onpolicy.agent import Agent
from thalweg.algos.onpolicy.config import NaturalConfig
from thalweg.algos.onpolicy.kl_monitor import KLMonitor
from thalweg.algos.onpolicy.rollout_samples import Samples
from thalweg.algos.policy.distributions import Distribution
from thalweg.algos.policy.memory import Sequences


class NaturalStep:
    """One natural-gradient step of a policy from a rollout: gradients of E[ρ A] and of the KL from the policy that the
    run begins with, curvature of the KL, line search."""

    def __init__(
        self, agent: Agent, samples: Samples, monitor: KLMonitor, config: NaturalConfig, progress: float = 0.0
    ) -> None:
        """Prepare a step; `progress` is the share of the run's steps taken before this rollout."""
        self._agent, self._samples, self._drift, self._config = agent, samples, monitor, config
        self._actor = agent.policy.actor
        self._start = vector_of(self._actor.parameters()).detach().clone()
        dimensions = agent.policy.actions.count if config.kl_per_dimension else 1
        self._share = 1.0 / dimensions
        settled = min(1.0, (1.0 - progress) / SETTLING) if config.radius_settles else 1.0
        self.radius = config.trust_radius * settled * min(1.0, samples.rollout_steps / agent.rollout_steps)
        """Trust region δ. A shorter last rollout reduces it in proportion, as its gradient is noisier."""
        self._curved = self._curvature_samples()
        agent.imitation_weight = config.imitation_weight(progress)
        with torch.no_grad():
            old = agent.policy.actions.distribution(monitor.old_parameters)
            self.imitation = float(agent.imitation(old, samples.imitated))
            """w E[KL(π ‖ π_0)] of the policy that acted."""

    def gradient(self, advantages: Tensor) -> Tensor:
        """Return ∇ E[ρ A] [P] at the policy that acted, for advantages [B]."""
        actions, old_log_prob = self._samples.actions, self._drift.old_log_prob
        return self._mean_gradient(
            lambda new, rows: losses.surrogate(new.log_prob(actions[rows]), old_log_prob[rows], advantages[rows])
        )

    def imitation_gradient(self) -> Tensor:
        """Return ∇ w E[KL(π ‖ π_0)] [P] at the policy that acted; zeros if there is no such term."""
        imitated = self._samples.imitated
        if not self._agent.imitation_weight or not imitated.shape[1]:
            return torch.zeros_like(self._start)
        return self._mean_gradient(lambda new, rows: torch.as_tensor(self._agent.imitation(new, imitated[rows])))

    def solve(self, gradient: Tensor) -> Tensor:
        """Return H⁻¹ g [P], where H is the curvature of the mean KL plus the damping."""
        inputs, rows = self._curved
        old = self._agent.policy.actions.distribution(self._drift.old_parameters[rows])
        new = self._agent.policy.actions.distribution(self._actor(inputs, twice_differentiable=True))
        slope = self._flat(self._share * old.kl(new).mean(), create_graph=True)

        def product(vector: Tensor) -> Tensor:
            bent = torch.autograd.grad(slope.dot(vector), list(self._actor.parameters()), retain_graph=True)
            return vector_of(bent) + self._config.damping * vector

        return conjugate_gradient(product, gradient, self._config.conjugate_iterations)

    @torch.no_grad()
    def search(self, step: Tensor, accepts: Callable[[Tensor, float], bool]) -> int:
        """Take the longest accepted step along `step` [P] within the trust region; return how many were rejected.

        Each trial is shorter than the one before. `accepts` is called with log π(a|s) [B] and w E[KL(π ‖ π_0)] after
        the step. If all trials are rejected, the policy stays unchanged. While critics warm up, nothing is tried.
        """
        if self._agent.critics_warm_up:
            return 0
        for tried in range(self._config.backtracks):
            self._put(self._start + self._config.backtrack_factor**tried * step)
            new = self._agent.policy.distribution_of(self._samples.inputs)
            old = self._agent.policy.actions.distribution(self._drift.old_parameters)
            kl = self._share * float(old.kl(new).mean())
            imitation = float(self._agent.imitation(new, self._samples.imitated))
            if kl <= self.radius and accepts(new.log_prob(self._samples.actions), imitation):
                return tried
        self._put(self._start)
        return self._config.backtracks

    def _curvature_samples(self) -> tuple[Tensor | Sequences, Tensor | slice]:
        """Return the inputs and rows from which the Fisher matrix is computed: all, or as many random ones as the
        config says."""
        most = self._config.curvature_steps
        if not most or most >= len(self._samples.actions):
            return self._samples.inputs, slice(None)
        return self._samples.drawn(most, self._agent.generator)

    def _mean_gradient(self, mean_of: Callable[[Distribution, Tensor | slice], Tensor]) -> Tensor:
        """Return the gradient [P] of a mean over all samples.

        `mean_of` takes the distribution at some rows, and returns the mean over them.
        """
        whole = torch.zeros_like(self._start)
        for inputs, rows, share in self._parts():
            whole += share * self._flat(mean_of(self._agent.policy.distribution_of(inputs), rows))
        return whole

    def _parts(self) -> Iterator[tuple[Tensor | Sequences, Tensor | slice, float]]:
        """Yield the samples whole, or with eyes, whose layers are too large for that, in minibatches: inputs, rows and
        their share of all."""
        samples = self._samples
        if not self._config.sees_images:
            yield samples.inputs, slice(None), 1.0
            return
        for inputs, rows in samples.parts(self._config.minibatch):
            yield inputs, rows, len(rows) / len(samples.actions)

    def _put(self, vector: Tensor) -> None:
        """Copy a vector [P] into the parameters in place, so that views of them stay valid."""
        parameters = list(self._actor.parameters())
        for parameter, part in zip(parameters, vector.split([each.numel() for each in parameters]), strict=True):
            parameter.copy_(part.view_as(parameter))

    def _flat(self, scalar: Tensor, create_graph: bool = False) -> Tensor:
        parameters = list(self._actor.parameters())
        return vector_of(torch.autograd.grad(scalar, parameters, create_graph=create_graph))


def vector_of(tensors: Iterable[Tensor]) -> Tensor:
    """Return tensors as one vector [P], whatever their layout in memory; torch's own function takes no weights of
    convolutions whose channels are last."""
    return torch.cat([tensor.reshape(-1) for tensor in tensors])


def most_violated(means: tuple[float, ...], limits: tuple[float, ...]) -> tuple[int, float]:
    """Return the cost furthest above its limit, and by how much; -inf if its mean is NaN, before any episode."""
    gaps = [mean - limit for mean, limit in zip(means, limits, strict=True)]
    gaps = [-float("inf") if gap != gap else gap for gap in gaps]
    worst = max(range(len(gaps)), key=gaps.__getitem__)
    return worst, gaps[worst]
