"""Policies with random weights, of every kind that can be exported."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from thalweg.algos.common.state import new_generator
from thalweg.algos.policy.actions import Actions, actions_of
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


def of_codes(name: str, memory: int = 0, *, felt: bool = False) -> tuple[Policy, Encoder]:
    """A policy of the codes of a packaged encoder, with the encoder."""
    encoder = load_encoder(name)
    context: dict[str, Any] = {"observation": "frames", "encoder": encoder_hash(encoder)}
    if felt:
        context["proprioception_version"] = versions.PROPRIOCEPTION
    size = encoder.latent + 9 * felt
    shape = NetworkShape((16, 16), "tanh", memory=memory)
    about = About("PPO", {}, context)
    policy = Policy(size, discrete(), shape, generator=new_generator(CPU, 2), about=about)
    policy.normaliser.update(torch.from_numpy(np.random.default_rng(0).normal(2.0, 3.0, (50, size))).float())
    return livened(policy), encoder


def privileged() -> Policy:
    """A policy that sees what only the simulator knows."""
    about = About("PPO", {}, {"observation": "privileged", "privileged_version": versions.PRIVILEGED})
    return Policy(37, discrete(), NetworkShape(), about=about)


def stacked() -> Policy:
    """A policy that sees four frames."""
    policy, encoder = of_codes("default")
    return Policy(encoder.latent, discrete(), NetworkShape(), frames=4, about=policy.about)


def continuous() -> Policy:
    """A policy that chooses numbers."""
    policy, encoder = of_codes("default")
    return Policy(encoder.latent, actions_of(action_space("continuous")), NetworkShape(), about=replace(policy.about))
