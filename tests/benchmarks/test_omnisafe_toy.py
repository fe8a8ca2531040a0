"""Tests of the toy of the comparison with OmniSafe, with values computed by hand."""

import ast
from pathlib import Path

import numpy as np
import pytest

from benchmarks.omnisafe import toy
from benchmarks.omnisafe.toy import Toy
from benchmarks.omnisafe.toy_vector import ToyVectorEnv
from thalweg.train.rollouts.env_stepper import EnvStepper

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "omnisafe"


def at(position: list[float], wind: list[float]) -> Toy:
    """Return one environment at the given position and wind, without gusts."""
    one = Toy(1)
    one.begin(np.array([0]))
    one.position[:], one.wind[:], one._gusts[:] = position, wind, 0.0
    return one


def test_a_step_has_the_values_computed_by_hand():
    one = at([0.0, 0.5, -0.95, 0.9], [1.0, 0.0, -1.0, 0.0])
    one._lots[:] = 1.0
    reward, cost, terminated, truncated = one.step(np.array([[1.0, -0.5, -1.0, 9.0]]))
    # The wind keeps 0.9 of itself; 0.15 a + 0.06 w is added; 9 counts as 1; the third and fourth stop at the walls.
    np.testing.assert_allclose(one.position, [[0.204, 0.425, -1.0, 1.0]])
    height = (1 + (0.204 + 0.425 - 1.0 + 1.0) / 4) / 2
    np.testing.assert_allclose(reward, [0.1 * height**2])
    assert (cost[0], terminated[0], truncated[0]) == (0.0, False, False)
    chance = ((height - 0.4) / 0.6) ** 2
    expected = [0.204, 0.425, -1, 1, 0.9, 0, -0.9, 0, 1, -0.5, -1, 1, height, height**2, chance, 0.01]
    np.testing.assert_allclose(one.observations(), [expected], rtol=1e-6)


@pytest.mark.parametrize(("height", "chance"), [(0.0, 0.0), (0.4, 0.0), (0.7, 0.007 / 4), (1.0, 0.007)])
def test_the_probability_of_a_fall(height: float, chance: float):
    assert toy.chance_at(np.array(height)) == pytest.approx(chance)


@pytest.mark.parametrize(("lot", "falls"), [(0.0069, True), (0.0071, False)])
def test_at_the_top_a_lot_below_the_risk_is_a_fall_that_costs_1_and_ends_the_episode(lot: float, falls: bool):
    one = at([1.0] * 4, [0.0] * 4)
    one._lots[:] = lot
    reward, cost, terminated, _ = one.step(np.ones((1, 4)))
    assert (reward[0], cost[0], bool(terminated[0])) == (pytest.approx(0.1), float(falls), falls)


@pytest.mark.parametrize("falls_at_last", [True, False])
def test_an_episode_is_truncated_at_its_length_unless_its_last_step_is_a_fall(falls_at_last: bool):
    one = at([1.0] * 4, [0.0] * 4)
    one._lots[:], one._lots[0, -1] = 1.0, 0.0 if falls_at_last else 1.0
    ends = [one.step(np.ones((1, 4)))[2:] for _ in range(toy.LENGTH)]
    assert not np.any(ends[:-1])
    assert [bool(end[0]) for end in ends[-1]] == [falls_at_last, not falls_at_last]


def test_each_of_many_environments_equals_one_alone():
    seeds, actions = [3, 7, 1 << 30], np.random.default_rng(0).uniform(-1.5, 1.5, (250, 3, 4))
    actions += 0.7  # upwards, so that some fall
    env = ToyVectorEnv(3)
    first, _ = env.reset(seed=seeds)
    together = [env.step(action) for action in actions]
    lengths = set()
    for row, seed in enumerate(seeds):
        one = Toy(1)
        one.seed([seed])
        one.begin(np.array([0]))
        np.testing.assert_array_equal(one.observations()[0], first[row])
        length = 0
        for step, (obs, reward, terminated, truncated, info) in enumerate(together):
            mine = one.step(actions[step, row][None])
            assert [part[0] for part in mine] == [reward[row], info["cost"][row], terminated[row], truncated[row]]
            length += 1
            if terminated[row] or truncated[row]:
                np.testing.assert_array_equal(one.observations()[0], info["final_obs"][row])
                assert info["_final_obs"][row]
                one.begin(np.array([0]))
                lengths.add(length)
                length = 0
            np.testing.assert_array_equal(one.observations()[0], obs[row])
    assert toy.LENGTH in lengths and len(lengths) > 1


def test_a_single_seed_is_incremented_and_other_seeds_differ():
    env, other = ToyVectorEnv(3), ToyVectorEnv(3)
    np.testing.assert_array_equal(env.reset(seed=5)[0], other.reset(seed=[5, 6, 7])[0])
    assert not np.isclose(env.reset(seed=5)[0][:, :4], other.reset(seed=8)[0][:, :4]).any()


def test_a_restored_state_continues_with_the_same_numbers():
    env, actions = ToyVectorEnv(4), np.random.default_rng(1).uniform(-1, 1, (130, 4, 4)) + 0.5
    env.reset(seed=2)
    for action in actions[:40]:
        env.step(action)
    state = env.get_state()
    before = [env.step(action)[:2] for action in actions]
    fresh = ToyVectorEnv(4)
    fresh.set_state(state)
    after = [fresh.step(action)[:2] for action in actions]
    np.testing.assert_array_equal([obs for obs, _ in before], [obs for obs, _ in after])
    np.testing.assert_array_equal([reward for _, reward in before], [reward for _, reward in after])


def policy(target: float, obs: np.ndarray) -> np.ndarray:
    """Return actions [N, 4] that keep all coordinates at `target` against the wind."""
    return (target - obs[:, :4] - toy.BREEZE * toy.LASTING * obs[:, 4:8]) / toy.PUSH


def worth(target: float, count: int = 256) -> tuple[float, float]:
    """Return the mean return and cost of an episode under `policy`; each environment plays one."""
    env = ToyVectorEnv(count)
    obs, _ = env.reset(seed=0)
    total, cost, alive = np.zeros(count), np.zeros(count), np.ones(count, bool)
    for _ in range(toy.LENGTH):
        obs, reward, terminated, truncated, info = env.step(policy(target, obs))
        total, cost = total + reward * alive, cost + info["cost"] * alive
        alive &= ~(terminated | truncated)
    return float(total.mean()), float(cost.mean())


def test_return_and_cost_grow_with_the_height_and_the_limit_binds_in_between():
    low, middle, top = (worth(target) for target in (-0.2, 0.25, 1.0))
    assert low[0] < 2.0 and low[1] < 0.02
    assert 3.0 < middle[0] < 4.5 and 0.05 < middle[1] < 0.15
    assert top[0] > 6.0 and 0.35 < top[1] < 0.6


def test_the_trainer_reads_costs_and_final_observations():
    stream = EnvStepper(ToyVectorEnv(8))
    obs, costs, finals = stream.reset(seed=0), 0.0, []
    for _ in range(300):
        step = stream.step(policy(1.0, obs))
        obs, costs = step.next_obs, costs + step.cost.sum()
        finals += list(step.final_obs[~step.terminated[step.finished], 15])
    assert costs > 3
    assert finals and set(np.round(finals, 6)) == {1.0}  # the share of the episode that has passed


@pytest.mark.parametrize("script", ["toy.py", "side.py"])
def test_scripts_of_the_peer_import_nothing_of_thalweg(script: str):
    tree = ast.parse((FOLDER / script).read_text())
    names = {
        name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
    }
    assert not names & {"thalweg", "benchmarks"}
    assert script != "toy.py" or names == {"numpy"}
