"""Tests of the memory of a policy: frames by hand, the recurrent unit against torch's."""

import numpy as np
import pytest
import torch

from thalweg.algos.policy.memory import FrameStack, Gru, Sequences

NO, YES = False, True


def column(*values: float) -> torch.Tensor:
    """[N, 1] one number for each environment."""
    return torch.tensor(values).unsqueeze(1)


def test_the_first_frame_of_an_episode_stands_for_those_that_are_missing():
    stack = FrameStack(2, 1, 3)
    assert stack.push(column(1.0, 5.0), torch.tensor([YES, YES])).tolist() == [[1, 1, 1], [5, 5, 5]]
    assert stack.push(column(2.0, 6.0), torch.tensor([NO, NO])).tolist() == [[1, 1, 2], [5, 5, 6]]
    assert stack.push(column(3.0, 7.0), torch.tensor([NO, YES])).tolist() == [[1, 2, 3], [7, 7, 7]]
    assert stack.push(column(4.0, 8.0), torch.tensor([NO, NO])).tolist() == [[2, 3, 4], [7, 7, 8]]


def test_frames_of_several_numbers_stay_together_the_newest_last():
    stack = FrameStack(1, 2, 2)
    stack.push(torch.tensor([[1.0, 2.0]]), torch.tensor([YES]))
    assert stack.push(torch.tensor([[3.0, 4.0]]), torch.tensor([NO])).tolist() == [[1, 2, 3, 4]]


def test_a_glance_ahead_shows_what_a_push_would_return_and_changes_nothing():
    stack = FrameStack(3, 1, 3)
    stack.push(column(1.0, 5.0, 9.0), torch.tensor([YES] * 3))
    stack.push(column(2.0, 6.0, 8.0), torch.tensor([NO] * 3))
    before = stack.state()
    assert stack.peek(column(7.0, 3.0), torch.tensor([2, 0])).tolist() == [[9, 8, 7], [1, 2, 3]]
    assert stack.peek(torch.zeros(0, 1), torch.zeros(0, dtype=torch.int64)).shape == (0, 3)
    assert np.array_equal(stack.state(), before)


def test_one_frame_is_itself():
    stack = FrameStack(2, 1, 1)
    assert stack.push(column(1.0, 2.0), torch.tensor([NO, YES])).tolist() == [[1], [2]]
    assert stack.peek(column(3.0), torch.tensor([1])).tolist() == [[3]]


def test_what_was_returned_is_not_changed_by_later_frames():
    stack = FrameStack(1, 1, 2)
    first = stack.push(column(1.0), torch.tensor([YES]))
    stack.push(column(2.0), torch.tensor([NO]))
    assert first.tolist() == [[1, 1]]


def test_a_frame_stack_resumes_from_its_state():
    stack, other = FrameStack(1, 1, 3), FrameStack(1, 1, 3)
    for number, fresh in ((1, YES), (2, NO)):
        stack.push(column(float(number)), torch.tensor([fresh]))
    other.load_state(stack.state())
    assert other.push(column(3.0), torch.tensor([NO])).tolist() == [[1, 2, 3]]


D, M = 3, 5


def gru() -> Gru:
    return Gru(D, M, torch.Generator().manual_seed(0))


def numbers(*shape: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def torchs(one: Gru) -> torch.nn.GRUCell:
    """Torch's own cell with the same weights."""
    cell = torch.nn.GRUCell(D, M)
    names = {"weight_ih": one.weight_in, "weight_hh": one.weight, "bias_ih": one.bias_in, "bias_hh": one.bias}
    cell.load_state_dict({name: value.detach() for name, value in names.items()})
    return cell


def test_a_step_is_that_of_torchs_cell():
    one, obs, state = gru(), numbers(4, D), numbers(4, M, seed=2)
    never = torch.zeros(4, dtype=torch.bool)
    assert torch.allclose(one.step(obs, state, never), torchs(one)(obs, state), atol=1e-6)


def test_the_state_is_cleared_at_the_start_of_an_episode():
    one, obs, state = gru(), numbers(4, D), numbers(4, M, seed=2)
    fresh = torch.tensor([True, False, True, False])
    expected = torchs(one)(obs, torch.where(fresh[:, None], 0.0, state))
    assert torch.allclose(one.step(obs, state, fresh), expected, atol=1e-6)


def test_states_along_a_sequence_are_those_of_step_after_step():
    one, cell, obs, start = gru(), torchs(gru()), numbers(6, 2, D), numbers(2, M, seed=2)
    fresh = torch.zeros(6, 2, dtype=torch.bool)
    fresh[3, 1] = True
    found = one.states(obs, fresh, start)
    for env in range(2):
        state = start[env : env + 1]
        for step in range(6):
            state = torch.zeros(1, M) if fresh[step, env] else state
            state = cell(obs[step, env : env + 1], state)
            assert torch.allclose(found[step, env], state[0], atol=1e-6)


def test_features_are_observation_and_state_of_the_steps_that_count():
    one, obs, start = gru(), numbers(3, 2, D), torch.zeros(2, M)
    never = torch.zeros(3, 2, dtype=torch.bool)
    sequences = Sequences(obs, never, {"some": start}, torch.tensor([0, 3, 4]))
    states = one.states(obs, never, start)
    found = one.features(sequences, "some")
    for row, (step, env) in enumerate([(0, 0), (1, 1), (2, 0)]):
        assert torch.equal(found[row], torch.cat([obs[step, env], states[step, env]]))


def test_weights_start_within_the_range_of_torchs_cell():
    for value in Gru(D, 64, torch.Generator().manual_seed(0)).parameters():
        assert 0.8 / 8 < value.abs().max() <= 1 / 8
    assert gru().start(4).tolist() == [[0.0] * M] * 4


def test_an_empty_batch_has_no_states():
    assert gru().step(torch.zeros(0, D), torch.zeros(0, M), torch.zeros(0, dtype=torch.bool)).shape == (0, M)


@pytest.mark.parametrize("cut", [1, 2])
def test_the_gradient_flows_back_through_an_episode_but_not_into_the_one_before(cut: int):
    one, obs = gru(), numbers(4, 1, D).requires_grad_()
    fresh = torch.zeros(4, 1, dtype=torch.bool)
    fresh[cut] = True
    one.states(obs, fresh, torch.zeros(1, M))[-1].sum().backward()
    assert obs.grad is not None
    assert [bool(row.abs().sum() > 0) for row in obs.grad] == [step >= cut for step in range(4)]
