"""The steady pilot flies every river from any start, in the middle of the channel, and its worths are what they say."""

import math

import numpy as np
import pytest

from tests.env.flights import at
from tests.env.handmade import canal, ring
from tests.env.winding import river
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.pilot.steady import FAILURE, HORIZON, MOVES, SteadyPilot
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.rivers.river_list import RiverList
from thalweg.world import level_named

LEVELS = ("Easy", "Medium", "Hard")
PRIVILEGED = EnvConfig(observation="privileged")
EPISODE = 500


def flown(worlds, num_envs: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(return, done reason, and privileged observations of each step [steps, N, F]) of one episode per environment."""
    env = RiverVectorEnv(worlds, num_envs, PRIVILEGED)
    seen, _ = env.reset(seed=seed)
    returns, reasons, observations = np.zeros(num_envs), np.full(num_envs, -1), []
    for _ in range(EPISODE):
        observations.append(seen)
        seen, reward, _, _, info = env.step(env.pilot_actions("steady"))
        returns += np.where(reasons < 0, reward, 0.0)
        reasons = np.where(reasons < 0, info["done_reason"], reasons)
        if (reasons >= 0).all():
            break
    return returns, reasons, np.array(observations)


@pytest.mark.parametrize("level", LEVELS)
def test_the_pilot_finishes_every_level_from_random_starts(level: str):
    returns, reasons, _ = flown([river(level, 1)], 12, seed=0)
    assert set(reasons) == {DoneReason.SUCCESS}
    assert returns == pytest.approx(np.full(12, 10.0))


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_the_pilot_finishes_three_hundred_rivers_of_each_level(level: str):
    worlds = [load_or_plan(level_named(level), seed) for seed in range(3000, 3300)]
    returns, reasons, _ = flown(worlds, len(worlds), seed=0)
    failed = {3000 + int(row): DoneReason(reasons[row]).label for row in np.flatnonzero(reasons != DoneReason.SUCCESS)}
    assert not failed
    assert returns == pytest.approx(np.full(len(worlds), 10.0))


def test_the_pilot_is_steady():
    """After the first steps it looks along the course, at its height and far from the banks, on most of its way."""
    _, _, seen = flown([river("Medium", 1)], 8, seed=0)
    heading, left, right, height = (seen[15:250, :, index] for index in range(4))
    assert np.percentile(np.abs(heading), 95) < math.radians(20.0)
    assert np.percentile(height, 5) > 3.9 and np.percentile(height, 95) < 5.1
    share = np.minimum(left, right) / (0.5 * (left + right))
    assert np.median(share) > 0.7


def test_a_move_into_the_bank_is_fatal_and_a_move_off_it_is_not():
    env = at(canal(width_m=6.0), (20.0, 2.8, 4.5, 0.0))
    worths = env.move_worths()[0]
    aside = MOVES[:, 3] == 1  # to the left, over the bank
    straight = (MOVES[:, 1] == 0) & (MOVES[:, 0] == 0)
    assert (worths[straight & aside] == FAILURE).all()
    assert (worths[straight & ~aside] > FAILURE + HORIZON).all()
    assert MOVES[worths.argmax()].tolist() == [0, -1, 1, -1]  # off the bank, and towards the middle


def test_straight_ahead_in_mid_channel_is_worth_one_segment_a_step():
    """On a straight canal, with a sample each metre and on the route, nothing is unsteady."""
    env = at(canal(60.0, width_m=8.0), (20.0, 0.0, 4.5, 0.0))
    worths = dict(zip(map(tuple, MOVES.tolist()), env.move_worths()[0], strict=True))
    assert worths[0, 0, 1, 0] == pytest.approx(HORIZON)
    assert worths[0, 0, 0, 0] == pytest.approx(HORIZON - 1 - 0.5)
    # A climb of a metre is taken back in the next step: two efforts, and one step that ends a metre too high.
    assert worths[1, 0, 1, 0] == pytest.approx(HORIZON - 2 * 0.05 - 0.3)


def test_the_pilot_descends_to_its_height_while_it_flies():
    env = at(ring(radius_m=30.0, count=190, width_m=8.0), (30.0, 0.0, 12.0, math.radians(90.0)))
    for _ in range(9):
        env.step(env.pilot_actions("steady"))
    assert env.state.pose[0, 2] == pytest.approx(4.5, abs=0.51)
    assert env.state.visited_count[0] >= 8


def test_worths_in_changing_rivers_are_those_in_each_river_alone():
    rivers = RiverList.of_levels([("Medium", range(4, 11))], in_memory=6)
    env = RiverVectorEnv(rivers, 2, EnvConfig(observation="none"))
    env.reset(seed=3)
    met = set()
    for _ in range(8):
        env.reset()
        worths = env.move_worths()
        for row, index in enumerate(env.rivers.state()["river"]):
            met.add(int(index))
            alone = RiverVectorEnv([rivers.course(int(index))], 1, EnvConfig(observation="none"))
            alone.reset(seed=0, options={"pose": env.state.pose[row]})
            assert np.array_equal(alone.move_worths()[0], worths[row])
    env.close()
    assert len(met) == 7


def test_the_pilot_takes_the_move_of_the_greatest_worth():
    env = RiverVectorEnv([ring()], 5, EnvConfig(observation="none", action="continuous"))
    env.reset(seed=1)
    best = MOVES[env.move_worths().argmax(axis=1)]
    assert np.array_equal(env.pilot_actions("steady"), best)
    pilot = SteadyPilot(env.courses, env.config)
    assert np.array_equal(pilot.unit_actions(env.state), best)


def test_an_unknown_pilot_is_an_error():
    env = RiverVectorEnv([ring()], 1, EnvConfig(observation="none"))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="unknown pilot 'stedy'; known: scripted, steady"):
        env.pilot_actions("stedy")
