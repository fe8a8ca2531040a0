"""Environments of tensors given states from before a reset, another default type of PyTorch, and actions of types that
NumPy lacks."""

from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest
import torch

from tests.render.plain import plane
from thalweg.env import RiverVectorEnv
from thalweg.env.config import EnvConfig
from thalweg.env.spaces import ActionError
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


@pytest.fixture
def coarse() -> Iterator[None]:
    """A default type of PyTorch with 8 bits of precision."""
    usual = torch.get_default_dtype()
    torch.set_default_dtype(torch.bfloat16)
    yield
    torch.set_default_dtype(usual)


def ahead(env: TensorRiverEnv) -> dict[str, torch.Tensor]:
    """The info after three steps forward."""
    env.reset(seed=2)
    forward = torch.tensor([[1, 1, 0, 1]] * N)
    return [env.step(forward)[4] for _ in range(3)][-1]


def test_progress_does_not_depend_on_the_default_type_of_pytorch(coarse: None):
    env = made()
    info, visited = ahead(env), env.get_state()["visited_count"]
    np.testing.assert_array_equal(info["progress"].double().numpy(), visited / env.worlds[0].river.segments)


def test_what_critics_see_of_an_episode_does_not_depend_on_the_default_type_of_pytorch(coarse: None):
    env = made(observation="privileged", critic_info=True)
    told, state = ahead(env)["critic_obs"].numpy(), env.get_state()
    arrays = RiverVectorEnv(plane(), N, env.config)
    limits = env.worlds[0].river.segments, env.config.max_idle_steps, arrays.courses.max_steps[0]
    counts = state["visited_count"], state["idle"], state["steps"]
    expected = np.stack([count / limit for count, limit in zip(counts, limits, strict=True)], 1)
    np.testing.assert_array_equal(told, expected.astype(np.float32))


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float8_e5m2])
def test_actions_may_have_a_type_that_numpy_lacks(kind: torch.dtype):
    poses = []
    for actions in (torch.full((N, 4), 0.25), torch.full((N, 4), 0.25).to(kind)):
        env = made(action="continuous")
        env.reset(seed=0)
        poses.append(env.step(actions)[4]["pose"])
    assert torch.equal(*poses)


def test_actions_of_complex_halves_are_refused_by_name():
    env = made(action="continuous")
    env.reset(seed=0)
    with pytest.raises(ActionError, match=r"actions are no array, .*ComplexHalf"):
        env.step(torch.zeros(N, 4, dtype=torch.complex32))
