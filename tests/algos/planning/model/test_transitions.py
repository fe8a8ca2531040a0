"""Which steps reach the replay: ends with what they cost, last observations, nothing from a reset."""

from dataclasses import replace

import pytest
import torch

from tests.algos.planning.made import generator, rollout_of
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


def made_of(rollout: Rollout, repeat: int = 1, drop_terminal: bool = False) -> Batch:
    return TransitionBuilder(2, repeat, drop_terminal=drop_terminal).transitions(rollout, 3)


def test_a_terminal_step_is_kept_with_its_cost_and_its_last_observation():
    batch = made_of(ending())
    assert len(batch.rewards) == 12 and float(batch.costs.sum()) == 1.0
    (row,) = torch.nonzero(batch.terminated).flatten().tolist()
    assert float(batch.costs[row]) == 1.0
    assert batch.obs[row].tolist() == [12, 12, 12] and batch.next_frame[row].tolist() == [99, 99, 99]


def test_a_step_that_was_cut_off_is_no_end_and_leads_to_its_last_observation():
    batch = made_of(ending())
    row = int(torch.nonzero(batch.obs[:, 0] == 4))
    assert not batch.terminated[row] and batch.next_frame[row].tolist() == [77, 77, 77]


def test_with_the_quirk_no_cost_at_an_end_is_ever_seen():
    batch = made_of(ending(), drop_terminal=True)
    assert len(batch.rewards) == 10 and float(batch.costs.sum()) == 0.0 and not batch.terminated.any()


def test_a_step_that_only_resets_is_no_transition():
    rollout = ending()
    rollout.valid[3, 1] = False
    rollout.obs[3, 1] = 1e6
    batch = made_of(rollout)
    assert len(batch.rewards) == 11 and float(batch.obs.max()) < 100


def test_with_an_action_repeat_a_transition_is_of_several_steps_and_an_end_cuts_it_short():
    batch = made_of(ending(), repeat=2)
    found = [(float(o[0]), float(r), float(f[0]), bool(e)) for o, r, f, e in
             zip(batch.obs, batch.rewards, batch.next_frame, batch.terminated, strict=True)]  # fmt: skip
    environment0 = [(0, 0 + 1, 2, False), (2, 2 + 3, 4, False), (4, 4, 77, False)]
    environment1 = [(10, 0 + 1, 12, False), (12, 2, 99, True), (13, 3 + 4, 15, False)]
    assert sorted(found) == sorted(environment0 + environment1)


def test_an_action_repeat_goes_on_in_the_next_rollout():
    whole, repeat = rollout_of(6), 4
    assembly = TransitionBuilder(2, repeat, drop_terminal=False)
    halves = [
        replace(whole, **{name: getattr(whole, name)[a : b + (name in ("obs", "fresh"))] for name in
                ("obs", "fresh", "actions", "rewards", "costs", "terminated", "truncated", "valid")})
        for a, b in ((0, 3), (3, 6))
    ]  # fmt: skip
    first = assembly.transitions(halves[0], 3)
    other = TransitionBuilder(2, repeat, drop_terminal=False)
    other.load_state(assembly.state())
    second = other.transitions(halves[1], 3)
    assert len(first.rewards) == 0 and second.rewards.tolist() == [6, 6] and second.obs[:, 0].tolist() == [0, 10]


def test_a_decision_of_an_episode_abandoned_between_two_rollouts_is_not_joined_to_the_next():
    assembly, later = TransitionBuilder(2, 4, drop_terminal=False), rollout_of(6)
    assert len(assembly.transitions(rollout_of(3), 3).rewards) == 0
    later.fresh[0, 1] = True
    batch = assembly.transitions(later, 3)
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


def test_a_full_replay_forgets_the_oldest():
    replay = ReplayBuffer(10, 0.2)
    for first in (0, 4, 8, 12):
        replay.add(batch_of(first, 4))
    assert sorted(replay.rows(torch.arange(replay.size)).rewards.tolist()) == list(range(6, 16))


def test_what_is_held_out_is_never_fitted_to():
    replay = ReplayBuffer(1000, 0.2)
    replay.add(batch_of(0, 503))
    held_out = set(replay.held_out().rewards.tolist())
    drawn = set(replay.rows(replay.places((4, 3000), generator())).rewards.flatten().tolist())
    assert len(held_out) == 101 and drawn == set(range(503)) - held_out
    assert set(replay.rows(replay.fitted()).rewards.tolist()) == drawn


def test_a_replay_from_its_state_goes_on_alike():
    one, two = ReplayBuffer(20, 0.2), ReplayBuffer(20, 0.2)
    one.add(batch_of(0, 7))
    two.load_state(one.state())
    for replay in (one, two):
        replay.add(batch_of(7, 16))
    ours, theirs = (vars(replay.rows(torch.arange(20))) for replay in (one, two))
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_frames_side_by_side_move_on_by_one():
    batch = Batch(
        torch.tensor([[1.0, 2, 3, 4]]), torch.zeros(1, 1), torch.zeros(1), torch.zeros(1, 1),
        torch.tensor([[5.0, 6]]), torch.zeros(1, dtype=torch.bool),
    )  # fmt: skip
    assert batch.next_obs.tolist() == [[3, 4, 5, 6]]


def test_the_mean_length_of_episodes():
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


def test_before_any_end_the_longest_episode_so_far_counts_and_a_fixed_length_always_does():
    lengths, fixed = EpisodeLength(2), EpisodeLength(2, 1000)
    for one in (lengths, fixed):
        one.update(rollout_of(6))
    assert (lengths.mean, fixed.mean) == (6, 1000)


def test_an_episode_abandoned_between_two_rollouts_counts_for_nothing():
    lengths, later = EpisodeLength(2), rollout_of(3)
    lengths.update(rollout_of(6))
    later.fresh[0] = later.terminated[2] = True
    lengths.update(later)
    assert lengths.mean == 3
