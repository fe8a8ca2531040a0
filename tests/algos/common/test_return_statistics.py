"""Tests of the statistics of discounted returns, by hand and by a loop over whole episodes."""

import numpy as np
import pytest

from thalweg.algos.common import return_statistics
from thalweg.algos.common.return_statistics import ReturnStatistics, returns_to_go

GAMMAS = (0.9, 0.5)


def stream(steps: int = 80, envs: int = 3, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Signals [T, N, 2], fresh, terminated, truncated and valid steps; an environment's step after an end is a reset
    alone."""
    random = np.random.default_rng(seed)
    signals = random.normal(size=(steps, envs, 2)).astype(np.float32)
    ended = random.random((steps, envs)) < 0.15
    valid = np.ones_like(ended)
    for env in range(envs):
        for step in range(1, steps):
            if ended[step - 1, env]:
                ended[step, env], valid[step, env] = False, False
    cut = ended & (random.random(ended.shape) < 0.3)
    fresh = np.concatenate([np.ones((1, envs), bool), ~valid[:-1]])
    return signals, fresh, ended & ~cut, cut, valid


def returns(
    signals: np.ndarray, fresh: np.ndarray, terminated: np.ndarray, truncated: np.ndarray, valid: np.ndarray
) -> np.ndarray:
    """Return of each step of finished episodes [K, 2], by loops; what was cut off goes on for 400 mean steps."""
    found = []
    for env in range(signals.shape[1]):
        running: list[np.ndarray] = []
        for step in range(len(signals)):
            if valid[step, env]:
                running.append(signals[step, env])
                if truncated[step, env]:
                    running.extend([np.mean(running, 0)] * 400)
                if terminated[step, env] or truncated[step, env]:
                    counted = len(running) - 400 * truncated[step, env]
                    found += [sum(np.power(GAMMAS, k) * x for k, x in enumerate(running[t:])) for t in range(counted)]
                    running = []
    return np.array(found)


def test_returns_to_go_by_hand():
    signals = np.array([[1.0, 0.0], [0.0, 0.0], [2.0, 1.0]])
    found = returns_to_go(signals, (0.5, 0.9), cut=False)
    assert found == pytest.approx(np.array([[1.5, 0.81], [1.0, 0.9], [2.0, 1.0]]))
    # cut off: 2 + 0.5 · 1 / 0.5 = 3 and 1 + 0.9 / 3 / 0.1 = 4
    found = returns_to_go(signals, (0.5, 0.9), cut=True)
    assert found == pytest.approx(np.array([[1.75, 3.24], [1.5, 3.6], [3.0, 4.0]]))
    assert returns_to_go(signals[:, :1], (1.0,), cut=True)[:, 0].tolist() == [3.0, 2.0, 2.0]


@pytest.mark.parametrize("length", [1, 7, 100])
def test_an_endless_episode_is_worth_its_reward_over_one_minus_gamma_wherever_it_is_cut_off(length: int):
    assert returns_to_go(np.ones((length, 1)), (0.9,), cut=True)[:, 0] == pytest.approx([10.0] * length)


def test_deviation_and_extremes_are_those_of_all_steps_of_finished_episodes():
    everything = stream()
    statistics = ReturnStatistics(3, GAMMAS)
    for first in range(0, 80, 7):  # episodes continue over updates of several lengths
        part = slice(first, first + 7)
        statistics.update(*(array[part] for array in everything))
    expected = returns(*everything)
    assert statistics.count == len(expected) > 60 and everything[3].sum() > 2
    assert statistics.mean == pytest.approx(expected.mean(0), abs=1e-5)
    assert statistics.deviation == pytest.approx(expected.std(0), abs=1e-5)
    reached = np.concatenate([expected, everything[0][everything[4]].astype(np.float64)])
    assert statistics.low == pytest.approx(reached.min(0), abs=1e-5)
    assert statistics.high == pytest.approx(reached.max(0), abs=1e-5)
    assert statistics.largest_step == pytest.approx(np.abs(everything[0][everything[4]]).max(0), abs=1e-6)


def test_a_running_episode_counts_by_its_single_rewards_only():
    statistics = ReturnStatistics(1, (0.5,))
    never = np.zeros((2, 1), bool)
    statistics.update(np.array([[[1.0]], [[3.0]]]), never, never, never, ~never)
    assert (statistics.count, statistics.deviation[0], statistics.high[0]) == (0, 0.0, 3.0)
    statistics.update(np.array([[[4.0]]]), never[:1], ~never[:1], never[:1], ~never[:1])
    assert (statistics.count, statistics.high[0]) == (3, 5.0)  # 4, 3 + 4 / 2, 1 + 5 / 2


def test_an_episode_that_a_new_one_replaces_is_forgotten():
    """As when a run resumes in environments that have begun anew."""
    statistics, never = ReturnStatistics(1, (0.5,)), np.zeros((2, 1), bool)
    statistics.update(np.array([[[2.0]], [[4.0]]]), never, never, never, ~never)
    fresh, ends = np.array([[True], [False]]), np.array([[False], [True]])
    statistics.update(np.array([[[1.0]], [[8.0]]]), fresh, ends, never, ~never)
    assert (statistics.count, statistics.mean[0], statistics.high[0]) == (2, 6.5, 8.0)  # 8 and 1 + 8 / 2


def test_an_episode_without_end_is_cut_off_so_that_memory_is_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(return_statistics, "LONGEST", 5)
    statistics, never = ReturnStatistics(2, (1.0,)), np.zeros((1, 2), bool)
    for _ in range(12):
        statistics.update(np.ones((1, 2, 1)), never, never, never, ~never)
        assert len(statistics.state()["recent"]) < 5
    assert (statistics.count, statistics.high[0]) == (20, 5.0)


def test_a_restored_state_continues_the_same():
    everything = stream()
    one, other = ReturnStatistics(3, GAMMAS), ReturnStatistics(3, GAMMAS)
    one.update(*(array[:13] for array in everything))
    other.load_state(one.state())
    for statistics in (one, other):
        statistics.update(*(array[13:] for array in everything))
    for name, value in one.state().items():
        assert np.array_equal(value, other.state()[name]), name
