import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.train.toys import Count, Walk
from thalweg.algos import NotFiniteError
from thalweg.train.episodes import EpisodeBook
from thalweg.train.errors import TrainingError
from thalweg.train.rollout import RolloutBuffer
from thalweg.train.stream import PATIENCE, Stream

MODES = list(AutoresetMode)


def counting(mode: AutoresetMode, **settings) -> SyncVectorEnv:
    """Two counters, of three and of five steps."""
    makers = [lambda: Count(3, **settings), lambda: Count(5, **settings)]
    return SyncVectorEnv(makers, autoreset_mode=mode)


def trajectory(env: SyncVectorEnv, steps: int) -> list[tuple]:
    """(env, observation before, reward, cost, terminated, truncated, final observation) of each valid step."""
    stream, seen = Stream(env), []
    obs = stream.reset(0)
    for _ in range(steps):
        step = stream.step(np.zeros(2, np.int64))
        final = {int(env): tuple(obs) for env, obs in zip(step.finished, step.final_obs, strict=True)}
        for i in np.flatnonzero(step.valid):
            flags = (bool(step.terminated[i]), bool(step.truncated[i]))
            seen.append((int(i), tuple(obs[i]), step.reward[i], step.cost[i], *flags, final.get(int(i))))
        obs = step.next_obs
    return sorted(seen, key=lambda row: (row[0], row[1]))


@pytest.mark.parametrize("names_cost", ["always", "last"])
@pytest.mark.parametrize("cut", [True, False])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_every_way_of_resetting_tells_the_same_story(mode: AutoresetMode, cut: bool, names_cost: str):
    expected = [
        (env, (episode, at), 1.0, float(at == length - 1), *ends, (episode, length) if at == length - 1 else None)
        for env, length in ((0, 3), (1, 5))
        for episode in range(3)
        for at in range(length)
        for ends in [(at == length - 1 and not cut, at == length - 1 and cut)]
    ]
    found = trajectory(counting(mode, cut=cut, names_cost=names_cost), steps=30)
    for env, length in ((0, 3), (1, 5)):
        ours = [row for row in found if row[0] == env][: 3 * length]
        assert ours == [row for row in expected if row[0] == env]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_reset_steps_are_not_counted(mode: AutoresetMode):
    env = counting(mode)
    stream, book = Stream(env), EpisodeBook(2, ["", ""])
    stream.reset(0)
    while book.steps < 60:
        book.add(stream.step(np.zeros(2, np.int64)))
    lengths = {(e.env, e.length, e.return_, e.cost) for e in book.recent}
    assert lengths == {(0, 3, 3.0, 1.0), (1, 5, 5.0, 1.0)}


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_rollout_keeps_the_final_observation_of_what_was_cut_off(mode: AutoresetMode):
    import torch

    stream = Stream(counting(mode))
    obs, actions = stream.reset(0), torch.zeros(2, 1, dtype=torch.int64)
    buffer = RolloutBuffer(8, 2, 2, actions)
    while not buffer.full:
        step = stream.step(actions.squeeze(1).numpy())
        buffer.add(obs, actions, step)
        obs = step.next_obs
    rollout = buffer.rollout()
    places = [divmod(int(i), 2) for i in rollout.final_index]
    assert places and [tuple(rollout.truncated.nonzero()[k].tolist()) for k in range(len(places))] == places
    for (t, env), final in zip(places, rollout.final_obs.tolist(), strict=True):
        assert final == [rollout.obs[t, env, 0].item(), (3.0, 5.0)[env]]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_no_cost_anywhere_is_an_error_when_the_first_episode_ends(mode: AutoresetMode):
    stream = Stream(counting(mode, names_cost="never"))
    stream.reset(0)
    with pytest.raises(TrainingError, match="names no cost: info\\['cost'\\]"):
        for _ in range(3):
            stream.step(np.zeros(2, np.int64))


def test_no_cost_in_an_endless_episode_is_an_error_some_day():
    env = SyncVectorEnv([lambda: Count(10**9, names_cost="never")], autoreset_mode=AutoresetMode.SAME_STEP)
    stream = Stream(env)
    stream.reset(0)
    with pytest.raises(TrainingError, match="names no cost"):
        for _ in range(PATIENCE + 1):
            stream.step(np.zeros(1, np.int64))


def test_an_unknown_way_of_resetting_is_refused():
    env = Walk()
    env.metadata = {}
    with pytest.raises(TrainingError, match="NEXT_STEP, SAME_STEP, DISABLED, got None"):
        Stream(env)


def test_images_are_sent_through_an_encoder():
    env = Walk()
    env.single_observation_space = gym.spaces.Box(0, 255, (8, 8, 3), np.uint8)
    with pytest.raises(TrainingError, match="LatentVectorEnv"):
        Stream(env)


@pytest.mark.parametrize("what", ["observation", "reward", "cost"])
def test_nan_is_an_error_that_says_where(what: str):
    stream = Stream(Walk(poison=(what, 3)))
    stream.reset(0)
    with pytest.raises(NotFiniteError, match=f"{what} is not finite in rows \\[0\\] of vector step 3"):
        for _ in range(3):
            stream.step(np.ones((4, 2), np.int64))


def test_a_cost_of_the_wrong_shape_is_refused():
    class Column(Walk):
        def step(self, actions):
            *rest, info = super().step(actions)
            return *rest, info | {"cost": np.zeros((4, 1))}

    stream = Stream(Column())
    stream.reset(0)
    with pytest.raises(TrainingError, match=r"info\['cost'\] must have shape \(4,\), got \(4, 1\)"):
        stream.step(np.ones((4, 2), np.int64))


def test_rates_count_violated_episodes_per_step():
    stream, book = Stream(Walk(8)), EpisodeBook(8, [""] * 8)
    assert math.isnan(book.cost_mean()) and math.isnan(book.metrics()["cost_rate_tight"])
    stream.reset(0)
    episodes = []
    for _ in range(300):
        episodes += book.add(stream.step(np.tile([2, 0], (8, 1))))
    metrics = book.metrics()
    assert metrics["cost_rate"] == sum(e.cost > 0 for e in episodes) / 2400 > 0
    assert metrics["cost_rate_tight"] == sum(e.tight > 0 for e in episodes) / 2400
    assert metrics["return_mean_50"] == pytest.approx(np.mean([e.return_ for e in episodes[-50:]]))
    book.fresh.clear()
    assert book.cost_mean() == pytest.approx(np.mean([e.cost for e in episodes[-50:]]))
