"""Policies: a normaliser, a network and an action space, which map observations to actions.

Letters: N environments, B states, D numbers of an observation, K frames that are concatenated, A numbers of an action.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from torch import Tensor

from thalweg.algos.common.errors import AlgorithmError
from thalweg.algos.common.state import CPU, load_module, module_state, new_generator
from thalweg.algos.policy import fast_path
from thalweg.algos.policy.actions import Actions
from thalweg.algos.policy.distributions import Distribution
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.networks import Actor, NetworkShape
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.player import NetworkPlayer, Player
from thalweg.algos.policy.policy_file import (
    LOADERS,
    About,
    check_size,
    load_policy,
    save_policy,
    tensors_of,
    whole_number,
)

DEFAULT_SHAPE = NetworkShape()
NO_ORIGIN = About()
LAST_OPTIONS, SCALED = "last_options", "scaled"
"""Key of a policy file for how a policy with eyes sees its last options, and its value where they are scaled; there is
no such key otherwise."""


class OptionCopy(NamedTuple):
    """An option that begins with the weights of another one of its branch, less probable by a factor."""

    branch: int
    option: int
    """Number of the option in its branch."""
    like: int
    """That of the option whose weights it takes."""
    times_rarer: float
    """In every state it is as many times less probable."""


class AnyPolicy(Protocol):
    """What every policy provides, whether it is a network or a planner."""

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
    """A policy π(a|s) for observations of `obs_size` numbers, or for the last `frames` of them."""

    def __init__(
        self,
        obs_size: int,
        actions: Actions,
        shape: NetworkShape = DEFAULT_SHAPE,
        *,
        frames: int = 1,
        normalise: bool = True,
        greedy: bool = False,
        temperature: float = 1.0,
        generator: torch.Generator | None = None,
        about: About = NO_ORIGIN,
    ) -> None:
        """Initialise the network.

        Args:
            obs_size: D; of a policy with eyes, the bytes of a row, see `thalweg.algos.policy.vision`.
            actions: The action space.
            shape: Shape of the network.
            frames: K.
            normalise: Whether observations are standardised by running statistics.
            greedy: Whether the policy always takes its most probable action; exploration is then not part of it.
            temperature: Options are sampled from the softmax of the network's outputs divided by this.
            generator: Source of the initial weights; the policy is on its device.
            about: Origin of the policy.
        """
        self.obs_size, self.actions, self.shape, self.frames = obs_size, actions, shape, frames
        self.greedy, self.temperature, self.about = greedy, temperature, about
        self.origin: Policy | None = None
        """The policy that this one was initialised from."""
        if frames > 1 and shape.eyes is not None:
            raise AlgorithmError(f"a policy with eyes sees one frame at a time, got {frames} frames; give it a memory")
        generator = generator or new_generator(CPU)
        self.normaliser = Normaliser(frames * obs_size, normalise and shape.eyes is None, generator.device)
        self.actor = Actor(frames * obs_size, actions, shape, generator)
        self.branch_sizes = np.array(actions.sizes, np.int64)
        """[A] options of each branch."""

    @property
    def device(self) -> torch.device:
        """Device of the network: that of the generator given to `__init__`."""
        return self.actor.stack.flat.device

    @property
    def scales_options(self) -> bool:
        """Whether it sees numbers of last options that are scaled, see `LastOptions`."""
        return self.actor.eyes is not None and self.actor.eyes.last_options.scaled

    @property
    def draws_compiled(self) -> bool:
        """Whether its options are drawn by `option_sampling`: a small categorical network on the CPU."""
        actor = self.actor
        plain = actor.gru is None and actor.eyes is None
        suits = self.actions.kind == "categorical" and plain and actor.stack.compilable
        return suits and self.temperature == 1.0 and actor.stack.flat.is_cpu and fast_path.enabled()

    def distribution(self, obs: Tensor) -> Distribution:
        """Return π(a | s) for raw observations [B, K * D].

        Raises `AlgorithmError` for a policy with a recurrent memory, which acts through its player only.
        """
        if self.shape.memory:
            raise AlgorithmError("this policy has a recurrent memory: use policy.player(num_envs)")
        return self.actions.distribution(self.actor(self.normaliser(obs)) / self.temperature)

    def distribution_of(self, inputs: Tensor | Sequences) -> Distribution:
        """Return π(a | s) for inputs of the network: normalised observations [B, K * D], or sequences of them."""
        return self.actions.distribution(self.actor(inputs))

    def initialise_from(self, other: Any) -> None:
        """Copy the network and the statistics of observations of another policy, so that both have the same
        distribution: of policies with different temperatures, the network's outputs differ by the same factor.

        Weights of numbers that the other policy never saw vary are set to 0. Nothing was learnt about them, and the
        initial ones, random, would change the policy at once when such a number varies here.

        Raises `AlgorithmError` for a planner, which has no such network, and for a policy of another kind, naming each
        setting that differs.
        """
        if not isinstance(other, Policy):
            raise AlgorithmError(f"{other.about.algorithm} is a planner: it has no policy network to start from")
        mine, others = self._kind(), other._kind()
        differing = [
            f"{name} is {value} here and {others[name]} there" for name, value in mine.items() if value != others[name]
        ]
        if differing:
            if mine["image"] and others["image"] and mine["image"][-1] != others["image"][-1]:
                differing.append(
                    "images of rgb+mask have 4 channels, of rgb 3 and of mask 1: choose another observation"
                )
            raise AlgorithmError(f"a policy can't start from one of another kind: {'; '.join(differing)}")
        load_module(self.actor, module_state(other.actor))
        if self.temperature != other.temperature:
            self.actor.stack.scale_outputs(self.temperature / other.temperature)
        self.normaliser.load_state(other.normaliser.state())
        if (ignored := self.normaliser.ignored).any():
            self.actor.clear_inputs(ignored)
        self.origin = other

    def copy_option(self, copy: OptionCopy) -> None:
        """Give an option the weights of another one, with a bias lower by ln k, so that it is k times less probable;
        the ratios of the other options' probabilities stay as they are.

        Raises `AlgorithmError` for a policy that is not categorical.
        """
        if self.actions.kind != "categorical":
            raise AlgorithmError(f"the policy is {self.actions.kind}: it has no weights of options")
        first, (weight, bias) = sum(self.actions.sizes[: copy.branch]), self.actor.stack.layers[-1]
        for part in (weight, bias):
            part[..., first + copy.option] = part[..., first + copy.like]
        bias[..., first + copy.option] -= self.temperature * math.log(copy.times_rarer)

    def _kind(self) -> dict[str, Any]:
        """Return what must be equal for one policy to start from another, by the names of settings."""
        shape = self.shape
        return {
            "obs_size": self.obs_size,
            "actions": self.actions,
            "frame_stack": self.frames,
            "hidden": shape.hidden,
            "activation": shape.activation,
            "memory_size": shape.memory,
            "image": shape.eyes and shape.eyes.image,
            "filters": shape.eyes and shape.eyes.filters,
            "features": shape.eyes and shape.eyes.features,
            "normalise_observations": self.normaliser.enabled,
            LAST_OPTIONS: SCALED if self.scales_options else "plain",
        }

    def player(
        self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> NetworkPlayer:
        """Return a player that acts in N environments.

        Args:
            num_envs: N.
            deterministic: Whether to take the most probable action instead of a sampled one.
            generator: Source of the samples, on the policy's device; torch's global generator if None.
        """
        return NetworkPlayer(self, num_envs, deterministic or self.greedy, generator)

    def act(
        self, obs: np.ndarray, *, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> np.ndarray:
        """Return actions [N, ...] for the environment, given observations float32 [N, D], by a policy without memory.

        Raises `AlgorithmError` if D differs from `obs_size`, or for a policy with a frame stack or recurrent memory.
        """
        if self.frames > 1 or self.shape.memory or self.shape.eyes is not None:
            raise AlgorithmError("this policy uses earlier observations or actions: use policy.player(num_envs)")
        player = self.player(len(obs), deterministic=deterministic, generator=generator)
        return player(obs, np.zeros(len(obs), dtype=bool))

    def save(self, path: str | Path) -> None:
        """Write the policy to one file, atomically."""
        header = {
            "kind": "network",
            "obs_size": self.obs_size,
            "frames": self.frames,
            "greedy": self.greedy,
            **({"temperature": self.temperature} if self.temperature != 1.0 else {}),
            **({LAST_OPTIONS: SCALED} if self.scales_options else {}),
            "shape": self.shape.as_data(),
            "actions": self.actions.as_data(),
            "normaliser": {"count": self.normaliser.count, "enabled": self.normaliser.enabled},
        }
        tensors = {f"actor.{name}": value for name, value in module_state(self.actor).items()}
        if self.shape.eyes is None:  # images are not normalised
            moments = self.normaliser.state()
            tensors |= {f"normaliser.{name}": moments[name] for name in ("mean", "square")}
        save_policy(path, header, tensors, self.about)

    @classmethod
    def restored(
        cls, header: dict[str, Any], tensors: dict[str, np.ndarray], about: About, generator: torch.Generator
    ) -> "Policy":
        """Return the policy that `save` wrote, on the generator's device."""
        shape, actions = NetworkShape.from_data(header["shape"]), Actions.from_data(header["actions"])
        obs_size, frames = whole_number(header, "obs_size"), whole_number(header, "frames")
        features = frames * obs_size if shape.eyes is None else shape.eyes.features
        if shape.eyes is not None and obs_size != shape.eyes.pixels + actions.count:
            raise AlgorithmError(f"obs_size is {obs_size}, not the bytes of an image {shape.eyes.image} and an action")
        if type(shape.memory) is not int or shape.memory < 0:
            raise AlgorithmError(f"memory must be a whole number, got {shape.memory!r:.40}")
        if shape.memory:
            check_size(features, (shape.memory,), shape.memory, tensors)
        check_size(features + shape.memory, shape.hidden, actions.outputs, tensors)
        temperature = header.get("temperature", 1.0)
        if not isinstance(temperature, int | float) or not 0.0 < temperature < math.inf:
            raise AlgorithmError(f"temperature must be a number above 0, got {temperature!r:.40}")
        policy = cls(
            obs_size,
            actions,
            shape,
            frames=frames,
            greedy=bool(header["greedy"]),
            temperature=temperature,
            generator=generator,
            about=about,
        )
        load_module(policy.actor, tensors_of(tensors, "actor"))
        if policy.actor.eyes is not None and header.get(LAST_OPTIONS) != SCALED:  # as earlier versions took them
            policy.actor.eyes.last_options.unscale()
        if shape.eyes is None:
            policy.normaliser.load_state(header["normaliser"] | tensors_of(tensors, "normaliser"))
        return policy

    @staticmethod
    def load(path: str | Path, device: torch.device = CPU) -> Any:
        """Return the policy of a file, which may also be a planner; see `load_policy`."""
        return load_policy(path, device)


LOADERS["network"] = Policy.restored
