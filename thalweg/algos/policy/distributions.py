"""Action distributions at a batch of states: samples, log-probabilities, entropies, divergences and their gradients.

The formulas are in `maths`. Letters: B states, A branches or numbers of an action, K options, P parameters.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol, Self

import torch
from torch import Tensor

from thalweg.algos.maths import categorical, gaussian

LOG_STD_RANGE = (-20.0, 2.0)
"""Range of the log standard deviation of a squashed Gaussian, as in its authors' code."""
ATANH_MARGIN = 1e-6
"""Actions are clamped to within this of ±1 before the inverse of tanh."""


class Distribution(Protocol):
    """π(·|s) at B states."""

    def sample(self, generator: torch.Generator | None) -> Tensor:
        """Return raw actions [B, A]."""
        ...

    def mode(self) -> Tensor:
        """Return deterministic raw actions [B, A]: the most probable options, or the mean."""
        ...

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return the log-probability [B] of raw actions [B, A]."""
        ...

    def entropy(self) -> Tensor:
        """Return the entropy [B], in nats."""
        ...

    def kl(self, other: Self) -> Tensor:
        """Return KL(self ‖ other) [B], in nats."""
        ...


class AnalyticDistribution(Distribution, Protocol):
    """A distribution with analytic gradients with respect to its parameters [B, P]."""

    def log_prob_grad(self, actions: Tensor) -> Tensor:
        """Return the gradient [B, P] of `log_prob`."""
        ...

    def entropy_grad(self) -> Tensor:
        """Return the gradient [B, P] of `entropy`."""
        ...

    def kl_grad(self, other: Self) -> Tensor:
        """Return the gradient [B, P] of KL(self ‖ other)."""
        ...


class Categoricals:
    """Independent categorical choices, from log-probabilities [B, A, K]."""

    def __init__(self, log_p: Tensor, present: Tensor | None = None) -> None:
        """`present` [A, K] bool is True for options that exist; None means all."""
        self.log_p, self.present = log_p, present

    @classmethod
    def from_logits(cls, logits: Tensor, sizes: tuple[int, ...]) -> "Categoricals":
        """Build from logits [B, Σ sizes], branch after branch; shorter branches are padded with absent options."""
        if len(set(sizes)) == 1:
            return cls(logits.view(-1, len(sizes), sizes[0]).log_softmax(-1))
        columns, absent = _columns(sizes, logits.device)
        return cls(logits[:, columns].masked_fill(absent, categorical.ABSENT).log_softmax(-1), ~absent)

    def sample(self, generator: torch.Generator | None) -> Tensor:
        uniform = torch.rand(self.log_p.shape[:-1], generator=generator, **_like(self.log_p))
        return categorical.sample(self.log_p, uniform)

    def mode(self) -> Tensor:
        return categorical.mode(self.log_p)

    def log_prob(self, actions: Tensor) -> Tensor:
        return categorical.log_prob(self.log_p, actions)

    def entropy(self) -> Tensor:
        return categorical.entropy(self.log_p)

    def kl(self, other: "Categoricals") -> Tensor:
        return categorical.kl(self.log_p, other.log_p)

    def log_prob_grad(self, actions: Tensor) -> Tensor:
        return self.logit_grad(categorical.log_prob_grad(self.log_p, actions))

    def entropy_grad(self) -> Tensor:
        return self.logit_grad(categorical.entropy_grad(self.log_p))

    def kl_grad(self, other: "Categoricals") -> Tensor:
        return self.logit_grad(categorical.kl_grad(self.log_p, other.log_p))

    def logit_grad(self, grad: Tensor) -> Tensor:
        """Return a gradient [B, A, K] as one of the logits [B, Σ sizes], without options that do not exist."""
        return grad.flatten(1) if self.present is None else grad[:, self.present]


class Gaussians:
    """A diagonal Gaussian, from mean and log standard deviation [B, A]."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std

    def sample(self, generator: torch.Generator | None) -> Tensor:
        noise = torch.randn(self.mean.shape, generator=generator, **_like(self.mean))
        return self.mean + self.log_std.exp() * noise

    def mode(self) -> Tensor:
        return self.mean

    def log_prob(self, actions: Tensor) -> Tensor:
        return gaussian.log_prob(self.mean, self.log_std, actions)

    def entropy(self) -> Tensor:
        return gaussian.entropy(self.log_std)

    def kl(self, other: "Gaussians") -> Tensor:
        return gaussian.kl(self.mean, self.log_std, other.mean, other.log_std)

    def log_prob_grad(self, actions: Tensor) -> Tensor:
        return gaussian.log_prob_grad(self.mean, self.log_std, actions)

    def entropy_grad(self) -> Tensor:
        return gaussian.entropy_grad(self.log_std)

    def kl_grad(self, other: "Gaussians") -> Tensor:
        return gaussian.kl_grad(self.mean, self.log_std, other.mean, other.log_std)


class SquashedGaussian:
    """A diagonal Gaussian squashed by tanh to -1..1, from mean and log standard deviation [B, A] before tanh."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std.clamp(*LOG_STD_RANGE)
        self._unclamped_log_std = log_std

    def rsample(self, generator: torch.Generator | None) -> tuple[Tensor, Tensor]:
        """Return reparametrised actions [B, A], which carry gradients, and their log-probabilities [B]."""
        actions, log_prob, _ = self.rsample_and_backward(generator)
        return actions, log_prob

    def rsample_and_backward(
        self, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor, Callable[[Tensor, Tensor], Tensor]]:
        """Return what `rsample` does, without recording, and a function that backpropagates.

        The function takes the gradients of actions and log-probabilities and returns that of the parameters [B, 2 A].
        """
        noise = torch.randn(self.mean.shape, generator=generator, **_like(self.mean))
        spread = self.log_std.exp() * noise
        before = self.mean + spread
        actions = before.tanh()

        def backward(of_actions: Tensor, of_log_prob: Tensor) -> Tensor:
            mean, log_std = gaussian.squashed_grads(actions, spread, of_actions, of_log_prob)
            return torch.cat([mean, log_std * (self._unclamped_log_std == self.log_std)], -1)

        return actions, gaussian.squashed_log_prob(self.mean, self.log_std, before), backward

    def sample(self, generator: torch.Generator | None) -> Tensor:
        return self.rsample(generator)[0]

    def mode(self) -> Tensor:
        return self.mean.tanh()

    def log_prob(self, actions: Tensor) -> Tensor:
        inside = actions.clamp(-1.0 + ATANH_MARGIN, 1.0 - ATANH_MARGIN)
        return gaussian.squashed_log_prob(self.mean, self.log_std, inside.atanh())

    def entropy(self) -> Tensor:
        """Return the entropy [B] of the Gaussian before tanh; that of the action has no closed form."""
        return gaussian.entropy(self.log_std)

    def kl(self, other: "SquashedGaussian") -> Tensor:
        """Return KL [B], exact: tanh is invertible, so it changes no divergence."""
        return gaussian.kl(self.mean, self.log_std, other.mean, other.log_std)


class Deterministic:
    """One action per state, in -1..1; exploration noise is added outside the policy."""

    def __init__(self, point: Tensor) -> None:
        self.point = point

    def sample(self, generator: torch.Generator | None) -> Tensor:
        return self.point

    def mode(self) -> Tensor:
        return self.point

    def log_prob(self, actions: Tensor) -> Tensor:
        raise TypeError("a deterministic policy has no density")

    def entropy(self) -> Tensor:
        raise TypeError("a deterministic policy has no entropy in nats")

    def kl(self, other: "Deterministic") -> Tensor:
        raise TypeError("the KL divergence of two deterministic policies is not finite")


class TapedDistribution:
    """A distribution on the fast path: autograd sees only the quantities [B] of the loss.

    Log-probability, entropy and KL are leaves of the recorded graph. After `loss.backward()`, `parameter_grad` combines
    their gradients with the analytic gradients with respect to the parameters, so that far fewer calls are recorded.
    """

    def __init__(self, distribution: AnalyticDistribution) -> None:
        self._distribution = distribution
        self._leaves: list[tuple[Tensor, Callable[[], Tensor]]] = []

    def log_prob(self, actions: Tensor) -> Tensor:
        return self._leaf(self._distribution.log_prob(actions), lambda: self._distribution.log_prob_grad(actions))

    def entropy(self) -> Tensor:
        return self._leaf(self._distribution.entropy(), self._distribution.entropy_grad)

    def kl(self, other: Any) -> Tensor:
        return self._leaf(self._distribution.kl(other), lambda: self._distribution.kl_grad(other))

    @torch.no_grad()
    def parameter_grad(self) -> Tensor:
        """Return the gradient [B, P] of the loss with respect to the parameters, after the loss's `backward`."""
        terms = [leaf.grad.unsqueeze(-1) * gradient() for leaf, gradient in self._leaves if leaf.grad is not None]
        total = terms[0]
        for term in terms[1:]:
            total += term
        return total

    def _leaf(self, value: Tensor, gradient: Callable[[], Tensor]) -> Tensor:
        self._leaves.append((value.requires_grad_(), gradient))
        return value


def _like(like: Tensor) -> dict[str, Any]:
    """Return the dtype and device of a tensor as keyword arguments."""
    return {"dtype": like.dtype, "device": like.device}


@cache
def _columns(sizes: tuple[int, ...], device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the column of each option [A, K], and which options do not exist [A, K] bool, for branches of different
    sizes."""
    longest, first = max(sizes), 0
    columns, absent = [], []
    for size in sizes:
        columns.append([first + min(k, size - 1) for k in range(longest)])
        absent.append([k >= size for k in range(longest)])
        first += size
    # The first call may be in inference mode, but the cached tensors are used in learning too.
    with torch.inference_mode(False):
        return torch.tensor(columns, device=device), torch.tensor(absent, device=device)
