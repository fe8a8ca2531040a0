"""Untrained policies that see images themselves, for tests of what is flown with them."""

from typing import Any

import gymnasium as gym
import torch

from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy import Policy
from thalweg.algos.policy.policy_file import About
from thalweg.algos.policy.vision import Eyes
from thalweg.env.spaces import CHANNELS
from thalweg.render import RENDER_VERSION

ACTIONS = actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]))


def image_policy(images: str = "rgb+mask", size: int = 128, *, memory: int = 4, **changes: Any) -> Policy:
    """A small policy of images of size x size pixels; what it sees and remembers decides. `changes` are of its context,
    in which None removes a key."""
    eyes = Eyes((size, size, CHANNELS[images]), (4, 4), 8)
    context = {"observation": images, "render_version": RENDER_VERSION} | changes
    context = {name: value for name, value in context.items() if value is not None}
    shape = NetworkShape((8,), initial="kaiming", memory=memory, eyes=eyes)
    generator = torch.Generator().manual_seed(0)
    policy = Policy(eyes.pixels + ACTIONS.count, ACTIONS, shape, generator=generator, about=About("PPO", {}, context))
    with torch.no_grad():
        policy.actor.stack.flat.mul_(10.0)
    return policy
