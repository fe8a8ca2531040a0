"""Is what is said of a trained policy what it does?"""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from tests.known_answer.envs import SPACES
from tests.known_answer.harness import PLACES
from tests.known_answer.problems import ACTIONS, PROBLEMS
from tests.known_answer.scores import drawn, gaussian_bins, modes, played, probabilities, require_drawn, score
from tests.known_answer.solutions import outcome
from thalweg.algos import Policy
from thalweg.algos.actions import actions_of
from thalweg.algos.distributions import Gaussians

PROBLEM = PROBLEMS["dense"]


def policy_of(place: str, seed: int = 0) -> Policy:
    """A policy that was never trained, but does different things in different places."""
    where = PLACES[place]
    policy = Policy(PROBLEM.places, actions_of(SPACES[where.space], **where.config), normalise=False)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        last = policy.actor.mean.layers[-1]
        last.weight.normal_(0.0, 0.5, generator=generator)  # pyright: ignore
        if policy.actor.log_std is not None:
            policy.actor.log_std.copy_(torch.tensor([-0.5, 0.3]))
    return policy


class Squashed(Gaussians):
    """tanh of a Gaussian."""

    squashed = True

    def sample(self, generator: torch.Generator | None) -> torch.Tensor:
        return super().sample(generator).tanh()


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


@pytest.mark.parametrize("place", PLACES)
def test_the_computed_table_is_what_the_policy_draws(place: str):
    policy = policy_of(place)
    table = probabilities(policy, PROBLEM)
    assert table is not None
    assert drawn(policy, PROBLEM, PLACES[place].space, 20_000) == pytest.approx(table, abs=0.02)


@pytest.mark.parametrize("place", ["box", "box_literal", "box_scaled"])
def test_the_table_of_a_squashed_head_is_what_it_draws(place: str, monkeypatch: pytest.MonkeyPatch):
    policy = policy_of(place)
    head = policy.distribution
    monkeypatch.setattr(policy, "distribution", lambda obs: Squashed(head(obs).mean, head(obs).log_std))  # pyright: ignore
    table = probabilities(policy, PROBLEM)
    assert table is not None
    assert drawn(policy, PROBLEM, PLACES[place].space, 20_000) == pytest.approx(table, abs=0.02)


def test_a_table_of_another_policy_is_refused():
    table = probabilities(policy_of("multidiscrete", seed=1), PROBLEM)
    assert table is not None
    with pytest.raises(AssertionError, match="other actions than computed"):
        require_drawn(policy_of("multidiscrete"), PROBLEM, "multidiscrete", table)


def test_the_mode_is_one_action_in_each_place():
    policy = policy_of("multidiscrete")
    table = probabilities(policy, PROBLEM)
    assert table is not None
    assert modes(policy, PROBLEM, "multidiscrete").argmax(1).tolist() == table.argmax(1).tolist()
    assert score(policy, PROBLEM, "multidiscrete", "mode").reward_error == 0.0


class Alternating:
    """Remembers: takes the first action, then the second, from the beginning of each episode."""

    def __init__(self, first: int, second: int) -> None:
        self.both = np.array([first, second])

    def player(
        self, num_envs: int, deterministic: bool = False, generator: torch.Generator | None = None
    ) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        age = np.zeros(num_envs, dtype=np.int64)

        def play(obs: np.ndarray, fresh: np.ndarray) -> np.ndarray:
            age[:] = np.where(fresh, 0, age + 1)
            return self.both[age % 2]

        return play


def episodes_of(first: int, second: int) -> tuple[float, float]:
    """Exact return and cost of `Alternating`: place and turn together are the state."""
    place, even = np.repeat(np.arange(PROBLEM.places), 2), np.tile([True, False], PROBLEM.places)
    action = np.where(even, first, second)
    flow = np.kron(PROBLEM.flow[:, first], [[0, 1], [0, 0]]) + np.kron(PROBLEM.flow[:, second], [[0, 0], [1, 0]])
    visits = np.linalg.solve(np.eye(len(place)) - flow.T, np.kron(PROBLEM.start, [1.0, 0.0]))
    return float(visits @ PROBLEM.reward[place, action]), float(visits @ PROBLEM.risk[place, action, 0])


def test_a_policy_with_a_memory_is_scored_by_what_it_does_in_play():
    found = played(Alternating(8, 1), PROBLEM, "discrete", num_envs=32, steps=1000)
    reward, cost = episodes_of(8, 1)
    assert 0.0 < found.reward_error < 0.05 * reward
    assert abs(found.outcome.reward - reward) < 4.0 * found.reward_error
    assert abs(found.outcome.cost - cost) < 4.0 * found.cost_error


def test_play_agrees_with_the_exact_score():
    policy = policy_of("multidiscrete")
    exact, found = (score(policy, PROBLEM, "multidiscrete", how) for how in ("drawn", "played"))
    assert exact.reward_error == 0.0
    assert abs(found.outcome.reward - exact.outcome.reward) < 4.0 * found.reward_error
    assert abs(found.outcome.cost - exact.outcome.cost) < 4.0 * found.cost_error


def test_an_untrained_policy_scores_as_the_table_it_draws():
    policy = policy_of("discrete")
    drawn_table = drawn(policy, PROBLEM, "discrete", 50_000)
    assert drawn_table.shape == (PROBLEM.places, ACTIONS)
    assert score(policy, PROBLEM, "discrete", "drawn").outcome.reward == pytest.approx(
        outcome(PROBLEM, drawn_table).reward, rel=0.02
    )
