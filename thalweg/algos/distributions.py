"""A policy at a batch of states: what it draws, how probable that was, how far it has moved. Formulas are in
`maths`."""

from functools import cache
from typing import Protocol, Self

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
        """The most probable raw actions [B, A]."""
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


class Categoricals:
    """Independent choices: log-probabilities [B, A, K]."""

    def __init__(self, log_p: Tensor) -> None:
        self.log_p = log_p

    @classmethod
    def from_logits(cls, logits: Tensor, sizes: tuple[int, ...]) -> "Categoricals":
        """From logits [B, Σ sizes], branch after branch; shorter branches are filled up with absent options."""
        if len(set(sizes)) == 1:
            return cls(logits.view(-1, len(sizes), sizes[0]).log_softmax(-1))
        columns, absent = _columns(sizes)
        return cls(logits[:, columns].masked_fill(absent, categorical.ABSENT).log_softmax(-1))

    def sample(self, generator: torch.Generator | None) -> Tensor:
        uniform = torch.rand(self.log_p.shape[:-1], dtype=self.log_p.dtype, generator=generator)
        return categorical.sample(self.log_p, uniform)

    def mode(self) -> Tensor:
        return categorical.mode(self.log_p)

    def log_prob(self, actions: Tensor) -> Tensor:
        return categorical.log_prob(self.log_p, actions)

    def entropy(self) -> Tensor:
        return categorical.entropy(self.log_p)

    def kl(self, other: "Categoricals") -> Tensor:
        return categorical.kl(self.log_p, other.log_p)


class Gaussians:
    """A diagonal Gaussian: mean and log standard deviation [B, A]."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std

    def sample(self, generator: torch.Generator | None) -> Tensor:
        noise = torch.randn(self.mean.shape, dtype=self.mean.dtype, generator=generator)
        return self.mean + self.log_std.exp() * noise

    def mode(self) -> Tensor:
        return self.mean

    def log_prob(self, actions: Tensor) -> Tensor:
        return gaussian.log_prob(self.mean, self.log_std, actions)

    def entropy(self) -> Tensor:
        return gaussian.entropy(self.log_std)

    def kl(self, other: "Gaussians") -> Tensor:
        return gaussian.kl(self.mean, self.log_std, other.mean, other.log_std)


class Squashed:
    """A diagonal Gaussian through tanh: mean and log standard deviation [B, A] before it; actions lie in -1..1."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std.clamp(*LOG_STD_RANGE)

    def rsample(self, generator: torch.Generator | None) -> tuple[Tensor, Tensor]:
        """Actions [B, A] that carry the gradient of the parameters, and their log-probabilities [B]."""
        noise = torch.randn(self.mean.shape, dtype=self.mean.dtype, generator=generator)
        before = self.mean + self.log_std.exp() * noise
        return before.tanh(), gaussian.squashed_log_prob(self.mean, self.log_std, before)

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

    def kl(self, other: "Squashed") -> Tensor:
        """Exact: tanh, being invertible, changes no divergence."""
        return gaussian.kl(self.mean, self.log_std, other.mean, other.log_std)


class Points:
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

    def kl(self, other: "Points") -> Tensor:
        raise TypeError("two points have no finite divergence")


@cache
def _columns(sizes: tuple[int, ...]) -> tuple[Tensor, Tensor]:
    """For branches of different sizes: column of each option [A, K], and which do not exist [A, K] bool."""
    longest, first = max(sizes), 0
    columns, absent = [], []
    for size in sizes:
        columns.append([first + min(k, size - 1) for k in range(longest)])
        absent.append([k >= size for k in range(longest)])
        first += size
    # The first caller may be acting, but these are kept for learning too.
    with torch.inference_mode(False):
        return torch.tensor(columns), torch.tensor(absent)
