"""Tests of how episodes begin."""

import numpy as np

from tests.env.handmade import BlankRenderer, canal
from thalweg.env.config import EnvConfig
from thalweg.env.episodes.episodes import Episodes
from thalweg.env.forces.of_many import ForcesOfMany
from thalweg.env.frame_renderer import FrameRenderer
from thalweg.env.observer import Observer
from thalweg.env.rivers.assignment import FixedRivers

CONFIG = EnvConfig(observation="none")
AT = np.array([10.5, 0.0, 5.0, np.pi])


def episodes(num_envs: int = 2) -> Episodes:
    """Episodes in a canal of 60 m along x, none of which has begun."""
    rivers, frames = (
        FixedRivers([canal()], num_envs, CONFIG),
        FrameRenderer([canal()], num_envs, CONFIG, BlankRenderer()),
    )
    return Episodes(CONFIG, rivers, frames, Observer(CONFIG, frames, num_envs), ForcesOfMany(CONFIG, num_envs))


def test_an_episode_begins_at_the_pose_with_nothing_visited():
    made = episodes()
    made.state.steps[:], made.state.idle[:], made.state.visited[:] = 7, 7, 1
    made.ended[:] = True
    made.reseed(1, np.random.default_rng(3))
    made.begin(1, AT)
    assert made.state.pose[1].tolist() == AT.tolist()
    assert made.state.travel[1] == -1 and made.state.segment[1] == 10
    assert made.state.steps.tolist() == made.state.idle.tolist() == [7, 0]
    assert made.state.visited.sum(axis=1).tolist() == [made.state.visited.shape[1], 0]
    assert made.started.tolist() == [False, True] and made.ended.tolist() == [True, False]


def test_a_random_beginning_is_that_of_the_generator_whatever_the_row():
    first, second = episodes(1), episodes(3)
    first.reseed(0, np.random.default_rng(5))
    second.reseed(2, np.random.default_rng(5))
    first.begin(0)
    second.begin(2)
    for name in ("pose", "time_s", "segment", "travel"):
        assert np.array_equal(getattr(first.state, name)[0], getattr(second.state, name)[2])
    assert first.generators[0].random() == second.generators[2].random()  # pyright: ignore[reportOptionalMemberAccess]
