"""Tests that rollouts hold what only critics see beside each observation, in every autoreset mode, and what is
refused."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorWrapper

from tests.env.handmade import canal, ring
from tests.train.toys import Count, Pictures, ToldCount, ToldWalk, Walk
from thalweg.algos import NotFiniteError
from thalweg.algos.interface import Rollout
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.env import RiverEnv
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.train.errors import TrainingError
from thalweg.train.latent import LatentTensorEnv, LatentVectorEnv
from thalweg.train.rollouts.critic_info import critic_size
from thalweg.train.rollouts.env_stepper import EnvStepper
from thalweg.train.rollouts.rollout_buffer import RolloutBuffer

MODES = list(AutoresetMode)
LENGTHS = (3, 5)
STILL = np.zeros(2, np.int64)


def counting(mode: AutoresetMode, kind: type[Count] = ToldCount, **settings: Any) -> SyncVectorEnv:
    """Two counters, of three and of five steps."""
    return SyncVectorEnv([lambda: kind(3, **settings), lambda: kind(5, **settings)], autoreset_mode=mode)


def told(obs: torch.Tensor, envs: torch.Tensor) -> torch.Tensor:
    """What critics see beside observations [..., 2] of environments [...]."""
    return torch.cat([2 * obs, torch.tensor(LENGTHS)[envs].unsqueeze(-1)], -1)


def collected(stepper: EnvStepper, steps: int = 12) -> Rollout:
    """Some steps of both counters."""
    actions = torch.zeros(2, 1, dtype=torch.int64)
    obs, fresh = stepper.reset(0), np.ones(2, dtype=bool)
    buffer = RolloutBuffer(steps, obs, actions, np.zeros((2, 1)), critic_obs=stepper.critic_obs)
    while buffer.filled < buffer.steps:
        before = stepper.critic_obs
        step = stepper.step(STILL)
        buffer.add(obs, fresh, actions, step, step.cost[:, None], before)
        obs, fresh = step.next_obs, step.fresh
    return buffer.rollout()


@pytest.mark.parametrize("cut", [True, False])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_they_stand_beside_each_observation_and_each_last_one(mode: AutoresetMode, cut: bool):
    stepper = EnvStepper(counting(mode, cut=cut), critics=True)
    rollout = collected(stepper)
    assert stepper.critic_size == 3
    assert rollout.critic_obs is not None and rollout.final_critic_obs is not None
    assert torch.equal(rollout.critic_obs, told(rollout.obs, torch.arange(2).expand(13, 2)))
    assert len(rollout.final_index) >= 4
    assert torch.equal(rollout.final_critic_obs, told(rollout.final_obs, rollout.final_index % 2))


def test_frames_are_stacked_without_them():
    rollout = collected(EnvStepper(counting(AutoresetMode.SAME_STEP), frames=3, critics=True))
    assert rollout.critic_obs is not None and rollout.obs.shape == (13, 2, 6)
    assert torch.equal(rollout.critic_obs, told(rollout.obs[..., 4:], torch.arange(2).expand(13, 2)))


def test_a_short_rollout_after_a_longer_one_holds_its_own():
    stepper, actions = EnvStepper(counting(AutoresetMode.SAME_STEP), critics=True), torch.zeros(2, 1)
    obs, fresh = stepper.reset(0), np.ones(2, dtype=bool)
    buffer = RolloutBuffer(6, obs, actions, np.zeros((2, 1)), critic_obs=stepper.critic_obs)
    for count in (6, 4):
        buffer.clear()
        for _ in range(count):
            before = stepper.critic_obs
            step = stepper.step(STILL)
            buffer.add(obs, fresh, actions, step, step.cost[:, None], before)
            obs, fresh = step.next_obs, step.fresh
    rollout = buffer.rollout()
    assert rollout.critic_obs is not None and rollout.final_critic_obs is not None
    assert rollout.critic_obs.shape == (5, 2, 3) and len(rollout.final_critic_obs) == len(rollout.final_obs) == 2
    assert torch.equal(rollout.final_critic_obs, told(rollout.final_obs, rollout.final_index % 2))


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_who_does_not_ask_gets_none(mode: AutoresetMode):
    stepper = EnvStepper(counting(mode))
    rollout = collected(stepper)
    assert stepper.critic_size == 0 and "critic_obs" not in stepper.state()
    assert rollout.critic_obs is None and rollout.final_critic_obs is None


def test_an_environment_that_tells_nothing_gives_none():
    stepper = EnvStepper(counting(AutoresetMode.SAME_STEP, Count), critics=True)
    rollout = collected(stepper)
    assert stepper.critic_size == 0 and rollout.critic_obs is None and rollout.final_critic_obs is None


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_stepper_resumes_with_what_critics_see_now(mode: AutoresetMode):
    stepper = EnvStepper(counting(mode), critics=True)
    stepper.reset(0)
    for _ in range(7):
        stepper.step(STILL)
    other = EnvStepper(counting(mode), critics=True)
    other.load_state(stepper.state())
    assert stepper.critic_obs is not None and other.critic_obs is not None
    np.testing.assert_array_equal(other.critic_obs, stepper.critic_obs)
    before = other.critic_obs.copy()
    stepper.step(STILL)
    np.testing.assert_array_equal(other.critic_obs, before)


@pytest.mark.parametrize("observation", ["none", "privileged"])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_our_environments_are_read_as_gymnasiums_vector_of_single_ones(mode: AutoresetMode, observation: Any):
    config = EnvConfig(observation=observation, critic_info=True, max_idle_steps=5, max_steps=9)
    ours = EnvStepper(RiverVectorEnv([ring(), canal()], 2, config, autoreset_mode=mode), critics=True)
    makers = [lambda: RiverEnv(ring(), config), lambda: RiverEnv(canal(), config)]
    theirs = EnvStepper(SyncVectorEnv(makers, autoreset_mode=mode), critics=True)
    ours.reset([3, 4])
    theirs.reset([3, 4])
    assert ours.critic_size == theirs.critic_size == {"none": 40, "privileged": 3}[observation]
    random, ends = np.random.default_rng(0), 0
    for _ in range(40):
        actions = random.integers(0, 3, (2, 4))
        one, other = ours.step(actions), theirs.step(actions)
        assert one.critic_obs is not None and one.final_critic_obs is not None and other.critic_obs is not None
        np.testing.assert_array_equal(one.critic_obs, other.critic_obs)
        np.testing.assert_array_equal(one.final_critic_obs, other.final_critic_obs)
        assert not one.critic_obs[one.fresh, :3].any()  # no progress at the beginning
        assert (one.final_critic_obs[:, 2] > 0).all()
        ends += len(one.finished)
    assert ends > 5


class ToldPictures(Pictures):
    def __init__(self) -> None:
        super().__init__()
        self.single_critic_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)

    def reset(self, **given: Any):
        obs, info = super().reset(**given)
        return obs, info | {"critic_obs": np.full((3, 2), self.at)}

    def step(self, actions: Any):
        *rest, info = super().step(actions)
        last = {"critic_obs": np.full((3, 2), 100 + self.at)}
        return *rest, info | {"critic_obs": np.full((3, 2), self.at), "final_info": last}


def test_an_encoder_of_frames_leaves_them_as_they_are():
    class Mean:
        latent = 1

        def __call__(self, frames: np.ndarray) -> np.ndarray:
            return frames.reshape(len(frames), -1).mean(1, keepdims=True).astype(np.float32)

    env = LatentVectorEnv(ToldPictures(), Mean())
    stepper = EnvStepper(env, critics=True)
    stepper.reset(0)
    step = stepper.step(np.zeros(3, np.int64))
    assert env.single_critic_space.shape == (2,) and step.critic_obs is not None
    assert step.critic_obs.tolist() == [[1, 1]] * 3 and step.final_critic_obs is not None
    assert step.final_critic_obs.tolist() == [[101, 101]]


def test_an_encoder_of_tensors_leaves_them_as_they_are():
    class First:
        device, latent = torch.device("cpu"), 1

        def of_tensor(self, frames: torch.Tensor) -> torch.Tensor:
            return frames[:, 0, 0, :1].float()

    env = LatentTensorEnv(TensorRiverEnv([ring()], 2, EnvConfig(critic_info=True), device="cpu"), First())
    env.env.observe = lambda: torch.zeros(2, 1, 1, 4)  # nothing need be drawn
    _, info = env.reset(seed=0)
    *_, stepped = env.step(torch.ones(2, 4, dtype=torch.int64))
    assert critic_size(env) == 40 == info["critic_obs"].shape[1] == stepped["critic_obs"].shape[1]


def test_a_wrapper_need_not_know_of_them():
    assert critic_size(VectorWrapper(ToldWalk())) == 2
    assert critic_size(Walk()) == critic_size(counting(AutoresetMode.SAME_STEP, Count)) == 0


class Altered(ToldWalk):
    """Changes its info by a function."""

    def __init__(self, change: Any, mode: AutoresetMode = AutoresetMode.SAME_STEP) -> None:
        super().__init__()
        self.change, self.metadata = change, {"autoreset_mode": mode}

    def step(self, actions: Any):
        *rest, info = super().step(actions)
        if self.total == 3:
            self.change(info)
        return *rest, info


def spoil(info: dict[str, Any]) -> None:
    info["critic_obs"][1, 0] = np.nan


def narrow(info: dict[str, Any]) -> None:
    info["critic_obs"] = info["critic_obs"][:, :1]


def texts(info: dict[str, Any]) -> None:
    info["critic_obs"] = np.array([None, "far", 1, 2])


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            lambda info: info.pop("critic_obs"),
            TrainingError,
            r"info\['critic_obs'\] \(4, 2\) is missing in vector step 3: .* at every reset and step, .* has 'cost'",
        ),
        (
            lambda info: info.update(_critic_obs=np.array([True, False, True, False])),
            TrainingError,
            r"is missing in rows \[1, 3\] of vector step 3",
        ),
        (narrow, TrainingError, r"must have shape \(4, 2\), as single_critic_space says, got \(4, 1\)"),
        (texts, TrainingError, r"must have shape \(4, 2\), as single_critic_space says, got other things than numbers"),
        (spoil, NotFiniteError, r"critic_obs is not finite in rows \[1\] of vector step 3"),
    ],
)
def test_what_is_wrong_with_them_is_said(change: Any, error: type[Exception], message: str):
    stepper = EnvStepper(Altered(change), critics=True)
    stepper.reset(0)
    with pytest.raises(error, match=message):
        for _ in range(3):
            stepper.step(np.ones((4, 2), np.int64))
    silent = EnvStepper(Altered(change))
    silent.reset(0)
    for _ in range(3):
        silent.step(np.ones((4, 2), np.int64))  # who does not read them does not mind


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED], ids=lambda mode: mode.name)
def test_a_reset_without_them_is_an_error(mode: AutoresetMode):
    class Forgets(ToldCount):
        def reset(self, **given: Any):
            obs, info = super().reset(**given)
            return obs, info if self.episode == 0 else {}

    stepper = EnvStepper(counting(mode, Forgets), critics=True)
    stepper.reset(0)
    moment = "the reset in vector step 3" if mode is AutoresetMode.DISABLED else "rows \\[0\\] of vector step 3"
    with pytest.raises(TrainingError, match=f"is missing in {moment}"):
        for _ in range(3):
            stepper.step(STILL)
    with pytest.raises(TrainingError, match="is missing in the reset after vector step 2"):
        stepper.reset(0)


@pytest.mark.parametrize("hidden", ["final_info", "_critic_obs"])
def test_the_last_ones_are_needed_of_what_was_cut_off_and_are_zeros_of_what_ended_by_itself(hidden: str):
    class Hides(VectorWrapper):
        def step(self, actions: Any):
            *rest, info = self.env.step(actions)
            if "final_info" in info and hidden == "final_info":
                del info["final_info"]["critic_obs"]
            elif "final_info" in info:
                info["final_info"]["_critic_obs"][:] = False
            return *rest, info

    ended = collected(EnvStepper(Hides(counting(AutoresetMode.SAME_STEP, cut=False)), critics=True))
    assert ended.final_critic_obs is not None and not ended.final_critic_obs.any() and len(ended.final_critic_obs) > 3
    with pytest.raises(TrainingError, match=r"is missing in (rows \[0\] of )?final_info of vector step 3"):
        collected(EnvStepper(Hides(counting(AutoresetMode.SAME_STEP)), critics=True))


def test_whoever_tells_without_saying_how_many_is_refused():
    class Unannounced(ToldCount):
        critic_space = None

    stepper = EnvStepper(counting(AutoresetMode.SAME_STEP, Unannounced), critics=True)
    with pytest.raises(TrainingError, match=r"info has 'critic_obs', but .* it needs single_critic_space, a Box of C"):
        stepper.reset(0)


@pytest.mark.parametrize("space", [gym.spaces.Discrete(3), gym.spaces.Box(0, 1, (2, 2))])
def test_a_space_that_is_no_vector_is_refused(space: Any):
    env = ToldWalk()
    env.single_critic_space = space
    with pytest.raises(TrainingError, match="must be a vector of numbers, but single_critic_space is"):
        EnvStepper(env, critics=True)
