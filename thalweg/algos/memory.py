"""How does a policy remember? The last frames side by side, or a recurrent network with a state of its own.

One observation has no past, while a reward can depend on where one has been. Letters: N environments, D numbers of a
frame, K frames, L steps of a sequence, C sequences, M numbers of a state.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

Memory = Literal["none", "gru"]


class FrameStack:
    """The last K frames of N environments side by side, [N, D] -> [N, K * D], the newest last.

    Before there are K, the first one of the episode stands for those that are missing.
    """

    def __init__(self, num_envs: int, size: int, frames: int) -> None:
        self.frames = frames
        self._last = np.zeros((num_envs, frames, size), dtype=np.float32)

    def push(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Take in observations [N, D], of which `fresh` [N] bool begin an episode; returns all of them [N, K * D]."""
        if self.frames == 1:
            return obs
        self._last = np.where(fresh[:, None, None], obs[:, None], self._with(obs))
        return self._last.reshape(len(obs), -1).copy()

    def peek(self, obs: np.ndarray, envs: np.ndarray) -> np.ndarray:
        """What `push` would return for observations [F, D] of environments [F] whose episodes go on; it changes
        nothing."""
        if self.frames == 1:
            return obs
        return np.concatenate([self._last[envs, 1:], obs[:, None]], 1).reshape(len(obs), self._last[0].size)

    def state(self) -> np.ndarray:
        """[N, K, D]."""
        return self._last.copy()

    def load_state(self, state: np.ndarray) -> None:
        """The inverse of `state`."""
        self._last = np.array(state, dtype=np.float32)

    def _with(self, obs: np.ndarray) -> np.ndarray:
        return np.concatenate([self._last[:, 1:], obs[:, None]], 1)


@dataclass(frozen=True)
class Sequences:
    """C sequences of L steps, some of which count: what a recurrent network is given instead of B observations."""

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
            return nn.Parameter(torch.empty(shape).uniform_(-bound, bound, generator=generator))

        self.weight_in, self.weight = uniform(3 * size, inputs), uniform(3 * size, size)
        self.bias_in, self.bias = uniform(3 * size), uniform(3 * size)

    def step(self, obs: Tensor, state: Tensor, fresh: Tensor) -> Tensor:
        """The state [N, M] after observations [N, D], cleared first where `fresh` [N]."""
        state = state * (~fresh).unsqueeze(-1)
        return torch.gru_cell(obs, state, self.weight_in, self.weight, self.bias_in, self.bias)

    def states(self, obs: Tensor, fresh: Tensor, start: Tensor) -> Tensor:
        """The state after each of L steps [L, C, M]."""
        state, states = start, []
        for step in range(len(obs)):
            state = self.step(obs[step], state, fresh[step])
            states.append(state)
        return torch.stack(states)

    def features(self, sequences: Sequences, name: str) -> Tensor:
        """Observation and state side by side [B, D + M], of the steps that count."""
        states = self.states(sequences.obs, sequences.fresh, sequences.starts[name])
        return torch.cat([sequences.obs, states], -1).flatten(0, 1)[sequences.keep]

    def start(self, count: int) -> Tensor:
        """[N, M] zeros: before anything was seen."""
        return torch.zeros(count, self.size)
