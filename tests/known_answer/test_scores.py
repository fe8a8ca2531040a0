"""Tests that the score of a policy describes its behaviour."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.known_answer.envs import SPACES
from tests.known_answer.harness import ACTION_SETUPS
from tests.known_answer.problems import ACTIONS, PROBLEMS
from tests.known_answer.scores import drawn, gaussian_bins, played, probabilities, require_drawn, score
from thalweg.algos import Policy
from thalweg.algos.policy.actions import Kind, actions_of
from thalweg.algos.policy.player import Player
from thalweg.algos.policy.policy_file import About

PROBLEM = PROBLEMS["dense"]


def policy_of(setup_name: str, continuous: Kind = "gaussian", seed: int = 0, greedy: bool = False) -> Policy:
    """A policy that was never trained, but acts differently in different states."""
    setup = ACTION_SETUPS[setup_name]
    actions = actions_of(SPACES[setup.space], **setup.config, continuous=continuous)
    policy = Policy(PROBLEM.states, actions, normalise=False, greedy=greedy)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in policy.actor.parameters():
            parameter.normal_(0.0, 0.3, generator=generator)
    return policy


@pytest.mark.parametrize("squashed", [False, True])
@pytest.mark.parametrize("edges", [(-0.5, 0.5), (0.5, 1.5)])
def test_probabilities_of_bins_agree_with_samples(edges: tuple[float, float], squashed: bool):
    mean, std = np.array([-1.0, 0.2, 0.9]), np.array([0.3, 1.0, 2.0])
    samples = mean[:, None] + std[:, None] * np.random.default_rng(0).standard_normal((3, 200_000))
    samples = np.tanh(samples) if squashed else samples
    counted = np.stack([((samples[..., None] > edges).sum(-1) == k).mean(1) for k in range(3)], 1)
    computed = gaussian_bins(mean, std, np.array(edges), squashed)
    assert computed == pytest.approx(counted, abs=0.005)
    assert computed.sum(-1) == pytest.approx(np.ones(3))


def test_a_squashed_sample_never_rounds_to_the_last_option():
    assert gaussian_bins(np.array([3.0]), np.array([2.0]), np.array([0.5, 1.5]), squashed=True)[0, 2] == 0.0


@pytest.mark.parametrize("setup", ACTION_SETUPS)
@pytest.mark.parametrize("continuous", ["gaussian", "squashed", "point"])
def test_the_computed_table_is_what_the_policy_draws(setup: str, continuous: Kind):
    policy, space = policy_of(setup, continuous), ACTION_SETUPS[setup].space
    table = probabilities(policy, PROBLEM, space)
    assert table is not None
    assert drawn(policy, PROBLEM, space, 20_000) == pytest.approx(table, abs=0.02)


def test_a_table_of_another_policy_is_refused():
    table = probabilities(policy_of("multidiscrete", seed=1), PROBLEM, "multidiscrete")
    assert table is not None
    with pytest.raises(AssertionError, match="other actions than computed"):
        require_drawn(policy_of("multidiscrete"), PROBLEM, "multidiscrete", table)


def test_a_greedy_policy_does_one_thing_in_each_state():
    chances = probabilities(policy_of("multidiscrete"), PROBLEM, "multidiscrete")
    greedy = probabilities(policy_of("multidiscrete", greedy=True), PROBLEM, "multidiscrete")
    assert chances is not None and greedy is not None
    assert greedy.tolist() == np.eye(ACTIONS)[chances.argmax(1)].tolist()


class Alternating:
    """Remembers: takes the first action, then the second, from the beginning of each episode."""

    obs_size, actions, about = PROBLEM.states, actions_of(SPACES["discrete"]), About()

    def __init__(self, first: int, second: int) -> None:
        self.both = np.array([first, second])

    def player(self, num_envs: int, *, deterministic: bool = False, generator: torch.Generator | None = None) -> Player:
        age = np.zeros(num_envs, dtype=np.int64)

        def play(obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
            age[:] = np.where(fresh, 0, age + 1)
            return self.both[age % 2]

        return play

    def save(self, path: str | Path) -> None:
        raise NotImplementedError


def episodes_of(first: int, second: int) -> tuple[float, float]:
    """Exact return and cost of `Alternating`: state and turn together are its state."""
    states, even = np.repeat(np.arange(PROBLEM.states), 2), np.tile([True, False], PROBLEM.states)
    action = np.where(even, first, second)
    flow = np.kron(PROBLEM.flow[:, first], [[0, 1], [0, 0]]) + np.kron(PROBLEM.flow[:, second], [[0, 0], [1, 0]])
    visits = np.linalg.solve(np.eye(len(states)) - flow.T, np.kron(PROBLEM.start, [1.0, 0.0]))
    return float(visits @ PROBLEM.reward[states, action]), float(visits @ PROBLEM.risk[states, action, 0])


def test_a_policy_with_a_memory_is_scored_by_what_it_does_in_play():
    found = played(Alternating(8, 1), PROBLEM, "discrete", num_envs=32, steps=1000)
    reward, cost = episodes_of(8, 1)
    assert 0.0 < found.reward_error < 0.05 * reward
    assert abs(found.reward - reward) < 4.0 * found.reward_error
    assert abs(found.cost - cost) < 4.0 * found.cost_error


def test_play_agrees_with_the_exact_score():
    policy = policy_of("multidiscrete")
    exact, found = score(policy, PROBLEM, "multidiscrete"), played(policy, PROBLEM, "multidiscrete")
    assert exact.reward_error == 0.0
    assert abs(found.reward - exact.reward) < 4.0 * found.reward_error
    assert abs(found.cost - exact.cost) < 4.0 * found.cost_error


def test_a_policy_that_sees_several_frames_is_watched_at_play():
    actions = actions_of(SPACES["discrete"])
    assert probabilities(Policy(PROBLEM.states, actions, frames=2), PROBLEM, "discrete") is None
    assert score(Policy(PROBLEM.states, actions, frames=2), PROBLEM, "discrete").reward_error > 0.0
