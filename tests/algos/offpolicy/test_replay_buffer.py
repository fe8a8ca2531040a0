"""Tests of the replay buffer: which steps it stores, and which it samples."""

import math

import numpy as np
import pytest
import torch

from tests.algos.rollouts import rollout_of
from thalweg.algos import AlgorithmError, NotFiniteError
from thalweg.algos.offpolicy.replay_buffer import Batch, ReplayBuffer, Transitions, valid_transitions
from thalweg.algos.policy.normaliser import Normaliser

PLAIN = Normaliser(1, enabled=False)
NONE = torch.zeros(9, 0)


def filled(size: int, numbers: range, critic_size: int = 0) -> ReplayBuffer:
    """A replay buffer with steps of one number each, added three at a time; what only critics see is 0.1 more."""
    replay = ReplayBuffer(size, 1, 1, 1, critic_obs=critic_size)
    for first in range(numbers.start, numbers.stop, 3):
        some = torch.arange(first, min(first + 3, numbers.stop), dtype=torch.float32)
        column = some.unsqueeze(1)
        signals = torch.stack([some, -some], 1)
        critic_obs = column.expand(-1, critic_size)
        continues = torch.ones(len(some), 2 if critic_size else 1)
        steps = Transitions(column, critic_obs + 0.1, column, column + 0.5, critic_obs + 0.6, signals, continues)
        replay.add(steps)
    return replay


def draw(
    replay: ReplayBuffer, count: int = 1, size: int = 400, normaliser: Normaliser = PLAIN, critics: Normaliser = PLAIN
) -> list[Batch]:
    drawn = replay.batches(count, size, torch.Generator().manual_seed(0), normaliser, critics)
    return [replay.batch(rows) for rows in drawn]


def stored(replay: ReplayBuffer) -> set[float]:
    return set(draw(replay)[0].obs.flatten().tolist())


@pytest.mark.parametrize("put", [0, 1, 2, 5, 6, 7, 8, 13, 20])
def test_the_buffer_holds_the_last_steps_only(put: int):
    replay = filled(7, range(put))
    assert replay.filled == min(put, 7)
    if put:
        assert stored(replay) == set(map(float, range(max(0, put - 7), put)))


def test_adding_more_steps_than_the_size_keeps_the_last():
    replay = ReplayBuffer(3, 1, 1, 1)
    some = torch.arange(8.0)
    column = some[:, None]
    replay.add(Transitions(column, NONE[:8], column, column, NONE[:8], torch.stack([some, some], 1), torch.ones(8, 1)))
    assert stored(replay) == {5.0, 6.0, 7.0}


def test_the_fields_of_a_step_stay_together():
    batch = draw(filled(7, range(20)))[0]
    assert torch.equal(batch.seen_actions, torch.cat([batch.obs, batch.actions], 1))
    assert torch.equal(batch.actions, batch.obs) and torch.equal(batch.next_obs, batch.obs + 0.5)
    assert torch.equal(batch.signals, torch.stack([batch.obs[:, 0], -batch.obs[:, 0]]))


def test_a_terminated_step_does_not_continue_and_a_truncated_one_does_from_its_last_observation():
    obs = torch.arange(4.0).view(4, 1, 1).expand(4, 2, 1)
    ends, cut = torch.zeros(3, 2, dtype=torch.bool), torch.zeros(3, 2, dtype=torch.bool)
    ends[1, 0], cut[1, 1] = True, True
    costs = ends.float().unsqueeze(-1)
    rollout = rollout_of(
        obs,
        terminated=ends,
        truncated=cut,
        costs=costs,
        final_index=torch.tensor([2, 3]),
        final_obs=torch.tensor([[70.0], [80.0]]),
    )
    obs, _, _, next_obs, _, signals, continues = valid_transitions(rollout)
    assert obs.flatten().tolist() == [0, 0, 1, 1, 2, 2]
    assert next_obs.flatten().tolist() == [1, 1, 70, 80, 3, 3]
    assert signals.tolist() == [[1, 0], [1, 0], [1, 1], [1, 0], [1, 0], [1, 0]]
    assert continues.tolist() == [[1], [1], [0], [1], [1], [1]]


def test_for_critics_that_are_told_the_cost_ends_where_an_episode_is_cut_off_and_the_reward_goes_on():
    obs, ends, cut = torch.zeros(4, 2, 1), torch.zeros(3, 2, dtype=torch.bool), torch.zeros(3, 2, dtype=torch.bool)
    ends[1, 0], cut[1, 1] = True, True
    told = {"critic_obs": torch.zeros(4, 2, 3), "final_critic_obs": torch.zeros(2, 3)}
    final = {"final_index": torch.tensor([2, 3]), "final_obs": torch.zeros(2, 1)}
    rollout = rollout_of(obs, terminated=ends, truncated=cut, costs=torch.zeros(3, 2, 2), **told, **final)
    steps = valid_transitions(rollout, 3)
    assert steps.continues.tolist() == [[1, 1, 1], [1, 1, 1], [0, 0, 0], [1, 0, 0], [1, 1, 1], [1, 1, 1]]
    assert valid_transitions(rollout).continues.tolist() == [[1], [1], [0], [1], [1], [1]]
    replay = ReplayBuffer(6, 1, 1, 2, critic_obs=3)
    replay.add(steps)
    assert replay.batch(replay.rows).continues.tolist() == steps.continues.T.tolist()


def test_steps_that_only_reset_are_not_stored():
    obs = torch.arange(4.0).view(4, 1, 1)
    valid = torch.tensor([[True], [False], [True]])
    obs, none, actions, next_obs, _, signals, continues = valid_transitions(rollout_of(obs, valid=valid))
    assert obs.flatten().tolist() == [0, 2] and next_obs.flatten().tolist() == [1, 3]
    assert len(actions) == len(signals) == len(continues) == 2 and none.shape == (2, 0)


def test_valid_transitions_does_not_change_the_rollout():
    obs = torch.zeros(3, 1, 1)
    valid_transitions(rollout_of(obs, final_index=torch.tensor([0]), final_obs=torch.tensor([[9.0]])))
    assert torch.equal(obs, torch.zeros(3, 1, 1))


def test_stored_observations_are_normalised_by_the_current_statistics():
    replay, normaliser = filled(7, range(7)), Normaliser(1)
    normaliser.update(torch.tensor([[10.0], [14.0]]))  # mean 12, deviation 2
    batch = draw(replay, normaliser=normaliser)[0]
    assert set(batch.obs.flatten().tolist()) <= {-5.0, -4.5, -4.0, -3.5, -3.0}
    assert torch.equal(batch.seen_actions[:, :1], batch.obs)
    assert set(batch.actions.flatten().tolist()) == set(map(float, range(7)))
    assert stored(replay) == set(map(float, range(7)))  # the rows themselves stay raw


def test_what_only_critics_see_is_beside_the_observation_and_normalised_by_its_own_statistics():
    replay, critics = filled(7, range(7), critic_size=2), Normaliser(2)
    critics.update(torch.tensor([[10.0, 0.0], [14.0, 4.0]]))  # means 12 and 2, deviations 2
    plain, batch = (draw(replay, critics=normaliser)[0] for normaliser in (PLAIN, critics))
    number = plain.obs[:, 0]
    beside, after = ((number + shift).unsqueeze(1).expand(-1, 2) for shift in (0.1, 0.6))
    assert torch.equal(plain.seen, torch.cat([plain.obs, beside], 1))
    assert torch.equal(plain.next_seen, torch.cat([plain.next_obs, after], 1))
    assert torch.equal(batch.obs, plain.obs) and torch.equal(batch.next_obs, plain.next_obs)
    assert torch.equal(batch.seen_actions, torch.cat([batch.seen, batch.actions], 1))
    assert torch.equal(batch.actions[:, 0], number) and torch.equal(batch.signals, plain.signals)
    for found, told in ((batch.seen, beside), (batch.next_seen, after)):
        expected = ((told - torch.tensor([12.0, 2.0])) / 2.0).clamp(-5.0, 5.0)
        assert torch.allclose(found[:, 1:], expected, atol=1e-6)


def test_what_only_critics_see_after_an_episodes_end_is_of_its_last_state():
    obs, told = torch.arange(4.0).view(4, 1, 1), torch.arange(10.0, 14.0).view(4, 1, 1).repeat(1, 1, 2)
    cut = torch.tensor([[False], [True], [False]])
    rollout = rollout_of(
        obs,
        truncated=cut,
        valid=torch.tensor([[True], [True], [False]]),
        final_index=torch.tensor([1]),
        final_obs=torch.tensor([[70.0]]),
        critic_obs=told,
        final_critic_obs=torch.tensor([[80.0, 81.0]]),
    )
    found = valid_transitions(rollout, 2)
    assert found.critic_obs.tolist() == [[10, 10], [11, 11]] and found.next_critic_obs.tolist() == [[11, 11], [80, 81]]
    assert found.next_obs.flatten().tolist() == [1, 70]
    without = valid_transitions(rollout)
    assert without.critic_obs.shape == without.next_critic_obs.shape == (2, 0)
    assert torch.equal(told, torch.arange(10.0, 14.0).view(4, 1, 1).repeat(1, 1, 2))


@pytest.mark.parametrize(("told", "words"), [(None, "none"), (torch.zeros(4, 1, 3), "3")])
def test_a_rollout_without_what_critics_should_see_is_refused(told: torch.Tensor | None, words: str):
    rollout = rollout_of(torch.zeros(4, 1, 1), critic_obs=told, final_critic_obs=torch.zeros(0, 3))
    with pytest.raises(AlgorithmError, match=f"critics see 2 numbers beside the observation; the rollout has {words}"):
        valid_transitions(rollout, 2)


def test_many_batches_are_gathered_in_parts_and_differ():
    batches = draw(filled(100, range(100)), count=130, size=4)
    assert len(batches) == 130 and len({tuple(batch.obs.flatten().tolist()) for batch in batches}) > 120


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", range(7))
def test_a_number_that_is_not_finite_is_refused(bad: float, where: int):
    parts = [*(torch.zeros(2, 1) for _ in range(5)), torch.zeros(2, 2), torch.zeros(2, 2)]
    parts[where].view(-1)[1] = bad
    with pytest.raises(NotFiniteError, match="has become"):
        ReplayBuffer(7, 1, 1, 1, critic_obs=1).add(Transitions(*parts))


def test_a_restored_state_holds_the_filled_rows_and_continues_the_same():
    replay, other = filled(7, range(9)), filled(7, range(4))
    assert filled(7, range(4)).state()["rows"].shape == (4, 6)
    other.load_state(replay.state())
    for one in (replay, other):
        many = torch.full((2, 1), 50.0)
        one.add(Transitions(many, NONE[:2], many, many, NONE[:2], torch.full((2, 2), 50.0), torch.ones(2, 1)))
    assert np.array_equal(replay.state()["rows"], other.state()["rows"]) and replay.state()["next"] == 4
    assert torch.equal(draw(replay)[0].seen_actions, draw(other)[0].seen_actions)


def test_rows_of_another_width_are_refused():
    with pytest.raises(AlgorithmError, match=r"a replay of \(7, 6\) can't take rows of \(7, 8\)"):
        filled(7, range(7)).load_state({"rows": np.zeros((7, 8), np.float32), "next": 0})
