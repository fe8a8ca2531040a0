"""What flies: observations in, actions out. A network, a normaliser and the meaning of its outputs, in one file on
disk.

The file is safetensors with JSON in its header: loading it can't execute code.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save
from torch import Tensor, nn

from thalweg.algos.actions import Actions
from thalweg.algos.distributions import Distribution
from thalweg.algos.errors import AlgorithmError
from thalweg.algos.networks import Perceptron
from thalweg.algos.normaliser import Normaliser
from thalweg.algos.state import load_module, module_state
from thalweg.whole import write_whole

FORMAT = 1
"""Version of the policy file."""
HEADER = "thalweg_policy"


@dataclass(frozen=True)
class About:
    """Where a policy comes from; kept in its file, and never used to act."""

    algorithm: str = ""
    config: dict[str, Any] = field(default_factory=dict)
    context: dict[str, Any] = field(default_factory=dict)
    """Free: the encoder's name, the renderer's version, scores."""


class Actor(nn.Module):
    """Parameters of the policy at each state: logits, or means and a log standard deviation that no state changes."""

    def __init__(self, inputs: int, hidden: tuple[int, ...], actions: Actions, generator: torch.Generator) -> None:
        super().__init__()
        # A last layer near zero: the first policy draws every option alike whatever it sees.
        self.mean = Perceptron(inputs, hidden, actions.outputs, 0.01, generator)
        self.log_std = None if actions.kind == "categorical" else nn.Parameter(torch.zeros(actions.count))

    def forward(self, obs: Tensor) -> Tensor:
        outputs = self.mean(obs)
        return outputs if self.log_std is None else torch.cat([outputs, self.log_std.expand_as(outputs)], -1)


class Policy:
    """π(a|s) for vectors of `obs_size` numbers."""

    def __init__(
        self,
        obs_size: int,
        actions: Actions,
        hidden: tuple[int, ...] = (64, 64),
        *,
        normalise: bool = True,
        generator: torch.Generator | None = None,
        about: About = About(),
    ) -> None:
        self.obs_size, self.actions, self.hidden, self.about = obs_size, actions, hidden, about
        self.normaliser = Normaliser(obs_size, normalise)
        self.actor = Actor(obs_size, hidden, actions, generator or torch.Generator().manual_seed(0))

    def distribution(self, obs: Tensor) -> Distribution:
        """π(·|s) for raw observations [B, D]."""
        return self.actions.distribution(self.actor(self.normaliser(obs)))

    @torch.inference_mode()
    def sample(self, obs: np.ndarray, generator: torch.Generator | None, deterministic: bool = False) -> Tensor:
        """Raw actions [N, A] for observations [N, D]; see `Actions` for what raw means."""
        obs = np.ascontiguousarray(obs, dtype=np.float32)
        if obs.ndim != 2 or obs.shape[1] != self.obs_size:
            raise AlgorithmError(f"this policy sees [N, {self.obs_size}] numbers, got an array of shape {obs.shape}")
        distribution = self.distribution(torch.from_numpy(obs))
        return distribution.mode() if deterministic else distribution.sample(generator)

    def act(
        self, obs: np.ndarray, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> np.ndarray:
        """Actions [N, ...] as the environment takes them, for observations float32 [N, D].

        Args:
            obs: [N, D].
            deterministic: The most probable action instead of a drawn one.
            generator: Where the draws come from; torch's global one if None.

        Raises `AlgorithmError` if D is not what the policy was trained on.
        """
        return self.actions.to_env(self.sample(obs, generator, deterministic))

    def save(self, path: str | Path) -> None:
        """Write the policy as one file, whole or not at all."""
        header = {
            "format": FORMAT,
            "obs_size": self.obs_size,
            "hidden": list(self.hidden),
            "actions": self.actions.as_data(),
            "normaliser": {"count": self.normaliser.count, "enabled": self.normaliser.enabled},
            "algorithm": self.about.algorithm,
            "config": self.about.config,
            "context": self.about.context,
        }
        tensors = {f"actor.{name}": value for name, value in module_state(self.actor).items()}
        tensors |= {"normaliser.mean": self.normaliser.mean, "normaliser.square": self.normaliser.square}
        write_whole(path, save(tensors, {HEADER: json.dumps(header)}))

    @classmethod
    def load(cls, path: str | Path) -> "Policy":
        """A policy from its file; raises `AlgorithmError` for a file that is missing, truncated or of another
        version."""
        path = Path(path)
        if not path.is_file():
            raise AlgorithmError(f"there is no policy file {path}")
        try:
            with safe_open(path, framework="numpy") as file:
                header = json.loads((file.metadata() or {}).get(HEADER, "null"))
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
        except (SafetensorError, json.JSONDecodeError) as error:
            raise AlgorithmError(f"{path} is not a whole policy file: {error}") from error
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            version = header.get("format") if isinstance(header, dict) else "none"
            raise AlgorithmError(f"{path} holds a policy of format {version}, this version reads {FORMAT}")
        try:
            return cls._restored(header, tensors)
        except (KeyError, RuntimeError, TypeError) as error:
            raise AlgorithmError(f"{path} does not hold what its header says: {error}") from error

    @classmethod
    def _restored(cls, header: dict[str, Any], tensors: dict[str, np.ndarray]) -> "Policy":
        about = About(header["algorithm"], header["config"], header["context"])
        policy = cls(header["obs_size"], Actions.from_data(header["actions"]), tuple(header["hidden"]), about=about)
        actor = {name.removeprefix("actor."): value for name, value in tensors.items() if name.startswith("actor.")}
        load_module(policy.actor, actor)
        statistics = {name: tensors[f"normaliser.{name}"] for name in ("mean", "square")}
        policy.normaliser.load_state(header["normaliser"] | statistics)
        return policy
