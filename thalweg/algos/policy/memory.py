"""Memory of a policy: a stack of the last frames, or a gated recurrent unit.

A single observation does not contain the past, on which rewards can depend. Letters: N environments, D numbers of a
frame, K frames, L steps of a sequence, C sequences, M numbers of a state.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from thalweg.algos.common.state import CPU, array_of, tensor_of

Memory = Literal["none", "gru"]


class FrameStack:
    """The last K frames of N environments, concatenated: [N, D] -> [N, K * D], the newest last.

    At the beginning of an episode, its first frame is repeated.
    """

    def __init__(self, num_envs: int, size: int, frames: int, device: torch.device = CPU) -> None:
        self.frames = frames
        self._last = torch.zeros(num_envs, frames, size, dtype=torch.float32, device=device)

    def push(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Add observations [N, D], of which `fresh` [N] bool begin an episode, and return the stack [N, K * D]."""
        if self.frames == 1:
            return obs
        moved = torch.cat([self._last[:, 1:], obs.unsqueeze(1)], 1)
        self._last = torch.where(fresh.view(-1, 1, 1), obs.unsqueeze(1), moved)
        return self._last.flatten(1).clone()

    def peek(self, obs: Tensor, envs: Tensor) -> Tensor:
        """Return what `push` would for observations [F, D] of environments [F], without adding them."""
        if self.frames == 1:
            return obs
        return torch.cat([self._last[envs, 1:], obs.unsqueeze(1)], 1).flatten(1)

    def state(self) -> np.ndarray:
        """Return the frames [N, K, D]."""
        return array_of(self._last)

    def load_state(self, state: np.ndarray) -> None:
        """Restore what `state` returned; of a single frame, which is never read, nothing."""
        if self.frames > 1:
            self._last = tensor_of(state, self._last.device)


@dataclass(frozen=True)
class Sequences:
    """C sequences of L steps, the input of a recurrent network in place of B observations; padding is not used."""

    obs: Tensor
    """[L, C, D], normalised."""
    fresh: Tensor
    """[L, C] bool, whether the step begins an episode: the state is cleared before it."""
    starts: dict[str, Tensor]
    """[C, M] state before the first step, for each network by its name."""
    keep: Tensor
    """[B] int64, l * C + c of each step that counts."""


class Gru(nn.Module):
    """A gated recurrent unit (Cho et al. 2014, the reset gate behind the product as in torch): state h [N, M], from
    which and the observation features are made."""

    def __init__(self, inputs: int, size: int, generator: torch.Generator) -> None:
        super().__init__()
        self.size = size
        bound = 1.0 / math.sqrt(size)

        def uniform(*shape: int) -> nn.Parameter:
            empty = torch.empty(shape, dtype=torch.float32, device=generator.device)
            return nn.Parameter(empty.uniform_(-bound, bound, generator=generator))

        self.weight_in, self.weight = uniform(3 * size, inputs), uniform(3 * size, size)
        self.bias_in, self.bias = uniform(3 * size), uniform(3 * size)

    def step(self, obs: Tensor, state: Tensor, fresh: Tensor) -> Tensor:
        """Return the state [N, M] after observations [N, D], cleared first where `fresh` [N]."""
        state = state * (~fresh).unsqueeze(-1)
        return torch.gru_cell(obs, state, self.weight_in, self.weight, self.bias_in, self.bias)

    def states(self, obs: Tensor, fresh: Tensor, start: Tensor) -> Tensor:
        """Return the state after each of L steps [L, C, M]."""
        state, states = start, []
        for step in range(len(obs)):
            state = self.step(obs[step], state, fresh[step])
            states.append(state)
        return torch.stack(states)

    def features(self, sequences: Sequences, name: str) -> Tensor:
        """Return observation and state, concatenated [B, D + M], of the valid steps."""
        states = self.states(sequences.obs, sequences.fresh, sequences.starts[name])
        return torch.cat([sequences.obs, states], -1).flatten(0, 1)[sequences.keep]

    @torch.no_grad()
    def clear_inputs(self, which: Tensor) -> None:
        """Set the weights of inputs to 0: those of `which` [d] bool among the first d inputs."""
        self.weight_in[:, : len(which)][:, which] = 0.0

    def start(self, count: int) -> Tensor:
        """Return the initial state [N, M]: zeros."""
        return self.bias.new_zeros(count, self.size)
