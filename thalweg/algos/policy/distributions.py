"""A policy at a batch of states: what it draws, how probable that was, how far it has moved. Formulas are in
`maths`."""

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol, Self

import torch
from torch import Tensor

from thalweg.algos.maths import categorical, gaussian

LOG_STD_RANGE = (-20.0, 2.0)
"""Of a squashed Gaussian, as its authors' code has it."""
NEARLY = 1e-6
"""How close to ±1 an action is when it is taken back through tanh."""


class Distribution(Protocol):
    """π(·|s) at B states."""

    def sample(self, generator: torch.Generator | None) -> Tensor:
        """Raw actions [B, A]."""
        ...

    def mode(self) -> Tensor:
        """The raw actions [B, A] of a policy that draws no lots: the most probable options, or the numbers in the
        middle."""
        ...

    def log_prob(self, actions: Tensor) -> Tensor:
        """[B], of raw actions [B, A]."""
        ...

    def entropy(self) -> Tensor:
        """[B], in nats."""
        ...

    def kl(self, other: Self) -> Tensor:
        """KL(self ‖ other) [B], in nats."""
        ...


class AnalyticDistribution(Distribution, Protocol):
    """One whose numbers' gradients in its parameters [B, P] are written out."""

    def log_prob_grad(self, actions: Tensor) -> Tensor:
        """[B, P]."""
        ...

    def entropy_grad(self) -> Tensor:
        """[B, P]."""
        ...

    def kl_grad(self, other: Self) -> Tensor:
        """[B, P], of KL(self ‖ other)."""
        ...


class Categoricals:
    """Independent choices: log-probabilities [B, A, K]."""

    def __init__(self, log_p: Tensor, present: Tensor | None = None) -> None:
        """`present`: [A, K] bool, which options exist; None: all."""
        self.log_p, self.present = log_p, present

    @classmethod
    def from_logits(cls, logits: Tensor, sizes: tuple[int, ...]) -> "Categoricals":
        """From logits [B, Σ sizes], branch after branch; shorter branches are filled up with absent options."""
        if len(set(sizes)) == 1:
            return cls(logits.view(-1, len(sizes), sizes[0]).log_softmax(-1))
        columns, absent = _columns(sizes, logits.device)
        return cls(logits[:, columns].masked_fill(absent, categorical.ABSENT).log_softmax(-1), ~absent)

    def sample(self, generator: torch.Generator | None) -> Tensor:
        uniform = torch.rand(self.log_p.shape[:-1], generator=generator, **_kind(self.log_p))
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

    def logit_grad(self, slope: Tensor) -> Tensor:
        """[B, Σ sizes] of a gradient [B, A, K]: without the options that do not exist."""
        return slope.flatten(1) if self.present is None else slope[:, self.present]


class Gaussians:
    """A diagonal Gaussian: mean and log standard deviation [B, A]."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std

    def sample(self, generator: torch.Generator | None) -> Tensor:
        noise = torch.randn(self.mean.shape, generator=generator, **_kind(self.mean))
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
    """A diagonal Gaussian through tanh: mean and log standard deviation [B, A] before it; actions lie in -1..1."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std.clamp(*LOG_STD_RANGE)
        self._given = log_std

    def rsample(self, generator: torch.Generator | None) -> tuple[Tensor, Tensor]:
        """Actions [B, A] that carry the gradient of the parameters, and their log-probabilities [B]."""
        actions, log_prob, _ = self.rsample_and_backward(generator)
        return actions, log_prob

    def rsample_and_backward(
        self, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor, Callable[[Tensor, Tensor], Tensor]]:
        """The same, and what gives from both their gradients that of the parameters [B, 2 A], for a draw that torch
        need not record."""
        noise = torch.randn(self.mean.shape, generator=generator, **_kind(self.mean))
        spread = self.log_std.exp() * noise
        before = self.mean + spread
        actions = before.tanh()

        def back(of_actions: Tensor, of_log_prob: Tensor) -> Tensor:
            mean, log_std = gaussian.squashed_grads(actions, spread, of_actions, of_log_prob)
            return torch.cat([mean, log_std * (self._given == self.log_std)], -1)

        return actions, gaussian.squashed_log_prob(self.mean, self.log_std, before), back

    def sample(self, generator: torch.Generator | None) -> Tensor:
        return self.rsample(generator)[0]

    def mode(self) -> Tensor:
        return self.mean.tanh()

    def log_prob(self, actions: Tensor) -> Tensor:
        inside = actions.clamp(-1.0 + NEARLY, 1.0 - NEARLY)
        return gaussian.squashed_log_prob(self.mean, self.log_std, inside.atanh())

    def entropy(self) -> Tensor:
        """Of the Gaussian before tanh; after it there is no closed form."""
        return gaussian.entropy(self.log_std)

    def kl(self, other: "SquashedGaussian") -> Tensor:
        """Exact: tanh, being invertible, changes no divergence."""
        return gaussian.kl(self.mean, self.log_std, other.mean, other.log_std)


class Deterministic:
    """One action per state, in -1..1: what explores stands outside the policy."""

    def __init__(self, point: Tensor) -> None:
        self.point = point

    def sample(self, generator: torch.Generator | None) -> Tensor:
        return self.point

    def mode(self) -> Tensor:
        return self.point

    def log_prob(self, actions: Tensor) -> Tensor:
        raise TypeError("a point has no density")

    def entropy(self) -> Tensor:
        raise TypeError("a point has no entropy in nats")

    def kl(self, other: "Deterministic") -> Tensor:
        raise TypeError("two points have no finite divergence")


class TapedDistribution:
    """A distribution that a loss is taken of: its numbers [B] are where torch begins to record, and what they mean for
    the parameters is written out, so that fewer calls are recorded."""

    def __init__(self, distribution: AnalyticDistribution) -> None:
        self._distribution = distribution
        self._asked: list[tuple[Tensor, Callable[[], Tensor]]] = []

    def log_prob(self, actions: Tensor) -> Tensor:
        found = self._distribution.log_prob(actions)
        return self._traced(found, lambda: self._distribution.log_prob_grad(actions))

    def entropy(self) -> Tensor:
        return self._traced(self._distribution.entropy(), self._distribution.entropy_grad)

    def kl(self, other: Any) -> Tensor:
        return self._traced(self._distribution.kl(other), lambda: self._distribution.kl_grad(other))

    @torch.no_grad()
    def slope(self) -> Tensor:
        """The gradient of the loss in the parameters [B, P], once that of the numbers asked for is there."""
        parts = [found.grad.unsqueeze(-1) * slope() for found, slope in self._asked if found.grad is not None]
        total = parts[0]
        for part in parts[1:]:
            total += part
        return total

    def _traced(self, found: Tensor, slope: Callable[[], Tensor]) -> Tensor:
        self._asked.append((found.requires_grad_(), slope))
        return found


def _kind(like: Tensor) -> dict[str, Any]:
    """What new numbers beside a tensor have in common with it."""
    return {"dtype": like.dtype, "device": like.device}


@cache
def _columns(sizes: tuple[int, ...], device: torch.device) -> tuple[Tensor, Tensor]:
    """For branches of different sizes: column of each option [A, K], and which do not exist [A, K] bool."""
    longest, first = max(sizes), 0
    columns, absent = [], []
    for size in sizes:
        columns.append([first + min(k, size - 1) for k in range(longest)])
        absent.append([k >= size for k in range(longest)])
        first += size
    # The first caller may be acting, but these are kept for learning too.
    with torch.inference_mode(False):
        return torch.tensor(columns, device=device), torch.tensor(absent, device=device)
