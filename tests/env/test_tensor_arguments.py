"""Environments of tensors: what they make of states from before a reset."""

import gymnasium
import pytest
import torch

from tests.render.plain import plane
from thalweg.env.config import EnvConfig
from thalweg.env.torch_env import TensorRiverEnv

N = 3


def made(**options) -> TensorRiverEnv:
    return TensorRiverEnv(plane(), N, EnvConfig(**{"observation": "none", **options}), device="cpu")


def test_a_state_from_before_the_first_reset_leaves_a_reset_to_be_done():
    env, fresh = made(), made().get_state()
    env.reset(seed=0)
    env.set_state(fresh)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) before step\(\)"):
        env.step(torch.ones(N, 4, dtype=torch.int64))
