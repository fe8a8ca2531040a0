"""The KL divergence of an on-policy algorithm's policy from the one that collected the rollout.

Letters: B valid steps, P parameters of a distribution.
"""

from typing import TYPE_CHECKING

import torch
from torch import Tensor

from thalweg.algos.common.errors import require_finite
from thalweg.algos.onpolicy.config import FirstOrderConfig
from thalweg.algos.onpolicy.rollout_samples import Samples

if TYPE_CHECKING:
    from thalweg.algos.onpolicy.agent import Agent


class KLMonitor:
    """The KL divergence of the policy from the one that collected the rollout, measured after each pass."""

    def __init__(self, agent: "Agent", samples: Samples, *, new_first: bool = False) -> None:
        """Remember the policy π_k; `new_first` measures KL(π_θ ‖ π_k) instead of KL(π_k ‖ π_θ)."""
        self._agent, self._samples, self._new_first = agent, samples, new_first
        with torch.no_grad():
            self.old_parameters = agent.policy.actor.in_blocks(samples.inputs)
            """Distribution parameters [B, P] of π_k."""
            self._old = agent.policy.actions.distribution(self.old_parameters)
            self.old_log_prob = self._old.log_prob(samples.actions)
            """log π_k(a|s) [B]."""
        self.passes, self.kl, self.entropy = 0, 0.0, 0.0
        self.imitation_kl = float("nan")
        """Mean KL(π_θ ‖ π_0) from the policy that the run begins with; NaN unless it is in the loss."""
        self.kl_per_state = torch.zeros_like(self.old_log_prob)
        """KL [B] of each state, in nats."""
        self.log_prob = self.old_log_prob
        """log π_θ(a|s) [B]."""

    @torch.no_grad()
    def measure(self) -> None:
        """Measure KL and entropy after a pass; raise `NotFiniteError` if the policy has become NaN."""
        policy = self._agent.policy
        new = policy.actions.distribution(policy.actor.in_blocks(self._samples.inputs))
        self.kl_per_state = new.kl(self._old) if self._new_first else self._old.kl(new)
        self.log_prob = new.log_prob(self._samples.actions)
        self.kl, self.entropy = float(self.kl_per_state.mean()), float(new.entropy().mean())
        if self._samples.imitated.shape[1]:
            self.imitation_kl = float(new.kl(policy.actions.distribution(self._samples.imitated)).mean())
        self.passes += 1
        require_finite(kl=self.kl, entropy=self.entropy)

    @property
    def ratio(self) -> Tensor:
        """Probability ratio π_θ(a|s) / π_k(a|s) [B]."""
        return (self.log_prob - self.old_log_prob).exp()

    def clip_fraction(self, clip: float) -> float:
        """Return the share of states whose ratio is outside 1 ± ε."""
        return float(((self.ratio - 1.0).abs() > clip).float().mean())

    @property
    def may_continue(self) -> bool:
        """Whether another pass is allowed: fewer than `passes` so far, and a KL of at most `target_kl`."""
        config = self._agent.config
        assert isinstance(config, FirstOrderConfig)
        return self.passes < config.passes and self.kl <= config.target_kl
