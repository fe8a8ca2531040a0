"""Tests that the environment follows the tables of its problem."""

import numpy as np
import pytest

from tests.known_answer.envs import SPACES, ProblemEnv, SpaceName, joint
from tests.known_answer.problems import ACTIONS, PROBLEMS, WAYS
from tests.known_answer.solutions import outcome
from thalweg.train.rollouts.env_stepper import EnvStepper


def as_taken(actions: np.ndarray, space: SpaceName) -> np.ndarray:
    """What the environment is given for actions 0..8 [N]."""
    pair = np.stack([actions // WAYS, actions % WAYS], 1)
    return {"discrete": actions, "multidiscrete": pair, "box": 0.7 * (pair - 1)}[space]


@pytest.mark.parametrize("space", SPACES)
def test_every_action_can_be_taken_in_every_space(space: SpaceName):
    actions = np.arange(ACTIONS)
    assert joint(as_taken(actions, space), space).tolist() == actions.tolist()


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_exact_outcome_agrees_with_the_environment(name: str):
    problem, generator = PROBLEMS[name], np.random.default_rng(0)
    policy = generator.dirichlet(np.ones(ACTIONS), problem.states)
    env = ProblemEnv(problem, 2000)
    stream = EnvStepper(env)
    obs = stream.reset(0)
    reward, costs, episodes = 0.0, np.zeros(problem.kinds), 0
    for _ in range(300):
        draw = generator.random((env.num_envs, 1))
        action = (draw >= policy[obs.argmax(1)].cumsum(1)).sum(1).clip(max=ACTIONS - 1)
        step = stream.step(as_taken(action, "multidiscrete"))
        paid = step.cost[:, None] if step.costs is None else step.costs
        reward, costs, episodes = reward + step.reward.sum(), costs + paid.sum(0), episodes + len(step.finished)
        obs = step.next_obs
    exact = outcome(problem, policy)
    assert (reward / episodes, *(costs / episodes)) == pytest.approx((exact.reward, *exact.costs), rel=0.03)


def test_a_deadly_cost_ends_the_episode():
    env = ProblemEnv(PROBLEMS["end"], 500, "discrete")
    env.reset(seed=0)
    for _ in range(20):
        _, _, ended, _, info = env.step(np.full(500, 8))
        assert ended[info["cost"] > 0].all()


def test_two_costs_come_apart_and_summed():
    env = ProblemEnv(PROBLEMS["two"], 500, "discrete")
    env.reset(seed=0)
    infos = [env.step(np.full(500, 8))[-1] for _ in range(20)]
    assert all((info["costs"].sum(1) == info["cost"]).all() for info in infos)
    assert (np.sum([info["costs"].sum(0) for info in infos], axis=0) > 0).all()


def test_a_restored_environment_continues_as_before():
    env = ProblemEnv(PROBLEMS["dense"], 8, "discrete")
    env.reset(seed=3)
    kept = env.get_state()
    first = [env.step(np.full(8, 8))[0] for _ in range(30)]
    env.set_state(kept)
    assert np.array_equal(first, [env.step(np.full(8, 8))[0] for _ in range(30)])
