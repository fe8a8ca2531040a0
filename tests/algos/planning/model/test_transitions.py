"""Tests of transitions and the replay buffer."""

from dataclasses import replace

import pytest
import torch

from tests.algos.planning.planning_fixtures import generator, rollout_of
from thalweg.algos.interface import Rollout
from thalweg.algos.planning.episode_length import EpisodeLength
from thalweg.algos.planning.model.transitions import Batch, ReplayBuffer, TransitionBuilder


def ending(**changes) -> Rollout:
    """Environment 1 ends with a cost in step 2, and environment 0 is cut off in step 4."""
    rollout = rollout_of(**changes)
    rollout.terminated[2, 1] = rollout.truncated[4, 0] = True
    rollout.costs[2, 1] = 1.0
    return replace(
        rollout, final_index=torch.tensor([2 * 2 + 1, 4 * 2]), final_obs=torch.tensor([[99.0] * 3, [77.0] * 3])
    )


def transitions_of(rollout: Rollout, repeat: int = 1, drop_terminal: bool = False) -> Batch:
    return TransitionBuilder(2, repeat, drop_terminal=drop_terminal).transitions(rollout, 3)


def test_terminal_step_keeps_its_cost_and_final_observation():
    batch = transitions_of(ending())
    assert len(batch.rewards) == 12 and float(batch.costs.sum()) == 1.0
    (row,) = torch.nonzero(batch.terminated).flatten().tolist()
    assert float(batch.costs[row]) == 1.0
    assert batch.obs[row].tolist() == [12, 12, 12] and batch.next_frame[row].tolist() == [99, 99, 99]


def test_truncated_step_is_not_terminal_and_has_its_final_observation():
    batch = transitions_of(ending())
    row = int(torch.nonzero(batch.obs[:, 0] == 4))
    assert not batch.terminated[row] and batch.next_frame[row].tolist() == [77, 77, 77]


def test_drop_terminal_removes_terminal_costs():
    batch = transitions_of(ending(), drop_terminal=True)
    assert len(batch.rewards) == 10 and float(batch.costs.sum()) == 0.0 and not batch.terminated.any()


def test_reset_step_is_no_transition():
    rollout = ending()
    rollout.valid[3, 1] = False
    rollout.obs[3, 1] = 1e6
    batch = transitions_of(rollout)
    assert len(batch.rewards) == 11 and float(batch.obs.max()) < 100


def test_action_repeat_sums_steps_until_the_episode_ends():
    batch = transitions_of(ending(), repeat=2)
    found = [(float(o[0]), float(r), float(f[0]), bool(e)) for o, r, f, e in
             zip(batch.obs, batch.rewards, batch.next_frame, batch.terminated, strict=True)]  # fmt: skip
    environment0 = [(0, 0 + 1, 2, False), (2, 2 + 3, 4, False), (4, 4, 77, False)]
    environment1 = [(10, 0 + 1, 12, False), (12, 2, 99, True), (13, 3 + 4, 15, False)]
    assert sorted(found) == sorted(environment0 + environment1)


def test_action_repeat_continues_in_the_next_rollout():
    whole, repeat = rollout_of(6), 4
    builder = TransitionBuilder(2, repeat, drop_terminal=False)
    halves = [
        replace(whole, **{name: getattr(whole, name)[a : b + (name in ("obs", "fresh"))] for name in
                ("obs", "fresh", "actions", "rewards", "costs", "terminated", "truncated", "valid")})
        for a, b in ((0, 3), (3, 6))
    ]  # fmt: skip
    first = builder.transitions(halves[0], 3)
    other = TransitionBuilder(2, repeat, drop_terminal=False)
    other.load_state(builder.state())
    second = other.transitions(halves[1], 3)
    assert len(first.rewards) == 0 and second.rewards.tolist() == [6, 6] and second.obs[:, 0].tolist() == [0, 10]


def test_pending_transition_of_an_abandoned_episode_is_dropped():
    builder, later = TransitionBuilder(2, 4, drop_terminal=False), rollout_of(6)
    assert len(builder.transitions(rollout_of(3), 3).rewards) == 0
    later.fresh[0, 1] = True
    batch = builder.transitions(later, 3)
    found = sorted(zip(batch.obs[:, 0].tolist(), batch.rewards.tolist(), strict=True))
    # environment 0 goes on after three steps; environment 1 begins anew, with rewards 0 to 3
    assert found == [(0.0, 0 + 1 + 2 + 0), (1.0, 1 + 2 + 3 + 4), (10.0, 0 + 1 + 2 + 3)]


def batch_of(first: int, count: int) -> Batch:
    numbers = torch.arange(float(first), first + count)
    return Batch(
        numbers.unsqueeze(1),
        torch.zeros(count, 1, dtype=torch.int64),
        numbers,
        torch.zeros(count, 1),
        numbers.unsqueeze(1),
        torch.zeros(count, dtype=torch.bool),
    )


def test_full_replay_buffer_overwrites_the_oldest_transitions():
    replay = ReplayBuffer(10, 0.2)
    for first in (0, 4, 8, 12):
        replay.add(batch_of(first, 4))
    assert sorted(replay.rows(torch.arange(replay.size)).rewards.tolist()) == list(range(6, 16))


def test_held_out_transitions_are_never_sampled():
    replay = ReplayBuffer(1000, 0.2)
    replay.add(batch_of(0, 503))
    held_out = set(replay.held_out().rewards.tolist())
    drawn = set(replay.rows(replay.sample_indices((4, 3000), generator())).rewards.flatten().tolist())
    assert len(held_out) == 101 and drawn == set(range(503)) - held_out
    assert set(replay.rows(replay.training_indices()).rewards.tolist()) == drawn


def test_restored_replay_buffer_resumes_identically():
    one, two = ReplayBuffer(20, 0.2), ReplayBuffer(20, 0.2)
    one.add(batch_of(0, 7))
    two.load_state(one.state())
    for replay in (one, two):
        replay.add(batch_of(7, 16))
    ours, theirs = (vars(replay.rows(torch.arange(20))) for replay in (one, two))
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_next_observation_shifts_stacked_frames_by_one():
    batch = Batch(
        torch.tensor([[1.0, 2, 3, 4]]), torch.zeros(1, 1), torch.zeros(1), torch.zeros(1, 1),
        torch.tensor([[5.0, 6]]), torch.zeros(1, dtype=torch.bool),
    )  # fmt: skip
    assert batch.next_obs.tolist() == [[3, 4, 5, 6]]


def test_mean_episode_length():
    lengths = EpisodeLength(2)
    assert lengths.mean == 1
    rollout = ending()
    rollout.fresh[3, 1] = rollout.fresh[5, 0] = True
    lengths.update(rollout)
    assert lengths.mean == pytest.approx((3 + 5) / 2)  # environment 1 ends after 3 steps, environment 0 after 5
    more = rollout_of(2)
    more.terminated[1] = True
    lengths.update(more)
    assert lengths.mean == pytest.approx((3 + 5 + (1 + 2) + (3 + 2)) / 4)


def test_mean_is_the_longest_episode_before_any_end_and_a_fixed_length_always():
    lengths, fixed = EpisodeLength(2), EpisodeLength(2, 1000)
    for one in (lengths, fixed):
        one.update(rollout_of(6))
    assert (lengths.mean, fixed.mean) == (6, 1000)


def test_abandoned_episode_is_not_counted():
    lengths, later = EpisodeLength(2), rollout_of(3)
    lengths.update(rollout_of(6))
    later.fresh[0] = later.terminated[2] = True
    lengths.update(later)
    assert lengths.mean == 3
