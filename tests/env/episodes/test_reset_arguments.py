"""Tests of what a reset is asked for: seeds, rows and poses, and what is refused before anything changes."""

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from tests.env.handmade import canal
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.episodes.reset_arguments import autoreset_mode_of, rows_and_poses, seeds_of
from thalweg.env.initial_poses import UnsafePoseError
from thalweg.env.rivers.assignment import FixedRivers

CONFIG = EnvConfig(observation="none")
SAFE, BELOW_WATER = (10.5, 0.0, 5.0, 0.0), (10.5, 0.0, -1.0, 0.0)
NOT_YET, AGAIN = np.array([False, False]), np.array([True, True])


def asked(options, started=AGAIN):
    return rows_and_poses(options, started, CONFIG, FixedRivers([canal()], 2, CONFIG))


@pytest.mark.parametrize(
    ("seed", "seeds"),
    [
        (None, [None, None, None]),
        (7, [7, 8, 9]),
        (np.int64(7), [7, 8, 9]),
        (np.array(7), [7, 8, 9]),
        ([3, None, 1], [3, None, 1]),
        (range(3), [0, 1, 2]),
        (np.array([5, 4, 3]), [5, 4, 3]),
    ],
)
def test_one_seed_gives_each_environment_its_own_and_a_list_is_taken_as_it_is(seed, seeds):
    assert list(seeds_of(seed, 3)) == seeds


@pytest.mark.parametrize("seed", ["7", 1.5, -1, [1, 2], [1, 2, -3]])
def test_other_seeds_are_refused(seed):
    with pytest.raises(ConfigError, match="seed"):
        seeds_of(seed, 3)


@pytest.mark.parametrize("seeds", [{0: 1, 1: 2, 2: 3}, {0: 1, 1: 2, 2: 3}.values(), {7, 8, 9}, b"abc"], ids=repr)
def test_seeds_without_an_order_of_their_own_are_refused(seeds):
    with pytest.raises(ConfigError, match="seed must be a number or a list of one for each environment, not"):
        seeds_of(seeds, 3)


@pytest.mark.parametrize("given", ["same_step", "SAME_STEP", "SameStep", AutoresetMode.SAME_STEP])
def test_an_autoreset_mode_is_known_by_itself_its_name_and_its_value(given):
    assert autoreset_mode_of(given) is AutoresetMode.SAME_STEP


def test_a_mask_selects_the_rows_and_no_options_select_all():
    assert asked(None) == ([0, 1], None)
    assert asked({"reset_mask": np.array([False, True])}) == ([1], None)


def test_one_pose_serves_all_environments():
    rows, poses = asked({"pose": SAFE})
    assert rows == [0, 1] and poses is not None and poses.tolist() == [list(SAFE), list(SAFE)]


def test_only_the_poses_of_rows_that_are_reset_must_be_safe():
    poses = np.array([BELOW_WATER, SAFE])
    rows, _ = asked({"pose": poses, "reset_mask": np.array([False, True])})
    assert rows == [1]
    with pytest.raises(UnsafePoseError):
        asked({"pose": poses})


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"poses": SAFE}, ConfigError, "poses"),
        ([1], ConfigError, r"options must be a mapping such as \{'pose': \[x, y, z, yaw\]\}, not \[1\]"),
        ("", ConfigError, "options must be a mapping"),
        ({"pose": SAFE[:3]}, ConfigError, r"shape \(3,\); needed: \(4,\) or \(2, 4\)"),
        ({"pose": [*SAFE[:3], [0.0]]}, ConfigError, r"pose is \[10.5, 0.0, 5.0, \[0.0\]\], no array of numbers"),
        ({"reset_mask": np.array([True])}, ConfigError, r"reset_mask must be \[2\] bool, got \[1\] bool"),
        ({"reset_mask": [1, 0]}, ConfigError, r"reset_mask must be \[2\] bool, got \[2\] int64"),
        ({"reset_mask": np.zeros(2, bool)}, ConfigError, "at least one True, got 2 times False"),
        ({"reset_mask": np.array([True, False])}, ResetNeeded, "every environment"),
    ],
)
def test_other_options_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        asked(options, NOT_YET)
