"""Players: policies that act in N environments, with what they remember of the episodes.

Letters: N environments, D numbers of an observation, K frames that are concatenated, A numbers of an action.
"""

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import array_of, tensor_of
from thalweg.algos.policy import option_sampling
from thalweg.algos.policy.memory import FrameStack
from thalweg.algos.policy.vision import ImageRows
from thalweg.core.compute.torch_threads import torch_threads

if TYPE_CHECKING:
    from thalweg.algos.policy.policy import Policy


class Player(Protocol):
    """A policy acting in N environments, with the memory of their episodes."""

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return actions [N, ...] for the environment.

        Args:
            obs: [N, D] float32, one observation of each environment; for a policy with eyes images uint8
                [N, H, W, C].
            fresh: [N] bool, whether the frame is the first of an episode.
        """
        ...


class NetworkPlayer:
    """A policy acting in N environments, with their frame stacks and recurrent states."""

    def __init__(
        self,
        policy: "Policy",
        num_envs: int,
        deterministic: bool,
        generator: torch.Generator | None,
        stacked: bool = False,
    ) -> None:
        """Start with empty memory; `stacked` says that observations already consist of K concatenated frames."""
        self.policy, self.deterministic, self.generator = policy, deterministic, generator
        self.num_envs = num_envs
        self._size = policy.obs_size * (policy.frames if stacked else 1)
        eyes, frames = policy.shape.eyes, 1 if stacked else policy.frames
        # A single frame is never read; of images it would take megabytes of every checkpoint.
        kept = 0 if eyes is not None and frames == 1 else policy.obs_size
        self._stack = FrameStack(num_envs, kept, frames, policy.device)
        gru = policy.actor.gru
        self.hidden = gru.start(num_envs) if gru is not None else None
        """[N, M] recurrent state after the last observation."""
        self._rows = None if eyes is None else ImageRows(num_envs, eyes.image, policy.actions.count)
        self._seen: tuple[Tensor, Tensor | None] | None = None
        """What the network was last given [N, K * D], and the parameters that it returned, if it was asked."""

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Return actions [N, A] for observations [N, ...], of which `fresh` [N] bool begin an episode; raises
        `AlgorithmError` for another number of either."""
        fresh = np.asarray(fresh)
        if len(obs) != self.num_envs or fresh.shape != (self.num_envs,):
            raise AlgorithmError(
                f"this player acts in {self.num_envs} environments, got {len(obs)} observations and fresh of shape"
                f" {list(fresh.shape)}"
            )
        if self._rows is not None:
            obs = self._rows.rows(obs, fresh)
        # A second thread of PyTorch would wait for its next task in a loop, on the core that draws the next frames.
        with torch_threads(1):
            raw = self.raw(*to_tensors(obs, fresh, self.policy.device, self._rows is not None))
        if self._rows is not None:
            self._rows.note(self.policy.actions.options(raw).cpu().numpy())
        return self.policy.actions.to_numpy(raw)

    @torch.inference_mode()
    def raw(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Return raw actions [N, A], as defined in `actions`."""
        check_obs_size(obs, self._size)
        policy, stacked = self.policy, self._stack.push(obs, fresh)
        self._seen = stacked, None
        if policy.draws_compiled and len(obs) <= option_sampling.MAX_ROWS:
            return self._drawn_options(stacked)
        inputs = policy.normaliser(stacked)
        if self.hidden is None:
            parameters = policy.actor(inputs)
        else:
            parameters, self.hidden = policy.actor.step(inputs, self.hidden, fresh)
        if policy.temperature != 1.0:
            parameters = parameters / policy.temperature
        self._seen = stacked, parameters
        distribution = policy.actions.distribution(parameters)
        return distribution.mode() if self.deterministic else distribution.sample(self.generator)

    def parameters(self) -> np.ndarray | None:
        """Return the parameters float32 [N, P] of the distribution after the last observation, see `Actor`, divided by
        the temperature; None if it has seen nothing yet, or draws its options without them."""
        parameters = None if self._seen is None else self._seen[1]
        return None if parameters is None else array_of(parameters)

    @torch.inference_mode()
    def log_probs(self) -> np.ndarray | None:
        """Return the logarithmic probability float32 [N, A, K] of each option of each branch after the last
        observation; None for a policy that is not categorical, or has seen nothing yet."""
        if self._seen is None or self.policy.actions.kind != "categorical":
            return None
        stacked, parameters = self._seen
        if parameters is None:
            return array_of(self.policy.distribution(stacked).log_p)  # pyright: ignore[reportAttributeAccessIssue]
        distribution = self.policy.actions.distribution(parameters)
        return array_of(distribution.log_p)  # pyright: ignore[reportAttributeAccessIssue]

    def correct(self, actions: np.ndarray) -> None:
        """Remember that the environment executed other actions [N, A] than the player's last ones; a policy with eyes
        sees them with the next image."""
        if self._rows is not None:
            self._rows.note(np.asarray(actions) - np.asarray(self.policy.actions.start))

    def _drawn_options(self, stacked: Tensor) -> Tensor:
        """Return what `raw` does, by one compiled call, for observations [N, K * D]."""
        policy, sizes = self.policy, self.policy.actions.sizes
        drawn = (0 if self.deterministic else len(stacked), len(sizes))
        uniform = torch.rand(drawn, generator=self.generator, dtype=torch.float32)
        options = np.empty((len(stacked), len(sizes)), np.int64)
        option_sampling.draw_options(
            stacked.contiguous().numpy(),
            policy.normaliser.arrays(),
            policy.actor.stack.arrays(),
            policy.branch_sizes,
            uniform.numpy(),
            options,
        )
        return torch.from_numpy(options)

    def state(self) -> dict[str, Any]:
        """Return frames and recurrent states as arrays."""
        hidden = {} if self.hidden is None else {"hidden": array_of(self.hidden)}
        last = {} if self._rows is None else {"last": self._rows.last.copy()}
        return {"frames": self._stack.state(), **hidden, **last}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self._stack.load_state(state["frames"])
        if self.hidden is not None:
            self.hidden = tensor_of(state["hidden"], self.policy.device)
        if self._rows is not None:
            self._rows.note(state["last"])


def to_tensors(
    obs: np.ndarray, fresh: np.ndarray, device: torch.device, as_bytes: bool = False
) -> tuple[Tensor, Tensor]:
    """Return observations [N, D] as float32, or `as_bytes`, and `fresh` [N] as bool, on a device."""
    observed = torch.from_numpy(np.ascontiguousarray(obs, dtype=np.uint8 if as_bytes else np.float32))
    return observed.to(device), torch.from_numpy(np.array(fresh, dtype=bool)).to(device)


def check_obs_size(obs: Tensor, size: int) -> None:
    """Raise `AlgorithmError` unless observations are [N, size]."""
    if obs.dim() != 2 or obs.shape[1] != size:
        raise AlgorithmError(f"this policy takes observations [N, {size}], got an array of shape {tuple(obs.shape)}")
