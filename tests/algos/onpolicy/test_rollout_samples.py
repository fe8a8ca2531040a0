"""From rollouts to samples, against loops over one environment after the other."""

from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.algos.rollouts import rollout_of
from thalweg.algos.interface import Rollout
from thalweg.algos.onpolicy.rollout_samples import RolloutMemory, Samples, Signal, samples_of
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.memory import Sequences
from thalweg.algos.policy.networks import Critics, NetworkShape
from thalweg.algos.policy.normaliser import Normaliser
from thalweg.algos.policy.policy import Policy

N, T, D, M = 3, 11, 2, 4
LENGTHS = (1, 4, 11, 16)
"""Of the sequences: single steps, no divisor of T, T itself, and longer than the rollout."""


def numbers(*shape: int, seed: int) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def flat_samples(rollout: Rollout, trace: float = 0.0) -> Samples:
    critics = Critics(1, D, NetworkShape((8,)), torch.Generator().manual_seed(0))
    return samples_of(rollout, critics, Normaliser(D, enabled=False), [Signal(rollout.rewards, 0.9, trace)])


def test_a_truncated_step_is_worth_its_final_observation():
    critics = Critics(1, D, NetworkShape((8,)), torch.Generator().manual_seed(0))
    cut, final = torch.zeros(T, N, dtype=torch.bool), torch.full((1, D), 0.7)
    cut[6, 2] = True
    rollout = rollout_of(
        numbers(T + 1, N, D, seed=1), truncated=cut, final_index=torch.tensor([6 * N + 2]), final_obs=final
    )
    with torch.no_grad():
        expected = rollout.rewards[6, 2] + 0.9 * critics(final)[0, 0]
        elsewhere = rollout.rewards[6, 1] + 0.9 * critics(rollout.obs[7])[0, 1]
    targets = flat_samples(rollout).targets.view(T, N)
    assert targets[6, 2].item() == pytest.approx(expected.item(), abs=1e-6)
    assert targets[6, 1].item() == pytest.approx(elsewhere.item(), abs=1e-6)


def test_a_terminated_step_is_worth_its_reward_whatever_its_final_observation():
    ends = torch.zeros(T, N, dtype=torch.bool)
    ends[6, 2] = True
    place, final = torch.tensor([6 * N + 2]), torch.full((1, D), 0.7)
    rollout = rollout_of(numbers(T + 1, N, D, seed=1), terminated=ends, final_index=place, final_obs=final)
    assert flat_samples(rollout).targets.view(T, N)[6, 2].item() == pytest.approx(1.0)


def test_every_signal_is_predicted_by_its_own_critic():
    critics = Critics(3, D, NetworkShape((8,)), torch.Generator().manual_seed(0))
    streams = [numbers(T, N, seed=seed) for seed in (1, 2, 3)]
    rollout, normaliser = rollout_of(numbers(T + 1, N, D, seed=4)), Normaliser(D, enabled=False)
    found = samples_of(rollout, critics, normaliser, [Signal(stream, 0.9, 0.0) for stream in streams])
    with torch.no_grad():
        values = critics(rollout.obs.flatten(0, 1)).view(3, T + 1, N)
    for k, stream in enumerate(streams):
        assert torch.allclose(found.values[k].view(T, N), values[k, :-1], atol=1e-6)
        assert torch.allclose(found.targets[k].view(T, N), stream + 0.9 * values[k, 1:], atol=1e-5)


def test_minibatches_of_observations_hold_every_row_once_and_keep_rows_together():
    obs = numbers(T + 1, N, D, seed=1)
    obs[:-1, :, 0] = torch.arange(T * N).view(T, N)
    found = flat_samples(rollout_of(obs))
    batches = list(found.minibatches((torch.arange(T * N),), 10, torch.Generator().manual_seed(0)))
    assert [len(rows) for _, (rows,) in batches] == [11, 11, 11]
    for inputs, (rows,) in batches:
        assert isinstance(inputs, torch.Tensor) and inputs[:, 0].tolist() == rows.tolist()
    order = torch.cat([rows for _, (rows,) in batches])
    assert order.tolist() != list(range(T * N)) and order.sort().values.tolist() == list(range(T * N))


@dataclass(frozen=True)
class Recurrent:
    """A policy and critics with a memory, and two rollouts in a row with ends and steps that count for nothing."""

    policy: Policy
    critics: Critics
    rollouts: tuple[Rollout, Rollout]

    def memory(self, length: int) -> RolloutMemory:
        assert self.policy.actor.gru is not None and self.critics.gru is not None
        return RolloutMemory(self.policy.actor.gru, self.critics.gru, N, length)

    def samples(self, rollout: Rollout, memory: RolloutMemory) -> Samples:
        signals = [Signal(rollout.rewards, 0.9, 0.8), Signal(rollout.costs[..., 0], 0.9, 0.8)]
        return samples_of(rollout, self.critics, self.policy.normaliser, signals, memory)


def recurrent() -> Recurrent:
    shape, generator = NetworkShape((8,), memory=M), torch.Generator().manual_seed(0)
    actions = actions_of(gym.spaces.MultiDiscrete([3, 2]))
    policy = Policy(D, actions, shape, generator=generator)
    policy.normaliser.update(numbers(50, D, seed=9) * 2 + 1)
    obs = numbers(2 * T + 1, N, D, seed=1)
    truncated, terminated = torch.zeros(2, 2 * T, N, dtype=torch.bool)
    terminated[8, 0] = True
    for step, env in ((2, 0), (3, 1), (T - 1, 2), (T + 4, 1)):
        truncated[step, env] = True
    ends = truncated | terminated
    starts = torch.cat([torch.ones(1, N, dtype=torch.bool), ends])
    # Environment 1 spends a step on each reset: it sees the last observation once more before it begins.
    starts[1:, 1], invalid = False, torch.zeros_like(ends)
    starts[2:, 1] = invalid[1:, 1] = ends[:-1, 1]

    def part(first: int) -> Rollout:
        steps = slice(first, first + T)
        places = ends[steps].flatten().nonzero().squeeze(-1)
        return rollout_of(
            obs[first : first + T + 1],
            fresh=starts[first : first + T + 1],
            actions=torch.arange(T * N * 2).view(T, N, 2) % 2,
            rewards=numbers(T, N, seed=2 + first),
            costs=numbers(T, N, 1, seed=3 + first),
            terminated=terminated[steps],
            truncated=truncated[steps],
            valid=~invalid[steps],
            final_index=places,
            final_obs=numbers(len(places), D, seed=4 + first),
        )

    return Recurrent(policy, Critics(2, D, shape, generator), (part(0), part(T)))


def along(one: Recurrent, env: int) -> tuple[torch.Tensor, torch.Tensor, dict[int, torch.Tensor]]:
    """Of one environment, step by step through both rollouts: the policy's parameters [2T, P], the critics' values
    [2, 2T] and those of last observations by the step that they follow."""
    actor, critics, normaliser = one.policy.actor, one.critics, one.policy.normaliser
    assert actor.gru is not None and critics.gru is not None
    hidden = {"actor": torch.zeros(1, M), "critics": torch.zeros(1, M)}
    parameters, values, final = [], [], {}
    for half, rollout in enumerate(one.rollouts):
        for step in range(T):
            seen, fresh = normaliser(rollout.obs[step, env][None]), bool(rollout.fresh[step, env])
            for name, gru in (("actor", actor.gru), ("critics", critics.gru)):
                before = torch.zeros(1, M) if fresh else hidden[name]
                hidden[name] = torch.gru_cell(seen, before, gru.weight_in, gru.weight, gru.bias_in, gru.bias)
            parameters.append(actor.stack(torch.cat([seen, hidden["actor"]], -1))[0])
            values.append(critics.stack(torch.cat([seen, hidden["critics"]], -1))[:, 0, 0])
            for place, obs in zip(rollout.final_index.tolist(), rollout.final_obs, strict=True):
                if place == step * N + env:
                    gru, last = critics.gru, normaliser(obs[None])
                    state = torch.gru_cell(last, hidden["critics"], gru.weight_in, gru.weight, gru.bias_in, gru.bias)
                    final[half * T + step] = critics.stack(torch.cat([last, state], -1))[:, 0, 0]
    return torch.cat(parameters), torch.stack(values, 1), final


def places_of(found: Samples, size: int) -> list[tuple[int, int]]:
    """Step and environment of each sample, told by the sequences alone."""
    assert isinstance(found.inputs, Sequences)
    length, columns = found.inputs.fresh.shape
    assert length == size and columns == -(-T // size) * N
    return [
        (int(keep) // columns + int(keep) % columns // N * length, int(keep) % columns % N)
        for keep in found.inputs.keep
    ]


@pytest.mark.parametrize("length", LENGTHS)
class TestRecurrentSamples:
    def test_every_valid_step_is_there_once(self, length: int):
        one = recurrent()
        places = places_of(one.samples(one.rollouts[0], one.memory(length)), length)
        assert sorted(places) == [tuple(place) for place in one.rollouts[0].valid.nonzero().tolist()]

    @torch.no_grad()
    def test_policy_and_critics_see_what_a_walk_step_by_step_sees(self, length: int):
        one = recurrent()
        memory, walks = one.memory(length), [along(one, env) for env in range(N)]
        for half, rollout in enumerate(one.rollouts):
            found = one.samples(rollout, memory)
            parameters, critics = one.policy.actor(found.inputs), one.critics(found.inputs)
            for row, (step, env) in enumerate(places_of(found, length)):
                walked, values, _ = walks[env]
                at = half * T + step
                assert torch.allclose(parameters[row], walked[at], atol=1e-6)
                assert torch.allclose(critics[:, row], values[:, at], atol=1e-6)
                assert torch.allclose(found.values[:, row], values[:, at], atol=1e-6)
                assert torch.equal(found.actions[row], rollout.actions[step, env])
            memory.advance()

    @torch.no_grad()
    def test_targets_are_those_of_a_walk_step_by_step(self, length: int):
        one = recurrent()
        memory, walks = one.memory(length), [along(one, env) for env in range(N)]
        rollout = one.rollouts[0]
        found = one.samples(rollout, memory)
        streams = torch.stack([rollout.rewards, rollout.costs[..., 0]])
        expected = {}
        for env, (_, values, final) in enumerate(walks):
            running = torch.zeros(2)
            for step in range(T - 1, -1, -1):
                after = final.get(step, values[:, step + 1])
                after = torch.zeros(2) if rollout.terminated[step, env] else after
                ended = bool(rollout.terminated[step, env] | rollout.truncated[step, env])
                delta = streams[:, step, env] + 0.9 * after - values[:, step]
                running = delta + 0.9 * 0.8 * (0.0 if ended else running)
                expected[step, env] = running
        for row, place in enumerate(places_of(found, length)):
            assert torch.allclose(found.advantages[:, row], expected[place], atol=1e-5)
            assert torch.allclose(found.targets[:, row], (found.values + found.advantages)[:, row])

    def test_minibatches_hold_every_valid_step_once_with_what_belongs_to_it(self, length: int):
        one = recurrent()
        found = one.samples(one.rollouts[0], one.memory(length))
        with torch.no_grad():
            whole = one.policy.actor(found.inputs)
            rows = torch.arange(len(found.actions))
            batches = list(found.minibatches((rows, found.actions), 8, torch.Generator().manual_seed(0)))
            for inputs, (chosen, actions) in batches:
                assert torch.equal(found.actions[chosen], actions)
                assert torch.allclose(one.policy.actor(inputs), whole[chosen], atol=1e-6)
        assert torch.cat([chosen for _, (chosen, _) in batches]).sort().values.tolist() == rows.tolist()
        assert len(batches) > 1 or length >= T


def test_a_player_ends_a_rollout_in_the_state_that_starts_the_next():
    one = recurrent()
    rollout, memory = one.rollouts[0], one.memory(4)
    player = one.policy.player(N, generator=torch.Generator().manual_seed(0))
    for step in range(T):
        player(rollout.obs[step].numpy(), rollout.fresh[step].numpy())
    one.samples(rollout, memory)
    memory.advance()
    assert player.hidden is not None
    assert np.allclose(memory.starts["actor"].numpy(), player.hidden.numpy(), atol=1e-6)


def test_the_memory_resumes_from_its_state():
    one = recurrent()
    memory, other = one.memory(4), one.memory(4)
    one.samples(one.rollouts[0], memory)
    memory.advance()
    other.load_state(memory.state())
    found, again = (one.samples(one.rollouts[1], each) for each in (memory, other))
    assert torch.equal(found.targets, again.targets) and torch.equal(found.values, again.values)
