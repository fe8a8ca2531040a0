"""Tasks in environments of tensors on the CPU: step by step those of the vector environment."""

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

import thalweg
from tests.env.handmade import BlankRenderer, ring
from tests.env.task.priced.flights import PRICED, erratic, rivers
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.snapshot import StateError
from thalweg.env.task.progress_share import progress_of
from thalweg.env.task.rules import TASK_STATE
from thalweg.env.torch_env import TensorRiverEnv

N = 6


def both(task: str, **options) -> tuple[TensorRiverEnv, RiverVectorEnv]:
    config = EnvConfig(**{"observation": "privileged", "task": task, "critic_info": True, **options})
    worlds = [rivers()["ring"], rivers()["canal"]]
    renderer = BlankRenderer(128, 128)
    vector = RiverVectorEnv(worlds, N, config, renderer=renderer, autoreset_mode=AutoresetMode.NEXT_STEP)
    return TensorRiverEnv(worlds, N, config, device="cpu"), vector


def follow(vector: RiverVectorEnv, tensors: TensorRiverEnv, rows: np.ndarray, **reset) -> None:
    """Start the episodes of `rows` [N] bool of the vector environment where those of the tensors have started."""
    state = tensors.get_state()
    vector.reset(options={"reset_mask": rows, "pose": state["pose"]}, **reset)
    vector.state.scene[rows] = state["scene"][rows]
    for name in ("station", "way"):
        np.testing.assert_array_equal(getattr(vector.state, name), state[name])


@pytest.mark.parametrize(("action", "hard"), [("multidiscrete", False), ("multidiscrete", True), ("continuous", False)])
@pytest.mark.parametrize("task", PRICED)
def test_steps_are_those_of_the_vector_environment(task: str, action: str, hard: bool):
    tensors, vector = both(task, action=action, hard=hard, max_steps=30)
    assert tensors.cost_kinds == vector.cost_kinds
    tensors.reset(seed=3)
    follow(vector, tensors, np.ones(N, bool), seed=0)
    rng, ends, incurred = np.random.default_rng(0), 0, 0
    for _ in range(90):
        begun = tensors.get_state()["ended"].astype(bool)
        chosen = erratic(vector, rng) if action == "multidiscrete" else rng.uniform(-1, 1, (N, 4)).astype(np.float32)
        obs, reward, terminated, truncated, info = tensors.step(torch.from_numpy(chosen))
        their_obs, their_reward, their_terminated, their_truncated, their_info = vector.step(chosen)
        if begun.any():
            follow(vector, tensors, begun)
            their_obs, their_info["progress"] = (
                vector.observe(),
                progress_of(vector.config, vector.courses, vector.state),
            )
            their_info["critic_obs"] = vector.observer.critic_obs(vector.courses, vector.state)
        np.testing.assert_array_equal(obs.numpy(), their_obs)
        np.testing.assert_array_equal(reward.numpy(), their_reward)
        np.testing.assert_array_equal(terminated.numpy(), their_terminated)
        np.testing.assert_array_equal(truncated.numpy(), their_truncated)
        for name in ("cost", "costs", "done_reason"):
            np.testing.assert_array_equal(info[name].numpy(), their_info[name])
        for name in ("progress", "critic_obs"):
            np.testing.assert_allclose(info[name].numpy(), their_info[name], rtol=1e-6, atol=1e-6)
        ends += int((terminated | truncated).sum())
        incurred += int((info["done_reason"] == DoneReason.COST_INCURRED).sum())
    assert ends > N and (incurred > 0) == hard


@pytest.mark.parametrize("task", ["Swimmers", "Nests", "Portage"])
def test_the_same_objects_are_drawn(task: str):
    tensors, vector = both(task, observation="rgb")
    drawn = BlankRenderer(128, 128)
    tensors._observer.__dict__["renderer"] = drawn
    tensors.reset(seed=3)
    follow(vector, tensors, np.ones(N, bool), seed=0)
    np.testing.assert_array_equal(drawn.props, vector.props())
    assert drawn.props is not None and drawn.props[..., 0].any()


def test_scenes_differ_by_environment_and_episode_and_belong_to_the_state():
    env = thalweg.make_torch("Medium", 4, worlds=ring(), task="Swimmers", observation="none", device="cpu")
    env.reset(seed=0)
    first = env.get_state()
    env._tensors["ended"].fill_(1)
    env.step(torch.ones(4, 4, dtype=torch.int64))
    assert len(np.unique([first["scene"], env.get_state()["scene"]])) == 8
    env.set_state(first)
    np.testing.assert_array_equal(env.get_state()["scene"], first["scene"])
    plain = thalweg.make_torch("Medium", 4, worlds=ring(), observation="none", device="cpu")
    plain.reset(seed=0)
    assert not set(TASK_STATE) & set(plain.get_state())
    with pytest.raises(StateError):
        plain.set_state(first)
