"""Tests that collecting tensors equals collecting arrays, for the learner and for the records of episodes."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.devices.toy import SPACES, ArrayWalk, TensorWalk
from thalweg.algos import ALGORITHMS, NotFiniteError
from thalweg.algos.common.state import CPU
from thalweg.algos.interface import Rollout, Task
from thalweg.core.compute.device import DeviceError
from thalweg.train import ResumeWarning, TrainingError, run
from thalweg.train.rollouts.collector import Collector
from thalweg.train.rollouts.tensor_collector import TensorCollector, make_collector
from thalweg.train.trainer import Trainer

N = 6


class Script:
    """A learner that acts by a list, and writes down what it is given."""

    resets = False

    def __init__(self, collector: Collector, space: gym.Space, *, steps: int, separate: bool = False) -> None:
        task = Task(collector.obs_size, space, N, 0, {})
        self.policy = ALGORITHMS["PPO"].make(ALGORITHMS["PPO"].config(), task).policy
        self.rollout_steps, self.separate_costs = steps, separate
        self.generator = np.random.default_rng(3)
        self.saw: list[tuple[torch.Tensor, torch.Tensor]] = []
        self.given: list[Rollout] = []

    def act(self, obs: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        self.saw.append((obs.clone(), fresh.clone()))
        return torch.from_numpy(self.generator.integers(0, 3, (N, self.policy.actions.count)))

    def update(self, rollout: Rollout, feedback: Any) -> dict[str, float]:
        self.given.append(
            Rollout(**{name: value.clone() for name, value in vars(rollout).items() if value is not None})
        )
        return {"told": float(len(feedback.new_costs))}

    def warnings(self, feedback: Any) -> dict[str, str]:
        return {}

    def state(self) -> dict[str, Any]:
        return {}

    def load_state(self, state: dict[str, Any]) -> None:
        pass


def taken(env: Any, frames: int, separate: bool, critics: bool = False) -> tuple[Script, Trainer]:
    """What a learner saw of five rollouts of 7 steps."""
    collector = make_collector(env, frames, CPU, 1, critics)
    learner = Script(collector, env.single_action_space, steps=7, separate=separate)
    trainer = Trainer(collector, learner, 10_000, seed=0, threads=1)  # pyright: ignore[reportArgumentType]
    trainer.start()
    while trainer.updates < 5:
        trainer.step()
        if trainer.ready:
            trainer.update()
    return learner, trainer


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("separate", [False, True], ids=["sum", "apart"])
def test_tensors_and_arrays_train_the_same_policy(frames: int, separate: bool):
    space = SPACES["MultiDiscrete"]
    of_arrays, first = taken(ArrayWalk(N, space), frames, separate)
    of_tensors, second = taken(TensorWalk(N, space, CPU), frames, separate)
    assert len(of_arrays.given) == len(of_tensors.given) == 5
    for (obs, fresh), (other, also) in zip(of_arrays.saw, of_tensors.saw, strict=True):
        assert torch.equal(obs, other) and torch.equal(fresh, also)
    for one, other in zip(of_arrays.given, of_tensors.given, strict=True):
        for name in ("obs", "fresh", "actions", "rewards", "costs", "terminated", "truncated", "valid"):
            assert torch.equal(getattr(one, name), getattr(other, name)), name
        # The last observation of an episode stands apart in one, and follows its last step in the other.
        after = other.obs[1:].flatten(0, 1)
        assert len(one.final_index) and torch.equal(after[one.final_index], one.final_obs)
        assert not len(other.final_index)
    assert list(first.statistics.recent) == list(second.statistics.recent) and first.statistics.count > 20
    assert {episode.reason for episode in first.statistics.recent} == {"Arrived", "Late"}
    assert (
        first.statistics.steps == second.statistics.steps and first.statistics.metrics() == second.statistics.metrics()
    )


TOLD = gym.spaces.Box(-np.inf, np.inf, (2,), np.float32)


class ToldTensors(TensorWalk):
    """A walk that tells critics twice the place, and the steps that are left; once with `change` in place of it."""

    def __init__(self, change: Any = None) -> None:
        super().__init__(N, SPACES["MultiDiscrete"], CPU)
        self.single_critic_space, self.change, self.taken = TOLD, change, 0

    def reset(self, *, seed: int) -> Any:
        obs, info = super().reset(seed=seed)
        return obs, info | {"critic_obs": self.told()}

    def step(self, actions: torch.Tensor) -> Any:
        *rest, info = super().step(actions)
        self.taken += 1
        info["critic_obs"] = self.told()
        if self.change and self.taken == 4:
            self.change(info)
        return *rest, info

    def told(self) -> torch.Tensor:
        return torch.stack([2 * self.place, self.most - self.steps], 1)


class ToldArrays(ArrayWalk):
    def __init__(self) -> None:
        super().__init__(N, SPACES["MultiDiscrete"])
        self.walk, self.single_critic_space = ToldTensors(), TOLD

    def reset(self, **given: Any) -> Any:
        obs, info = self.walk.reset(seed=0)
        return obs.numpy(), {name: value.numpy() for name, value in info.items()}


@pytest.mark.parametrize("frames", [1, 3])
def test_tensors_and_arrays_tell_critics_the_same(frames: int):
    of_arrays, first = taken(ToldArrays(), frames, False, critics=True)
    of_tensors, second = taken(ToldTensors(), frames, False, critics=True)
    assert first.collector.critic_size == second.collector.critic_size == 2
    for one, other in zip(of_arrays.given, of_tensors.given, strict=True):
        assert one.critic_obs is not None and one.final_critic_obs is not None
        assert other.critic_obs is not None and other.final_critic_obs is not None
        place, steps, most = one.obs[..., -3:].unbind(-1)
        assert torch.equal(one.critic_obs, torch.stack([2 * place, most - steps], -1))
        assert torch.equal(one.critic_obs, other.critic_obs)
        after = other.critic_obs[1:].flatten(0, 1)
        assert len(one.final_index) and torch.equal(after[one.final_index], one.final_critic_obs)
        assert other.final_critic_obs.shape == (0, 2)


def test_collectors_read_nothing_for_critics_unless_they_are_asked():
    for env in (ToldArrays(), ToldTensors()):
        learner, trainer = taken(env, 1, False)
        assert trainer.collector.critic_size == 0
        assert all(given.critic_obs is None and given.final_critic_obs is None for given in learner.given)


def test_a_collector_of_tensors_resumes_with_what_critics_see_now():
    one, other = (make_collector(ToldTensors(), 1, CPU, 1, critics=True) for _ in range(2))
    for collector in (one, other):
        learner = Script(collector, SPACES["MultiDiscrete"], steps=8)
        collector.reset(0)
        for _ in range(8 if collector is one else 0):
            collector.step(learner)  # pyright: ignore[reportArgumentType]
    one.clear()
    state = one.state()
    other.load_state(state, 0)
    np.testing.assert_array_equal(other.state()["critic_obs"], state["critic_obs"])
    assert state["critic_obs"].any() and "critic_obs" not in make_collector(ToldTensors(), 1, CPU, 1).state()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (
            lambda info: info.pop("critic_obs"),
            TrainingError,
            r"info\['critic_obs'\] \(6, 2\) is missing: an environment",
        ),
        (
            lambda info: info.update(critic_obs=torch.zeros(N, 3)),
            TrainingError,
            r"must have shape \(6, 2\), as single_critic_space says, got \(6, 3\)",
        ),
        (
            lambda info: info["critic_obs"][2].fill_(torch.inf),
            NotFiniteError,
            r"critic_obs is not finite in rows \[2\] of step 5 of the rollout",
        ),
    ],
)
def test_tensors_that_tell_critics_something_wrong_are_refused(change: Any, error: type[Exception], message: str):
    with pytest.raises(error, match=message):
        taken(ToldTensors(change), 1, False, critics=True)


def test_tensors_that_tell_critics_without_saying_how_many_are_refused():
    env = ToldTensors()
    del env.single_critic_space
    with pytest.raises(TrainingError, match="it needs single_critic_space, a Box of C numbers"):
        taken(env, 1, False, critics=True)


def test_episodes_are_reported_when_a_rollout_is_complete():
    collector = make_collector(TensorWalk(N, SPACES["MultiDiscrete"], CPU), 1, CPU, 1)
    learner = Script(collector, SPACES["MultiDiscrete"], steps=8)
    collector.reset(0)
    found = [len(collector.step(learner)) for _ in range(8)]  # pyright: ignore[reportArgumentType]
    assert found[:7] == [0] * 7 and found[7] > 3 and collector.waiting == 8


@pytest.mark.parametrize("name", ["FOCOPS", "TD3Lag", "CCEPETS"])
@pytest.mark.slow
def test_an_interrupted_run_of_tensors_resumes_with_the_same_numbers(name: str, tmp_path, monkeypatch):
    def begin(folder: str) -> Any:
        env = TensorWalk(N, SPACES["MultiDiscrete"], CPU)
        config = {
            "FOCOPS": {"steps_per_update": 60, "cost_limit": 0.5, "frame_stack": 2},
            "TD3Lag": {"random_steps": 30, "steps_per_update": 60, "cost_limit": 0.5},
            "CCEPETS": {"random_steps": 60, "steps_per_update": 60, "steps_per_collection": 60, "cost_limit": 0.5},
        }[name]
        return run(name, env, steps=360, seed=1, folder=tmp_path / folder, config=config, checkpoint_seconds=0)

    whole = begin("whole")
    from thalweg.train import trainer as module

    count, update = 0, Trainer.update

    def cut(self):
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        return update(self)

    monkeypatch.setattr(module.Trainer, "update", cut)
    with pytest.raises(KeyboardInterrupt):
        begin("cut")
    monkeypatch.setattr(module.Trainer, "update", update)
    rest = begin("cut")
    assert rest.resumed_from and rest.steps == whole.steps and whole.episodes > 20
    for file in ("episodes.csv", "policy.safetensors"):
        assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "cut" / file).read_bytes()


def test_an_environment_of_tensors_must_be_on_the_device_of_the_learner():
    with pytest.raises(DeviceError, match="device = 'meta', but the environment's tensors are on cpu"):
        make_collector(TensorWalk(N, SPACES["Discrete"], CPU), 1, torch.device("meta"), 1)


def test_an_environment_of_tensors_must_declare_its_autoreset_mode():
    env = TensorWalk(N, SPACES["Discrete"], CPU)
    env.metadata = {}
    with pytest.raises(TrainingError, match=r"AutoresetMode.NEXT_STEP"):
        TensorCollector(env, 1, 1)


class BareWalk:
    """A walk with what `TensorEnv` asks for and nothing else; its numbers are of double precision."""

    metadata = TensorWalk.metadata

    def __init__(self, cost: bool = True, poison: int = -1) -> None:
        self.walk, self.cost, self.poison, self.taken = TensorWalk(N, SPACES["Discrete"], CPU), cost, poison, 0
        self.num_envs, self.device, self.single_action_space = N, CPU, SPACES["Discrete"]
        self.single_observation_space = self.walk.single_observation_space

    def reset(self, *, seed: int) -> Any:
        obs, info = self.walk.reset(seed=seed)
        return obs.double(), info

    def step(self, actions: torch.Tensor) -> Any:
        obs, reward, terminated, truncated, info = self.walk.step(actions)
        if self.taken == self.poison:
            reward[2] = torch.nan
        self.taken += 1
        return obs.double(), reward, terminated, truncated, {"cost": info["cost"]} if self.cost else {}


PPO = {"steps_per_update": 60, "minibatch": 30, "passes": 1}


def test_a_minimal_environment_is_trained_on_and_resumes_with_new_episodes(tmp_path, monkeypatch):
    update = Trainer.update

    def cut(trainer: Trainer) -> Any:
        if trainer.updates == 2:
            raise KeyboardInterrupt
        return update(trainer)

    def begin() -> Any:
        return run("PPO", BareWalk(), steps=240, seed=1, folder=tmp_path, config=PPO, checkpoint_seconds=0)

    monkeypatch.setattr(Trainer, "update", cut)
    with pytest.raises(KeyboardInterrupt):
        begin()
    monkeypatch.setattr(Trainer, "update", update)
    with pytest.warns(ResumeWarning, match="no get_state and set_state: the run resumes with new episodes"):
        ended = begin()
    assert ended.resumed_from and ended.steps >= 240


def test_an_environment_of_tensors_without_a_cost_is_refused(tmp_path):
    with pytest.raises(
        TrainingError, match=r"reports no cost: info\['cost'\] \[N\] is needed at every step, info has noth"
    ):
        run("PPO", BareWalk(cost=False), steps=240, seed=1, folder=tmp_path, config=PPO)


def test_the_error_for_a_nan_reward_names_its_row_and_step(tmp_path):
    with pytest.raises(NotFiniteError, match=r"reward is not finite in rows \[2\] of step 4 of the rollout"):
        run("PPO", BareWalk(poison=3), steps=240, seed=1, folder=tmp_path, config=PPO)


def test_a_nan_observation_stops_a_run_on_tensors_before_anything_is_learnt_from_it(tmp_path):
    env = BareWalk()
    step = env.step

    def poisoned(actions: torch.Tensor) -> Any:
        obs, *rest = step(actions)
        if env.taken == 5:
            obs[1, 0] = torch.inf
        return obs, *rest

    env.step = poisoned
    with pytest.raises(NotFiniteError, match=r"observation is not finite in rows \[1\] of step 6 of the rollout"):
        run("PPO", env, steps=240, seed=1, folder=tmp_path, config=PPO)


def test_rewards_of_reset_steps_are_ignored():
    collector = make_collector(BareWalk(), 1, CPU, 1)
    learner = Script(collector, SPACES["Discrete"], steps=20)
    collector.reset(0)
    walk = collector.env.walk  # pyright: ignore[reportAttributeAccessIssue]
    step = collector.env.step

    def paid_for_nothing(actions: torch.Tensor) -> Any:
        resetting = walk.ended.clone()
        obs, reward, terminated, truncated, info = step(actions)
        return obs, torch.where(resetting, torch.nan, reward), terminated, truncated, info

    collector.env.step = paid_for_nothing  # pyright: ignore[reportAttributeAccessIssue]
    for _ in range(20):
        collector.step(learner)  # pyright: ignore[reportArgumentType]
    rewards = collector.rollout().rewards
    assert rewards.isfinite().all() and not collector.rollout().valid.all()


def test_costs_of_reset_steps_are_ignored():
    class Odd(TensorWalk):
        """Its costs are nonsense in the step that only resets."""

        def step(self, actions: torch.Tensor) -> Any:
            again = self.ended
            *rest, info = super().step(actions)
            info["costs"] = torch.where(again[:, None], torch.nan, info["costs"])
            return *rest, info

    (_, plain), (_, odd) = (taken(kind(N, SPACES["MultiDiscrete"], CPU), 1, False) for kind in (TensorWalk, Odd))
    assert list(odd.statistics.recent) == list(plain.statistics.recent)
    taken(Odd(N, SPACES["MultiDiscrete"], CPU), 1, True)
