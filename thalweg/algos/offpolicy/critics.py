"""Critics of actions, several of the reward and of each cost computed as one stack, and target networks.

Letters: K critics, B states, D inputs, S = 1 + M signals (the reward, then M costs).
"""

import copy
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from thalweg.algos.policy.mlp import StackedMLP
from thalweg.algos.policy.mlp_autograd import ALL
from thalweg.algos.policy.networks import NetworkShape


class Critics:
    """K critics in one stack: those of the reward, then the first of each cost, then the second of each cost.

    Where a signal has several, the smallest estimate of the reward and the largest of a cost is used: neither may look
    better than it is.
    """

    def __init__(
        self,
        reward_critics: int,
        costs: int,
        cost_critics: int,
        *,
        inputs: int,
        outputs: int,
        shape: NetworkShape,
        generator: torch.Generator,
    ) -> None:
        """Create `reward_critics` critics of the reward and `cost_critics` of each of `costs` costs."""
        self.reward_critics, self.costs, self.cost_critics = reward_critics, costs, cost_critics
        self.stack = StackedMLP(
            reward_critics + cost_critics * costs,
            inputs,
            shape.hidden,
            outputs,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )
        signals = [0] * reward_critics + list(range(1, 1 + costs)) * cost_critics
        self.signal = torch.tensor(signals, device=generator.device)
        """[K] index of the signal that each critic estimates."""
        several = reward_critics + cost_critics > 2
        self.one_per_signal = slice(reward_critics - 1, reward_critics + costs) if several else ALL
        """Slice of one critic of each signal [S]: the reward's last, and the first of each cost."""

    def inputs_by_signal(self, for_reward: Tensor, for_costs: Tensor) -> Tensor:
        """Return [K, B, D] inputs of all critics, one [B, D] for those of the reward and one for those of the costs."""
        count = self.cost_critics * self.costs
        return torch.stack([for_reward] * self.reward_critics + [for_costs] * count)

    def pessimistic(self, values: Tensor) -> Tensor:
        """Return [S, B, ...] from the values of all critics [K, B, ...]: the reward's smallest, each cost's largest."""
        if self.reward_critics == self.cost_critics == 1:
            return values
        reward, costs = values[: self.reward_critics], values[self.reward_critics :]
        if self.reward_critics > 1:
            reward = reward.amin(0, keepdim=True)
        if self.cost_critics > 1:
            costs = costs.view(self.cost_critics, self.costs, *values.shape[1:]).amax(0)
        return torch.cat([reward, costs])


class TargetNetworks:
    """Copies of stacks that follow them: θ' ← θ' + τ (θ - θ') (Lillicrap et al. 2016, algorithm 1).

    All parameters are views of one vector and those of the copies of another, so that one call updates all copies.
    """

    def __init__(self, stacks: Sequence[StackedMLP]) -> None:
        self.online = torch.cat([stack.flat.detach() for stack in stacks])
        """θ, the parameters of all stacks."""
        self.target = self.online.clone()
        """θ', those of the copies."""
        lengths = [stack.flat.numel() for stack in stacks]
        self.copies = [copy.deepcopy(stack) for stack in stacks]
        """Copy of each stack, in their order; never trained."""
        views = zip(self.online.split(lengths), self.target.split(lengths), strict=True)
        for stack, target, (online_view, target_view) in zip(stacks, self.copies, views, strict=True):
            stack.flat = nn.Parameter(online_view)
            target.flat = nn.Parameter(target_view, requires_grad=False)

    def hard_update(self) -> None:
        """Set the copies equal to the stacks."""
        self.target.copy_(self.online)

    def soft_update(self, rate: float) -> None:
        """Move the copies by τ = `rate`."""
        self.target.lerp_(self.online, rate)
