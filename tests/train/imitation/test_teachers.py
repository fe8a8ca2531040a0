"""Tests of the worths that teachers give to each move: the steady pilot its own, the scripted one a choice."""

import numpy as np
import pytest

from tests.env import handmade
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.moves import MOVE_OPTIONS, MOVES
from thalweg.train.imitation.teachers import choice_worths, teacher_worths


def test_the_chosen_move_is_worth_nothing_less_and_all_others_one():
    climb_ahead = [0, 1, 0, 1]  # up, no turn, forward, no step aside
    found = choice_worths(np.array([climb_ahead, [1, 1, 1, 1]]))
    assert found.shape == (2, 54) and (found.max(axis=1) == 0.0).all() and (found.sum(axis=1) == -53.0).all()
    assert MOVES[found.argmax(axis=1)].tolist() == [[1, 0, 1, 0], [0, 0, 0, 0]]


def test_options_of_no_move_are_refused():
    with pytest.raises(ValueError, match=r"\[1, 1, 2, 1\] are the options of no move"):
        choice_worths(np.array([[1, 1, 0, 1], [1, 1, 2, 1]]))


def test_the_best_moves_are_those_of_the_chosen_pilot():
    env = RiverVectorEnv([handmade.ring()], 8, EnvConfig(observation="none"))
    env.reset(seed=0)
    differs = 0
    for _ in range(20):
        chosen = env.pilot_actions("scripted")
        assert np.array_equal(MOVE_OPTIONS[teacher_worths(env, "scripted").argmax(axis=1)], chosen)
        steady = teacher_worths(env, "steady")
        assert np.array_equal(steady, env.move_worths())
        differs += int((MOVE_OPTIONS[steady.argmax(axis=1)] != chosen).any(axis=1).sum())
        env.step(chosen)
    assert differs > 10
