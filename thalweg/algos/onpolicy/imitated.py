"""The policy that a run begins with, kept as it was: its distribution along rollouts, to which a KL is measured.

Letters: T steps, N environments, P parameters of an action distribution, M numbers of a recurrent state.
"""

from typing import Any

import torch
from torch import Tensor

from thalweg.algos.common.state import array_of, tensor_of
from thalweg.algos.interface import Rollout
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.policy import Policy


class Imitated:
    """A policy that does not change, with its recurrent states in N environments in which another one acts."""

    def __init__(self, policy: Policy, num_envs: int) -> None:
        self.policy = policy
        gru = policy.actor.gru
        self.hidden = None if gru is None else gru.start(num_envs)
        """[N, M] before the next rollout's first observation."""

    @torch.no_grad()
    def parameters(self, rollout: Rollout) -> Tensor:
        """Return the parameters [T * N, P] of its distribution at each step, divided by its temperature; the next
        rollout must follow this one."""
        return self._outputs(rollout) / self.policy.temperature

    def _outputs(self, rollout: Rollout) -> Tensor:
        """Return the outputs [T * N, P] of the network at each step."""
        steps, count = rollout.valid.shape
        actor, inputs = self.policy.actor, self.policy.normaliser(rollout.obs[:-1].flatten(0, 1))
        if self.hidden is None:
            return actor.in_blocks(inputs)
        along = inputs.view(steps, count, -1)
        every = torch.arange(steps * count, device=inputs.device)
        features = actor.features(Sequences(along, rollout.fresh[:-1], {"actor": self.hidden}, every))
        self.hidden = features[-count:, -self.hidden.shape[1] :].clone()
        return actor.parameters_of(features)

    def state(self) -> dict[str, Any]:
        """Return the recurrent states as arrays; the policy itself is that of a file."""
        return {} if self.hidden is None else {"hidden": array_of(self.hidden)}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        if self.hidden is not None:
            self.hidden = tensor_of(state["hidden"], self.policy.device)
