"""The steady pilot flies every river from any start, in the middle of the channel, and its worths are what they say."""

import math

import numpy as np
import pytest

from tests.env.flights import HOVER, at
from tests.env.handmade import canal, ring
from tests.env.pilot.steady_alone import worths_alone
from tests.env.winding import river
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv
from thalweg.env.moves import MOVES
from thalweg.env.pilot.bank_view import sight_height
from thalweg.env.pilot.heights import UNBOUNDED
from thalweg.env.pilot.steady import FAILURE, HORIZON, SteadyPilot
from thalweg.env.pilot.ways import plan_ways
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.task.motion import Pose
from thalweg.env.task.progress import track_projection
from thalweg.world import level_named
from thalweg.world.bridges import bridge_across

LEVELS = ("Easy", "Medium", "Hard")
PRIVILEGED = EnvConfig(observation="privileged")
EPISODE = 500
BRIDGE = bridge_across(np.array([20.0, 0.0]), np.array([1.0, 0.0]), 8.0, 0.0, np.random.default_rng(1))[None]


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


@pytest.mark.parametrize(
    ("pose", "fatal"),
    [
        ((17.0, 0.0, 2.9, 0.0), True),  # the bridge is hit on the level and not after a climb
        ((30.0, 1.0, 14.6, 0.0), True),  # a climb leaves the band of heights
        ((30.0, 1.0, 0.9, 0.0), True),  # a descent does
        ((30.0, 0.0, 4.0, 80.0), False),  # water before the bank is in view after a descent alone
        ((20.0, 2.0, 10.5, 80.0), False),  # no water is in view for many steps, over a bridge
        ((30.0, 3.8, 4.5, 40.0), True),  # a bank that is hit at any height
        ((56.0, -1.0, 6.0, 10.0), False),  # the end of the course
    ],
)
def test_worths_of_moves_that_are_flown_together_are_those_of_each_alone(pose, fatal: bool):
    x, y, z, degrees = pose
    env = at(canal(60.0, width_m=8.0, bridges=BRIDGE), (x, y, z, math.radians(degrees)))
    worths = env.move_worths()
    assert (worths < FAILURE + HORIZON).any() == fatal
    assert worths == pytest.approx(worths_alone(env), rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("level", LEVELS)
def test_worths_on_a_river_are_those_of_each_move_alone(level: str):
    env = RiverVectorEnv([river(level, 1)], 4, EnvConfig(observation="none"))
    env.reset(seed=2)
    env.step(np.tile(HOVER, (4, 1)))
    assert env.move_worths() == pytest.approx(worths_alone(env), rel=1e-12, abs=1e-12)


def test_the_pilot_descends_to_its_height_while_it_flies():
    env = at(ring(radius_m=30.0, count=190, width_m=8.0), (30.0, 0.0, 12.0, math.radians(90.0)))
    for _ in range(9):
        env.step(env.pilot_actions("steady"))
    assert env.state.pose[0, 2] == pytest.approx(4.5, abs=0.51)
    assert env.state.visited_count[0] >= 8


@pytest.mark.parametrize("side", (1.0, -1.0))
def test_the_pilot_descends_until_it_sees_water_before_it_turns_off_a_bank(side: float):
    """Facing a bank 4 m away at 80 degrees, it sees water from 0.8 * 4 / sin 80 = 3.25 m, within half a step."""
    env = at(canal(60.0, width_m=8.0), (20.0, 0.0, 10.5, side * math.radians(80.0)))
    moves, poses = [], []
    for _ in range(20):
        moves.append(MOVES[env.move_worths()[0].argmax()].tolist())
        env.step(env.pilot_actions("steady"))
        poses.append(env.state.pose[0].copy())
    assert moves[:7] == [[-1, 0, 0, 0]] * 7
    assert [move[1] for move in moves[7:13]] == [-side] * 6
    heights = [pose[2] for pose in poses]
    assert heights[6:8] == pytest.approx([3.5, 3.5])
    assert heights[-1] == pytest.approx(4.5) and abs(poses[-1][3]) < math.radians(20.0)


@pytest.mark.parametrize("side", (1.0, -1.0))
@pytest.mark.parametrize(("height", "turn"), [(3.5, -1), (4.0, 0)])
def test_the_pilot_turns_at_once_where_it_sees_water(side: float, height: float, turn: int):
    env = at(canal(60.0, width_m=8.0), (20.0, 0.0, height, side * math.radians(80.0)))
    assert MOVES[env.move_worths()[0].argmax(), 1] == side * turn


@pytest.mark.parametrize("degrees", (56.0, 80.0))
def test_where_water_is_out_of_view_the_pilot_takes_no_side(degrees: float):
    """Every move but the descent is worth much less, even one after which no bank would be faced."""
    env = at(canal(60.0, width_m=8.0), (20.0, 2.0, 10.5, math.radians(degrees)))
    worths = env.move_worths()[0]
    down = (MOVES == [-1, 0, 0, 0]).all(axis=1)
    assert worths[down].item() - worths[~down].max() > 10.0


@pytest.mark.parametrize(("bridges", "lowest"), [(None, 1.5), (BRIDGE, 3.5)])
def test_over_a_bridge_the_pilot_descends_no_further_than_its_clearance(bridges: np.ndarray | None, lowest: float):
    """Facing a bank 2 m away it would descend to 1.6 m; the bridge ends at 3.0 m, and 0.8 m above is clear of it."""
    env = at(canal(60.0, width_m=8.0, bridges=bridges), (20.0, 2.0, 10.5, math.radians(80.0)))
    heights = []
    for _ in range(14):
        env.step(env.pilot_actions("steady"))
        heights.append(env.state.pose[0, 2])
    assert min(heights) == pytest.approx(lowest)


@pytest.mark.parametrize(
    ("pose", "travel", "height"),
    [
        ((20.0, 1.0, 9.0, 90.0), 1, 2.0 + 0.8 * 3.0),
        ((20.0, 1.0, 9.0, -60.0), 1, 2.0 + 0.8 * 5.0 / math.sin(math.radians(60.0))),
        ((20.0, 1.0, 9.0, 120.0), -1, 2.0 + 0.8 * 3.0 / math.sin(math.radians(60.0))),
        ((20.0, 3.9, 9.0, 90.0), 1, 2.0 + 0.5 + 0.8),  # the lowest that the band of heights permits, and spare
        ((20.0, 1.0, 9.0, 50.0), 1, UNBOUNDED),
        ((20.0, 1.0, 9.0, 0.0), -1, UNBOUNDED),
    ],
)
def test_water_is_seen_from_heights_worked_by_hand(pose: tuple[float, float, float, float], travel: int, height: float):
    """On a canal 8 m wide with its water at 2 m."""
    courses = pack_courses([canal(60.0, width_m=8.0, level_m=2.0)], EnvConfig())
    ways = plan_ways(courses, EnvConfig())
    x, y, z, degrees = pose
    _, projection = track_projection(courses, 0, 20, x, y)
    found = sight_height(courses, 0, projection, travel, ways, Pose(x, y, z, math.radians(degrees)))
    assert found == pytest.approx(height)


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
    with pytest.raises(ValueError, match="unknown pilot 'stedy' of the uav; known: scripted, steady"):
        env.pilot_actions("stedy")
