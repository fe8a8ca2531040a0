"""Does learning reach the optimum that a linear programme knows?

Needs six runs of `STEPS` steps, a minute or so where a core is free. The shares of the optimum that are asserted to be
0.9 or more lay between 0.92 and 0.98 for every single seed tried (0, 1, 2), so that neither the seed nor a machine that
rounds differently decides.
"""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.known_answer.cmdp import PACES, PLACES, WAYS, Problem, ProblemEnv, problem
from thalweg.algos import Policy
from thalweg.train import run

STEPS = 160_000
SEEDS = (0, 1)
"""Of the runs with a cost limit."""
LIMITS = {"dense": 0.2, "at the end": 0.1}
"""Cost limit for each way in which the cost is paid."""


def problem_of(kind: str) -> Problem:
    return problem(deadly=kind == "at the end")


def probabilities(policy: Policy) -> np.ndarray:
    """[S, 9] of the policy's joint actions."""
    with torch.no_grad():
        branches = policy.distribution(torch.eye(PLACES)).log_p.exp().double().numpy()  # pyright: ignore
    return (branches[:, 0, :, None] * branches[:, 1, None, :]).reshape(PLACES, PACES * WAYS)


def value_iteration(given: Problem) -> float:
    """Return of the best policy that knows no cost, without a linear programme."""
    value = np.zeros(PLACES)
    for _ in range(2000):
        value = (given.reward + given.going_on * (given.move @ value)).max(1)
    return float(given.start @ value)


@pytest.mark.parametrize("kind", LIMITS)
def test_the_linear_programme_agrees_with_value_iteration(kind: str):
    given = problem_of(kind)
    assert given.optimum(limit=np.inf)[0] == pytest.approx(value_iteration(given), rel=1e-9)


@pytest.mark.parametrize("kind", LIMITS)
def test_the_exact_value_agrees_with_the_environment(kind: str):
    given, generator = problem_of(kind), np.random.default_rng(0)
    policy = generator.dirichlet(np.ones(PACES * WAYS), PLACES)
    env = ProblemEnv(given, 2000)
    obs, _ = env.reset(seed=0)
    reward = cost = episodes = 0.0
    for _ in range(300):
        draw = generator.random((env.num_envs, 1))
        joint = (draw >= policy[obs.argmax(1)].cumsum(1)).sum(1).clip(max=PACES * WAYS - 1)
        obs, paid, ended, _, info = env.step(np.stack([joint // WAYS, joint % WAYS], 1))
        reward, cost, episodes = reward + paid.sum(), cost + info["cost"].sum(), episodes + ended.sum()
    assert (reward / episodes, cost / episodes) == pytest.approx(given.value(policy), rel=0.03)


@pytest.mark.parametrize("kind", LIMITS)
def test_the_limit_binds(kind: str):
    given, limit = problem_of(kind), LIMITS[kind]
    best, cost = given.optimum(limit)
    free, free_cost = given.optimum(np.inf)
    assert cost == pytest.approx(limit) and free_cost > 1.5 * limit and best < 0.9 * free


def trained(algorithm: str, kind: str, seed: int, folder: Path, **config: float) -> tuple[float, float]:
    """Exact return and cost of the policy that a run ends with."""
    given = problem_of(kind)
    result = run(algorithm, ProblemEnv(given), steps=STEPS, seed=seed, folder=folder / str(seed), config=config)
    return given.value(probabilities(result.policy))


@pytest.mark.slow
@pytest.mark.parametrize("kind", LIMITS)
def test_ppo_reaches_the_unconstrained_optimum(kind: str, tmp_path: Path):
    reached, cost = trained("PPO", kind, 0, tmp_path)
    assert reached >= 0.9 * problem_of(kind).optimum(np.inf)[0]
    assert cost > 1.1 * LIMITS[kind] + 0.02  # it knows no limit, and breaks the one that FOCOPS keeps


@pytest.mark.slow
@pytest.mark.parametrize("kind", LIMITS)
def test_focops_reaches_the_constrained_optimum_within_its_limit(kind: str, tmp_path: Path):
    """Where one run stops is chance: its cost swings about the limit by a fifth of it, and its return along with the
    cost. So both are means over seeds, and the return is held against the best policy of the same cost."""
    given, limit = problem_of(kind), LIMITS[kind]
    ends = [trained("FOCOPS", kind, seed, tmp_path, cost_limit=limit) for seed in SEEDS]
    reached, cost = np.mean(ends, axis=0)
    assert reached >= 0.9 * given.optimum(cost)[0]
    assert cost <= limit + max(0.1 * limit, 0.02)
    assert cost >= 0.5 * limit  # nor does it give up what the limit allows
