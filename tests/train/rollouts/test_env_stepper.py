"""Tests of the stepper, which gives the same transitions in every autoreset mode."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.train.toys import Count, Walk
from thalweg.algos import NotFiniteError
from thalweg.algos.interface import Rollout
from thalweg.train.errors import TrainingError
from thalweg.train.rollouts.env_stepper import MAX_STEPS_WITHOUT_COST, EnvStepper
from thalweg.train.rollouts.episodes import Episode, EpisodeStatistics, StepRecord
from thalweg.train.rollouts.rollout_buffer import RolloutBuffer

MODES = list(AutoresetMode)


def counting(mode: AutoresetMode, **settings) -> SyncVectorEnv:
    """Two counters, of three and of five steps."""
    makers = [lambda: Count(3, **settings), lambda: Count(5, **settings)]
    return SyncVectorEnv(makers, autoreset_mode=mode)


def trajectory(env: SyncVectorEnv, steps: int, frames: int = 1) -> list[tuple]:
    """(env, observation before, reward, cost, terminated, truncated, final observation) of each valid step."""
    stream, seen = EnvStepper(env, frames), []
    obs = stream.reset(0)
    for _ in range(steps):
        step = stream.step(np.zeros(2, np.int64))
        final = {int(env): tuple(obs) for env, obs in zip(step.finished, step.final_obs, strict=True)}
        for i in np.flatnonzero(step.valid):
            flags = (bool(step.terminated[i]), bool(step.truncated[i]))
            seen.append((int(i), tuple(obs[i]), step.reward[i], step.cost[i], *flags, final.get(int(i))))
        obs = step.next_obs
    return sorted(seen, key=lambda row: (row[0], row[1][-2:]))


@pytest.mark.parametrize("names_cost", ["always", "last"])
@pytest.mark.parametrize("cut", [True, False])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_every_autoreset_mode_gives_the_same_transitions(mode: AutoresetMode, cut: bool, names_cost: str):
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


def stacked(episode: int, at: int) -> tuple[float, ...]:
    """Three frames side by side; the first of the episode stands for those that are missing."""
    return tuple(number for step in (at - 2, at - 1, at) for number in (episode, max(step, 0)))


@pytest.mark.parametrize("cut", [True, False])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_frames_side_by_side_never_mix_episodes_whichever_way_of_resetting(mode: AutoresetMode, cut: bool):
    found = trajectory(counting(mode, cut=cut), steps=30, frames=3)
    for env, length in ((0, 3), (1, 5)):
        ours = [(obs, final) for row, obs, *_, final in found if row == env][: 3 * length]
        assert ours == [
            (stacked(episode, at), stacked(episode, length) if at == length - 1 else None)
            for episode in range(3)
            for at in range(length)
        ]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_an_observation_is_fresh_at_the_start_of_an_episode_only(mode: AutoresetMode):
    stream = EnvStepper(counting(mode), 2)
    stream.reset(0)
    begun = 0
    for _ in range(30):
        step = stream.step(np.zeros(2, np.int64))
        first = [obs[-1] == 0 for obs in step.next_obs]
        assert step.fresh.tolist() == first
        begun += sum(first)
    assert begun > 10


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_stream_resumes_from_its_state_with_earlier_frames(mode: AutoresetMode):
    stream, again = (EnvStepper(counting(mode), 3) for _ in range(2))
    for one in (stream, again):
        one.reset(0)
        for _ in range(7):
            one.step(np.zeros(2, np.int64))
    other = EnvStepper(again.env, 3)
    other.load_state(stream.state())
    for _ in range(6):
        here, there = (one.step(np.zeros(2, np.int64)) for one in (stream, other))
        assert np.array_equal(here.next_obs, there.next_obs) and np.array_equal(here.final_obs, there.final_obs)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_reset_steps_are_not_counted(mode: AutoresetMode):
    env = counting(mode)
    stream, book = EnvStepper(env), EpisodeStatistics(2, ["", ""])
    stream.reset(0)
    while book.steps < 60:
        book.add(stream.step(np.zeros(2, np.int64)))
    lengths = {(e.env, e.length, e.return_, e.cost) for e in book.recent}
    assert lengths == {(0, 3, 3.0, 1.0), (1, 5, 5.0, 1.0)}


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_rollout_keeps_the_final_observation_of_what_was_cut_off(mode: AutoresetMode):
    rollout, lengths = collected(counting(mode)), (3.0, 5.0)
    places = [divmod(int(i), 2) for i in rollout.final_index]
    assert places and sorted(map(tuple, rollout.truncated.nonzero().tolist())) == sorted(places)
    for (t, env), final in zip(places, rollout.final_obs.tolist(), strict=True):
        assert final == [rollout.obs[t, env, 0].item(), lengths[env]]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_rollout_keeps_the_final_observation_of_what_ended_by_itself_too(mode: AutoresetMode):
    rollout = collected(counting(mode, cut=False))
    places = [divmod(int(i), 2) for i in rollout.final_index]
    assert places and sorted(map(tuple, rollout.terminated.nonzero().tolist())) == sorted(places)
    assert [final[1] for final in rollout.final_obs.tolist()] == [(3.0, 5.0)[env] for _, env in places]


class Silent(gym.vector.VectorWrapper):
    """Tells no last observation of its first environment."""

    def step(self, actions: Any):
        *rest, info = self.env.step(actions)
        if "final_obs" in info:
            info["final_obs"][0] = None
        return *rest, info


@pytest.mark.parametrize("cut", [False, True])
def test_a_last_observation_may_lack_where_an_episode_ended_by_itself_and_not_where_it_was_cut_off(cut: bool):
    made = [lambda: Count(3, cut=cut), lambda: Count(3, cut=True)]
    env = Silent(gym.vector.SyncVectorEnv(made, autoreset_mode=AutoresetMode.SAME_STEP))
    stream = EnvStepper(env)
    stream.reset(0)
    stream.step(np.zeros(2, np.int64))
    stream.step(np.zeros(2, np.int64))
    if cut:
        with pytest.raises(TrainingError, match="an episode was truncated, but info\\['final_obs'\\] has no"):
            stream.step(np.zeros(2, np.int64))
    else:
        step = stream.step(np.zeros(2, np.int64))
        assert step.finished.tolist() == [0, 1] and step.final_obs.tolist() == [[0.0, 0.0], [0.0, 3.0]]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_a_rollout_says_which_observations_begin_an_episode_and_what_each_step_cost(mode: AutoresetMode):
    rollout = collected(counting(mode))
    assert torch.equal(rollout.fresh, rollout.obs[..., 1] == 0)
    assert rollout.costs.shape == (8, 2, 1)
    assert torch.equal(rollout.costs[..., 0] > 0, rollout.truncated)


def collected(env: SyncVectorEnv) -> Rollout:
    """Eight steps of both environments."""
    stream, actions = EnvStepper(env), torch.zeros(2, 1, dtype=torch.int64)
    obs, fresh = stream.reset(0), np.ones(2, dtype=bool)
    buffer = RolloutBuffer(8, obs, actions, np.zeros((2, 1)))
    while buffer.filled < buffer.steps:
        step = stream.step(actions.squeeze(1).numpy())
        buffer.add(obs, fresh, actions, step, step.cost[:, None])
        obs, fresh = step.next_obs, step.fresh
    return buffer.rollout()


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_no_cost_anywhere_is_an_error_when_the_first_episode_ends(mode: AutoresetMode):
    stream = EnvStepper(counting(mode, names_cost="never"))
    stream.reset(0)
    with pytest.raises(TrainingError, match="reports no cost: info\\['cost'\\]"):
        for _ in range(3):
            stream.step(np.zeros(2, np.int64))


def test_no_cost_in_an_endless_episode_is_an_error_some_day():
    env = SyncVectorEnv([lambda: Count(10**9, names_cost="never")], autoreset_mode=AutoresetMode.SAME_STEP)
    stream = EnvStepper(env)
    stream.reset(0)
    with pytest.raises(TrainingError, match="reports no cost"):
        for _ in range(MAX_STEPS_WITHOUT_COST + 1):
            stream.step(np.zeros(1, np.int64))


def test_an_environment_that_named_its_cost_once_may_be_silent_ever_after():
    lengths = iter([1, 10**9])

    class Rare(Count):
        def reset(self, **given):
            self.length = next(lengths)
            return super().reset(**given)

    env = SyncVectorEnv([lambda: Rare(names_cost="last")], autoreset_mode=AutoresetMode.SAME_STEP)
    stream = EnvStepper(env)
    stream.reset(0)
    costs = [float(stream.step(np.zeros(1, np.int64)).cost[0]) for _ in range(MAX_STEPS_WITHOUT_COST + 2)]
    assert costs == [1.0] + [0.0] * (MAX_STEPS_WITHOUT_COST + 1)


def test_what_a_reset_step_says_does_not_matter():
    class Odd(Walk):
        """Its costs are nonsense in the step that only resets."""

        def __init__(self):
            super().__init__()
            self.metadata, self.ended = {"autoreset_mode": AutoresetMode.NEXT_STEP}, np.zeros(4, dtype=bool)

        def step(self, actions):
            obs, reward, terminated, truncated, info = super().step(actions)
            for name in ("cost", "costs"):
                info[name][self.ended] = np.nan
            self.ended = (terminated | truncated) & ~self.ended
            return obs, reward, terminated, truncated, info

    stream = EnvStepper(Odd())
    stream.reset(0)
    steps = [stream.step(np.tile([2, 0], (4, 1))) for _ in range(60)]
    assert sum(int((~step.valid).sum()) for step in steps) > 10
    assert all(step.costs is not None and not step.costs[~step.valid].any() for step in steps)


def test_a_reason_has_the_environments_own_name_or_none():
    class Coded(Walk):
        def step(self, actions):
            *rest, info = super().step(actions)
            return *rest, info | {"done_reason": [3, None, "lost", 3]}

    stream, book = EnvStepper(Coded()), EpisodeStatistics(4, [""] * 4, {3: "Found"})
    stream.reset(0)
    episodes = [episode for _ in range(60) for episode in book.add(stream.step(np.tile([2, 0], (4, 1))))]
    assert {(e.env, e.reason) for e in episodes} == {(0, "Found"), (1, "None"), (2, "lost"), (3, "Found")}


def test_an_unknown_way_of_resetting_is_refused():
    env = Walk()
    env.metadata = {}
    with pytest.raises(TrainingError, match="NEXT_STEP, SAME_STEP, DISABLED, got None"):
        EnvStepper(env)


def test_images_are_sent_through_an_encoder():
    env = Walk()
    env.single_observation_space = gym.spaces.Box(0, 255, (8, 8, 3), np.uint8)
    with pytest.raises(TrainingError, match="LatentVectorEnv"):
        EnvStepper(env)


@pytest.mark.parametrize("what", ["observation", "reward", "cost", "costs"])
def test_nan_is_an_error_that_says_where(what: str):
    stream = EnvStepper(Walk(poison=(what, 3)))
    stream.reset(0)
    with pytest.raises(NotFiniteError, match=f"{what} is not finite in rows \\[0\\] of vector step 3"):
        for _ in range(3):
            stream.step(np.ones((4, 2), np.int64))


def test_a_cost_of_the_wrong_shape_is_refused():
    class Column(Walk):
        def step(self, actions):
            *rest, info = super().step(actions)
            return *rest, info | {"cost": np.zeros((4, 1))}

    stream = EnvStepper(Column())
    stream.reset(0)
    with pytest.raises(TrainingError, match=r"info\['cost'\] must have shape \(4,\), got \(4, 1\)"):
        stream.step(np.ones((4, 2), np.int64))


@pytest.mark.parametrize(("place", "name"), [(1, "rewards"), (2, "terminated"), (3, "truncated")])
def test_rewards_and_ends_of_the_wrong_shape_are_refused_by_name(place: int, name: str):
    class Column(Walk):
        def step(self, actions: Any):
            found = list(super().step(actions))
            found[place] = np.zeros((4, 1), bool)
            return tuple(found)

    stream = EnvStepper(Column())
    stream.reset(0)
    with pytest.raises(TrainingError, match=rf"{name} of a step must have shape \(4,\), got \(4, 1\)"):
        stream.step(np.ones((4, 2), np.int64))


def walked(steps: int) -> tuple[EpisodeStatistics, list[Episode]]:
    """The book of eight walkers who go right, and all episodes."""
    stream, book = EnvStepper(Walk(8)), EpisodeStatistics(8, [""] * 8)
    stream.reset(0)
    return book, [episode for _ in range(steps) for episode in book.add(stream.step(np.tile([2, 0], (8, 1))))]


def test_rates_count_violated_episodes_per_step():
    assert math.isnan(EpisodeStatistics(8, [""] * 8).metrics()["cost_rate_tight"])
    book, episodes = walked(300)
    metrics = book.metrics()
    assert metrics["cost_rate"] == sum(e.cost > 0 for e in episodes) / 2400 > 0
    assert metrics["cost_rate_tight"] == sum(e.tight > 0 for e in episodes) / 2400
    assert metrics["return_mean_50"] == pytest.approx(np.mean([e.return_ for e in episodes[-50:]]))
    assert metrics["cost_mean_50"] == pytest.approx(np.mean([e.cost for e in episodes[-50:]]))


def test_costs_are_those_of_the_fresh_and_of_the_last_hundred_episodes():
    book, episodes = walked(300)
    book.since_update = episodes[-3:]
    new, recent, largest = book.costs(separate=False)
    assert len(episodes) > 100
    assert new.tolist() == [[e.cost] for e in episodes[-3:]] and recent.tolist() == [[e.cost] for e in episodes[-100:]]
    assert largest == (1.0,)


def test_costs_apart_are_tight_and_loose():
    book, episodes = walked(300)
    _, recent, largest = book.costs(separate=True)
    assert recent.tolist() == [[e.tight, e.loose] for e in episodes[-100:]]
    assert largest == (max(e.tight for e in episodes), max(e.loose for e in episodes))


def test_the_lowest_cost_is_that_of_fifty_episodes_in_a_row():
    book = EpisodeStatistics(1, [""])
    for cost in [1.0] * 50 + [0.0] * 30 + [1.0] * 100:  # fifty in a row with thirty of 0 among them
        ended = np.array([0])
        one, never = np.array([True]), np.array([False])
        costs = np.array([[cost, 0.5]])
        book.add(StepRecord(np.zeros(1), np.array([cost]), costs, one, never, one, ended, None))
    assert book.lowest_costs(separate=False) == (20 / 50,) and book.lowest_costs(separate=True) == (20 / 50, 0.5)
    again = EpisodeStatistics(1, [""])
    again.load_state(book.state())
    assert again.lowest_costs(separate=True) == (20 / 50, 0.5)
    assert all(math.isnan(cost) for cost in EpisodeStatistics(1, [""]).lowest_costs(separate=True))


def test_before_any_episode_there_are_no_costs():
    new, recent, largest = EpisodeStatistics(8, [""] * 8).costs(separate=True)
    assert new.shape == recent.shape == (0, 2) and largest == (0.0, 0.0)


def test_an_episode_that_ends_both_ways_is_terminated():
    class Both(Count):
        def step(self, action: Any) -> Any:
            obs, reward, terminated, truncated, info = super().step(action)
            return obs, reward, terminated or truncated, terminated or truncated, info

    stepper = EnvStepper(gym.vector.SyncVectorEnv([lambda: Both(1)], autoreset_mode=AutoresetMode.SAME_STEP))
    stepper.reset(0)
    step = stepper.step(np.zeros(1, np.int64))
    assert (step.terminated.tolist(), step.truncated.tolist(), step.finished.tolist()) == ([True], [False], [0])


class OtherLastObservation(Walk):
    """Changes the last observations of episodes."""

    def __init__(self, last: Any) -> None:
        super().__init__()
        self.last = last

    def step(self, actions: Any) -> Any:
        *rest, info = super().step(actions)
        for env in np.flatnonzero(np.logical_or(*rest[2:])):
            info["final_obs"][env] = self.last
        return *rest, info


@pytest.mark.parametrize(
    ("last", "error", "words"),
    [
        (np.array([0.0, np.nan, 0.0]), NotFiniteError, "final_obs is not finite in rows"),
        (np.zeros(2), TrainingError, r"final_obs must be vectors of 3 numbers, got shape \(2,\)"),
    ],
)
def test_last_observations_that_cannot_be_learnt_from_are_refused(last: Any, error: type[Exception], words: str):
    stepper = EnvStepper(OtherLastObservation(last))
    stepper.reset(0)
    with pytest.raises(error, match=words):
        for _ in range(20):
            stepper.step(np.tile([2, 0], (4, 1)))
