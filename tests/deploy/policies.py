"""Policies with random weights, of every kind that can be exported."""

from typing import Any

import gymnasium
import numpy as np
import torch

from thalweg.algos.common.state import new_generator
from thalweg.algos.policy.actions import Actions, Adapter, Kind, actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.algos.policy.vision import Eyes
from thalweg.core import versions
from thalweg.encoder import Encoder, load_encoder
from thalweg.env.spaces import CHANNELS, action_space
from thalweg.render import RENDER_VERSION
from thalweg.train.observations import encoder_hash

CPU = torch.device("cpu")


def discrete() -> Actions:
    """The actions of the river task."""
    return actions_of(action_space("multidiscrete"))


def livened(policy: Policy) -> Policy:
    """The policy with weights that are large enough for its choices to differ."""
    with torch.no_grad():
        policy.actor.stack.flat.mul_(8.0)
        policy.actor.stack.flat.add_(0.2 * torch.randn(policy.actor.stack.flat.shape, generator=new_generator(CPU, 4)))
    return policy


def of_images(sees: str, memory: int = 0, **changes: Any) -> Policy:
    """A policy with convolutions."""
    eyes = Eyes((128, 128, CHANNELS[sees]), (4, 6, 8, 8), 24)
    shape = NetworkShape((16,), "relu", "kaiming", memory, eyes)
    about = About("DAgger", {}, {"observation": sees, "render_version": RENDER_VERSION, "env": {}} | changes)
    return livened(
        Policy(eyes.pixels + 4, discrete(), shape, greedy=True, generator=new_generator(CPU, 1), about=about)
    )


def of_codes(
    name: str, memory: int = 0, *, felt: bool = False, frames: int = 1, actions: Actions | None = None, **env: Any
) -> tuple[Policy, Encoder]:
    """A policy of the codes of a packaged encoder, with the encoder; `env`: fields of the training's `EnvConfig`."""
    encoder = load_encoder(name)
    context: dict[str, Any] = {"observation": "frames", "encoder": encoder_hash(encoder), "env": env}
    if felt:
        context["proprioception_version"] = versions.PROPRIOCEPTION
    size = encoder.latent + 9 * felt
    shape = NetworkShape((16, 16), "tanh", memory=memory)
    about = About("PPO", {}, context)
    policy = Policy(size, actions or discrete(), shape, frames=frames, generator=new_generator(CPU, 2), about=about)
    rows = np.random.default_rng(0).normal(2.0, 3.0, (50, frames * size))
    policy.normaliser.update(torch.from_numpy(rows).float())
    return livened(policy), encoder


def privileged() -> Policy:
    """A policy that sees what only the simulator knows."""
    about = About("PPO", {}, {"observation": "privileged", "privileged_version": versions.PRIVILEGED})
    return Policy(37, discrete(), NetworkShape(), about=about)


def numbers(kind: Kind) -> Actions:
    """Continuous actions of the river task."""
    return actions_of(action_space("continuous"), continuous=kind)


def rounded(adapter: Adapter, kind: Kind) -> Actions:
    """The actions of the river task as numbers that are rounded to options."""
    return actions_of(action_space("multidiscrete"), adapter, kind)


def of_images_and_numbers() -> Policy:
    """A policy with convolutions that chooses numbers."""
    eyes = Eyes((128, 128, 3), (4, 6, 8, 8), 24)
    about = About("PPO", {}, {"observation": "rgb", "render_version": RENDER_VERSION, "env": {}})
    return Policy(eyes.pixels + 4, numbers("gaussian"), NetworkShape((16,), eyes=eyes), about=about)


def of_other_numbers(low: float, count: int) -> Policy:
    """A policy of numbers from `low` to 1, of another environment."""
    space = gymnasium.spaces.Box(low, 1.0, (count,), np.float32)
    return Policy(load_encoder("default").latent, actions_of(space), NetworkShape(), about=of_codes("default")[0].about)
