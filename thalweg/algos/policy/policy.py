"""Policies: from observations to actions, by a normaliser, a network and an action space, stored in one file.

The file is safetensors with JSON in its header: loading it can't execute code. Letters: N environments, D numbers of an
observation, K frames that a policy sees side by side.
"""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU, array_of, load_module, module_state, new_generator, tensor_of
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.distributions import Distribution
from thalweg.algos.policy.memory import FrameStack, Sequences
from thalweg.algos.policy.networks import Actor, NetworkShape
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.core.atomic_io import write_atomic

FORMAT = 2
"""Version of the policy file."""
HEADER = "thalweg_policy"
SMALL = NetworkShape()


@dataclass(frozen=True)
class About:
    """Where a policy comes from; kept in its file, and never used to act."""

    algorithm: str = ""
    config: dict[str, Any] = field(default_factory=dict)
    context: dict[str, Any] = field(default_factory=dict)
    """Free: the encoder's name, the renderer's version, scores."""


class Player(Protocol):
    """A policy in flight: it remembers what its episodes have shown it."""

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        """Actions [N, ...] as the environment takes them.

        Args:
            obs: [N, D] float32, one frame of each environment.
            fresh: [N] bool, whether it is the first of an episode.
        """
        ...


class AnyPolicy(Protocol):
    """What flies, whatever learnt it."""

    @property
    def obs_size(self) -> int: ...
    @property
    def actions(self) -> Actions: ...
    @property
    def about(self) -> About: ...
    def player(
        self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> Player: ...
    def save(self, path: str | Path) -> None: ...


class Policy:
    """π(a|s) for vectors of `obs_size` numbers, or for the last `frames` of them."""

    def __init__(
        self,
        obs_size: int,
        actions: Actions,
        shape: NetworkShape = SMALL,
        *,
        frames: int = 1,
        normalise: bool = True,
        greedy: bool = False,
        generator: torch.Generator | None = None,
        about: About = About(),
    ) -> None:
        """`greedy`: the policy is its most probable action; whatever draws others is not part of it."""
        self.obs_size, self.actions, self.shape, self.frames = obs_size, actions, shape, frames
        self.greedy, self.about = greedy, about
        generator = generator or new_generator(CPU)
        self.normaliser = Normaliser(frames * obs_size, normalise, generator.device)
        self.actor = Actor(frames * obs_size, actions, shape, generator)

    @property
    def device(self) -> torch.device:
        """Where it acts: that of the generator it was made with."""
        return self.actor.stack.flat.device

    def distribution(self, obs: Tensor) -> Distribution:
        """π(·|s) for raw observations [B, K * D]; of a policy with a recurrent memory, nothing is known without it."""
        if self.shape.memory:
            raise AlgorithmError("this policy has a memory: ask its player")
        return self.actions.distribution(self.actor(self.normaliser(obs)))

    def distribution_of(self, inputs: Tensor | Sequences) -> Distribution:
        """π(·|s) for what the network sees: normalised observations [B, K * D], or sequences of them."""
        return self.actions.distribution(self.actor(inputs))

    def initialise_from(self, other: Any) -> None:
        """Take over the network of another policy, and what it knows of observations.

        Raises `AlgorithmError` for a planner, which has none, and for one that sees, remembers or does other things,
        naming each that differs.
        """
        if not isinstance(other, Policy):
            raise AlgorithmError(f"{other.about.algorithm} plans: it has no network to begin with")
        here, there = self._kind(), other._kind()
        differing = [
            f"{name} is {value} here and {there[name]} there" for name, value in here.items() if value != there[name]
        ]
        if differing:
            raise AlgorithmError(f"a policy can't begin as one of another kind: {'; '.join(differing)}")
        load_module(self.actor, module_state(other.actor))
        self.normaliser.load_state(other.normaliser.state())

    def _kind(self) -> dict[str, Any]:
        """What two policies must have in common for one to begin as the other, by the names of settings."""
        shape = self.shape
        return {
            "obs_size": self.obs_size,
            "actions": self.actions,
            "frame_stack": self.frames,
            "hidden": shape.hidden,
            "activation": shape.activation,
            "memory_size": shape.memory,
            "normalise_observations": self.normaliser.enabled,
        }

    def player(
        self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> "NetworkPlayer":
        """The policy in N environments.

        Args:
            num_envs: N.
            deterministic: The most probable action instead of a drawn one.
            generator: Where the draws come from, one of the policy's device; torch's global one if None.
        """
        return NetworkPlayer(self, num_envs, deterministic or self.greedy, generator)

    def act(
        self, obs: np.ndarray, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> np.ndarray:
        """Actions [N, ...] as the environment takes them, for observations float32 [N, D]; for policies without memory.

        Raises `AlgorithmError` if D is not what the policy was trained on, or for a policy with a memory.
        """
        if self.frames > 1 or self.shape.memory:
            raise AlgorithmError("this policy remembers earlier observations: use policy.player(num_envs)")
        player = self.player(len(obs), deterministic=deterministic, generator=generator)
        return player(obs, np.zeros(len(obs), dtype=bool))

    def save(self, path: str | Path) -> None:
        """Write the policy as one file, whole or not at all."""
        header = {
            "kind": "network",
            "obs_size": self.obs_size,
            "frames": self.frames,
            "greedy": self.greedy,
            "shape": dataclasses.asdict(self.shape),
            "actions": self.actions.as_data(),
            "normaliser": {"count": self.normaliser.count, "enabled": self.normaliser.enabled},
        }
        tensors = {f"actor.{name}": value for name, value in module_state(self.actor).items()}
        moments = self.normaliser.state()
        tensors |= {f"normaliser.{name}": moments[name] for name in ("mean", "square")}
        save_policy(path, header, tensors, self.about)

    @classmethod
    def restored(
        cls, header: dict[str, Any], tensors: dict[str, np.ndarray], about: About, generator: torch.Generator
    ) -> "Policy":
        """A policy from what `save` wrote, on the generator's device."""
        shape = NetworkShape(**(header["shape"] | {"hidden": tuple(header["shape"]["hidden"])}))
        policy = cls(
            header["obs_size"],
            Actions.from_data(header["actions"]),
            shape,
            frames=header["frames"],
            greedy=header["greedy"],
            generator=generator,
            about=about,
        )
        load_module(policy.actor, tensors_of(tensors, "actor"))
        policy.normaliser.load_state(header["normaliser"] | tensors_of(tensors, "normaliser"))
        return policy

    @staticmethod
    def load(path: str | Path, device: torch.device = CPU) -> Any:
        """`load_policy`, under the name that a reader looks for."""
        return load_policy(path, device)


class NetworkPlayer:
    """A policy in N environments, with their frames and recurrent states."""

    def __init__(
        self,
        policy: Policy,
        num_envs: int,
        deterministic: bool,
        generator: torch.Generator | None,
        stacked: bool = False,
    ) -> None:
        """`stacked`: observations come with their K frames side by side already."""
        self.policy, self.deterministic, self.generator = policy, deterministic, generator
        self.num_envs = num_envs
        self._size = policy.obs_size * (policy.frames if stacked else 1)
        self._stack = FrameStack(num_envs, policy.obs_size, 1 if stacked else policy.frames, policy.device)
        gru = policy.actor.gru
        self.hidden = gru.start(num_envs) if gru is not None else None
        """[N, M] recurrent state after the last observation."""

    def __call__(self, obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
        return self.policy.actions.to_numpy(self.raw(*to_tensors(obs, fresh, self.policy.device)))

    @torch.inference_mode()
    def raw(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Raw actions [N, A]; see `Actions` for what raw means."""
        check_obs_size(obs, self._size)
        policy = self.policy
        seen = policy.normaliser(self._stack.push(obs, fresh))
        if self.hidden is None:
            parameters = policy.actor(seen)
        else:
            parameters, self.hidden = policy.actor.step(seen, self.hidden, fresh)
        distribution = policy.actions.distribution(parameters)
        return distribution.mode() if self.deterministic else distribution.sample(self.generator)

    def state(self) -> dict[str, Any]:
        """What it remembers, as arrays."""
        hidden = {} if self.hidden is None else {"hidden": array_of(self.hidden)}
        return {"frames": self._stack.state(), **hidden}

    def load_state(self, state: dict[str, Any]) -> None:
        """The inverse of `state`."""
        self._stack.load_state(state["frames"])
        if self.hidden is not None:
            self.hidden = tensor_of(state["hidden"], self.policy.device)


def to_tensors(obs: np.ndarray, fresh: np.ndarray, device: torch.device) -> tuple[Tensor, Tensor]:
    """What a policy on a device sees of arrays of the host: [N, D] float32 and [N] bool."""
    seen = torch.from_numpy(np.ascontiguousarray(obs, dtype=np.float32))
    return seen.to(device), torch.from_numpy(np.array(fresh, dtype=bool)).to(device)


def check_obs_size(obs: Tensor, size: int) -> None:
    """Raise `AlgorithmError` unless observations are [N, size]."""
    if obs.dim() != 2 or obs.shape[1] != size:
        raise AlgorithmError(f"this policy sees [N, {size}] numbers, got an array of shape {tuple(obs.shape)}")


Restore = Callable[[dict[str, Any], dict[str, np.ndarray], About, torch.Generator], Any]
KINDS: dict[str, Restore] = {"network": Policy.restored}
"""How each kind of policy file is read; kinds that need more than a network add themselves."""


def save_policy(path: str | Path, header: dict[str, Any], tensors: dict[str, np.ndarray], about: About) -> None:
    """Write a policy file whole or not at all: tensors, and plain data of which "kind" says who reads it."""
    whole = {"format": FORMAT, **header, **dataclasses.asdict(about)}
    write_atomic(path, save(tensors, {HEADER: json.dumps(whole)}))


def load_policy(path: str | Path, device: torch.device = CPU) -> Any:
    """A policy from its file, on a device; raises `AlgorithmError` for a file that is missing, truncated or of another
    version."""
    path = Path(path)
    if not path.is_file():
        raise AlgorithmError(f"there is no policy at {path}: give a run's folder or a policy file")
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
        about = About(header["algorithm"], header["config"], header["context"])
        return KINDS[header["kind"]](header, tensors, about, new_generator(device))
    except (KeyError, RuntimeError, TypeError) as error:
        raise AlgorithmError(f"{path} does not hold what its header says: {error}") from error


def tensors_of(tensors: dict[str, np.ndarray], part: str) -> dict[str, np.ndarray]:
    """The tensors of a part of the policy, by their names within it."""
    return {name.removeprefix(f"{part}."): value for name, value in tensors.items() if name.startswith(f"{part}.")}
