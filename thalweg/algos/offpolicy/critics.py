"""Critics of actions: several of the reward and of each cost, computed as one, and copies that follow slowly.

Letters: K critics, B states, S = 1 + M signals (the reward, then M costs).
"""

import copy
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from thalweg.algos.policy.mlp_autograd import ALL
from thalweg.algos.policy.networks import NetworkShape, StackedMLP


class Critics:
    """K critics in one stack: those of the reward, then the first of each cost, then the second of each.

    Where there are several of a signal, the reward's smallest counts and a cost's largest: neither is to look better
    than it is.
    """

    def __init__(
        self,
        rewards: int,
        costs: int,
        twins: int,
        *,
        inputs: int,
        outputs: int,
        shape: NetworkShape,
        generator: torch.Generator,
    ) -> None:
        """`rewards` critics of the reward and `twins` of each of so many costs."""
        self.rewards, self.costs, self.twins = rewards, costs, twins
        self.stack = StackedMLP(
            rewards + twins * costs,
            inputs,
            shape.hidden,
            outputs,
            activation=shape.activation,
            initial=shape.initial,
            generator=generator,
        )
        self.signal = torch.tensor([0] * rewards + list(range(1, 1 + costs)) * twins, device=generator.device)
        """[K] which signal each critic is of."""
        self.leading = slice(rewards - 1, rewards + costs) if rewards + twins > 2 else ALL
        """One critic of each signal [S]: the reward's last, and the first of each cost."""

    def each(self, for_reward: Tensor, for_costs: Tensor) -> Tensor:
        """[K, B, D] what each critic is asked: the reward's and the costs' something else [B, D]."""
        others = self.twins * self.costs
        return torch.stack([for_reward] * self.rewards + [for_costs] * others)

    def cautious(self, values: Tensor) -> Tensor:
        """[S, B, ...] from the values of all critics [K, B, ...]: the reward's smallest, each cost's largest."""
        if self.rewards == self.twins == 1:
            return values
        reward, costs = values[: self.rewards], values[self.rewards :]
        smallest = reward.amin(0, keepdim=True) if self.rewards > 1 else reward
        largest = costs.view(self.twins, self.costs, *values.shape[1:]).amax(0) if self.twins > 1 else costs
        return torch.cat([smallest, largest])


class Slow:
    """Copies of stacks that follow them: θ' ← θ' + τ (θ - θ') (Lillicrap et al. 2016, algorithm 1).

    All parameters are laid into one vector and all copies into another, so that following is one call.
    """

    def __init__(self, stacks: Sequence[StackedMLP]) -> None:
        self.fast = torch.cat([stack.flat.detach() for stack in stacks])
        self.slow = self.fast.clone()
        lengths = [stack.flat.numel() for stack in stacks]
        self.copies = [copy.deepcopy(stack) for stack in stacks]
        """Of each stack, in their order; never to be trained."""
        for stack, twin, fast, slow in zip(
            stacks, self.copies, self.fast.split(lengths), self.slow.split(lengths), strict=True
        ):
            stack.flat = nn.Parameter(fast)
            twin.flat = nn.Parameter(slow, requires_grad=False)

    def catch_up(self) -> None:
        """Make the copies equal again."""
        self.slow.copy_(self.fast)

    def follow(self, rate: float) -> None:
        """Move the copies by τ = `rate`."""
        self.slow.lerp_(self.fast, rate)
