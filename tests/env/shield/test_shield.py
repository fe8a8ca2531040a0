"""The shield: it keeps vehicles over water, replaces as little as it must, and refuses what it cannot judge."""

import math
from typing import Any

import numpy as np
import pytest

from tests.env.shield.channel import Channel, straight
from thalweg.env import EnvConfig
from thalweg.env.config import ConfigError
from thalweg.env.moves import MOVE_OPTIONS
from thalweg.env.shield.config import ShieldConfig
from thalweg.env.shield.moves import DEAD_END, HEIGHT, LAND, PERMITTED, TURN, Vehicles, advance
from thalweg.env.shield.shield import Shield
from thalweg.env.shield.water_map import CELL_M
from thalweg.env.spaces import ActionError, to_unit_actions
from thalweg.env.task.motion import Pose, UnitAction, move
from thalweg.render import Camera
from thalweg.render.optics.lens import Lens

STAY, FORWARD, LEFT, CLIMB, DESCEND = (1, 1, 1, 1), (1, 1, 0, 1), (1, 1, 1, 0), (0, 1, 1, 1), (2, 1, 1, 1)
TURN_LEFT, UP_FORWARD = (1, 0, 1, 1), (0, 1, 0, 1)
LIMITS = EnvConfig().limits
ROW = np.zeros(1, np.int64)


class Flight:
    """A vehicle under the shield in a channel, whose true pose is known here."""

    def __init__(self, channel: Channel, pose: tuple[float, float, float, float], **settings: Any) -> None:
        self.channel, self.pose = channel, Pose(*pose)
        self.shield = Shield(1, settings=ShieldConfig(**settings))
        self.verdicts: list[int] = []

    def step(self, action: tuple[int, ...], log_probs: np.ndarray | None = None) -> tuple[int, ...]:
        """Propose a move; returns the one that was made."""
        mask = self.channel.mask(np.array(self.pose))[None]
        made, verdicts = self.shield.screen(ROW, mask, np.array([self.pose.z]), np.array([action]), log_probs)
        self.pose = move(self.pose, UnitAction(*to_unit_actions("multidiscrete", made, 1)[0]), LIMITS)
        self.verdicts.append(int(verdicts[0]))
        return tuple(int(option) for option in made[0])


def probabilities(action: tuple[int, ...], *, forward: float) -> np.ndarray:
    """Return logarithmic probabilities [1, 4, 3] that prefer an action; `forward`: how much more it prefers to fly
    forward than not to, and three more than any other option."""
    log_probs = np.full((1, 4, 3), -3.0)
    log_probs[0, np.arange(4), action] = 0.0
    log_probs[0, 2] = (0.0, -forward, -9.0)
    return log_probs


@pytest.mark.parametrize("lookahead", [0, 2])
@pytest.mark.parametrize("action", [LEFT, (1, 1, 0, 0), (1, 0, 0, 1), (1, 0, 0, 0), (1, 2, 0, 2)])
def test_no_policy_leaves_a_straight_channel(action: tuple[int, ...], lookahead: int):
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0), lookahead=lookahead)
    for _ in range(24):  # it sees the banks first, also those that it turns back to
        flight.step(FORWARD)
    for _ in range(300):
        flight.step(action)
        assert abs(flight.pose.y) < 4.0
    assert LAND in flight.verdicts


def test_random_moves_never_leave_a_channel_that_was_seen():
    rng = np.random.default_rng(1)
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0))
    for _ in range(6):
        flight.step(FORWARD)
    for _ in range(400):
        before = flight.pose
        flight.step(tuple(MOVE_OPTIONS[rng.integers(len(MOVE_OPTIONS))]))
        assert abs(flight.pose.y) < 4.0 and 0.8 <= flight.pose.z <= 14.7
        assert flight.pose.z >= 3.5 or flight.pose.z > before.z or flight.pose[:2] == before[:2]
    assert {LAND, HEIGHT} <= set(flight.verdicts)


def test_without_memory_the_same_policy_leaves_the_channel():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0))
    for _ in range(8):
        flight.step(FORWARD)
        flight.shield.begin(ROW)
    for _ in range(10):
        flight.step(LEFT)
        flight.shield.begin(ROW)
    assert flight.pose.y > 4.0


def test_odometry_is_exact_over_hundreds_of_steps():
    rng = np.random.default_rng(2)
    flight = Flight(Channel(lambda x, y: np.full(x.shape, True)), (7.0, -3.0, 5.0, 2.0))
    for _ in range(400):
        flight.step(tuple(MOVE_OPTIONS[rng.integers(len(MOVE_OPTIONS))]))
    x, y, _, yaw = flight.shield.vehicles.pose[0]
    cos, sin = math.cos(2.0), math.sin(2.0)
    assert np.allclose((7.0 + x * cos - y * sin, -3.0 + x * sin + y * cos), flight.pose[:2], atol=1e-9)
    assert math.cos(yaw + 2.0 - flight.pose.yaw) == pytest.approx(1.0)
    assert math.hypot(x, y) > 20.0


def test_a_permitted_move_is_kept_and_so_is_one_backward():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0))
    assert flight.step((1, 0, 0, 2)) == (1, 0, 0, 2)
    assert flight.step((1, 1, 2, 1)) == (1, 1, 2, 1)
    assert flight.verdicts == [PERMITTED, PERMITTED]


def towards_a_bank(**settings: Any) -> Flight:
    """A flight up to a bank that lies across it, 10 m ahead of the start."""
    flight = Flight(Channel(lambda x, y: x < 10.0), (0.0, 0.0, 5.0, 0.0), **settings)
    for _ in range(9):
        flight.step(FORWARD)
    return flight


def test_a_bank_ahead_stops_the_vehicle():
    flight = towards_a_bank(lookahead=0, margin_m=0.0)
    assert 8.9 < flight.pose.x < 10.0
    flight.step(FORWARD)
    assert flight.verdicts[-1] == LAND and flight.pose.x < 10.0


def test_the_margin_is_kept():
    flight = towards_a_bank(lookahead=0, margin_m=2.0)
    assert flight.pose.x < 8.3 and LAND in flight.verdicts


def test_a_dead_end_is_seen_before_it_is_reached():
    near, far = towards_a_bank(lookahead=0), towards_a_bank(lookahead=3)
    assert far.pose.x < near.pose.x - 0.9
    assert DEAD_END in far.verdicts and DEAD_END not in near.verdicts


def test_a_veto_takes_the_most_probable_permitted_move():
    aside, turning = (1, 1, 0, 0), (1, 0, 0, 1)
    flight = towards_a_bank(lookahead=0)
    assert flight.step(aside, probabilities(aside, forward=1.0)) == LEFT
    assert flight.step(turning, probabilities(turning, forward=1.0)) == TURN_LEFT
    assert flight.verdicts[-2:] == [LAND, LAND]


def test_without_probabilities_a_veto_changes_the_move_least():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0), lookahead=0)
    for _ in range(6):
        flight.step(FORWARD)
    while flight.verdicts[-1] == PERMITTED:
        made = flight.step((1, 1, 0, 0))
    assert flight.verdicts[-1] == LAND
    assert made[2] == 0  # it still flies forward


def beyond_the_edge(patience: int) -> float:
    """How far a vehicle comes that sees nothing but what lies beyond the water's edge."""
    flight = Flight(Channel(lambda x, y: x < 3.0), (0.0, 0.0, 5.0, 0.0), patience=patience)
    for _ in range(60):
        flight.step(FORWARD)
    assert flight.verdicts[:3] == [PERMITTED] * 3  # the ground that the camera does not see is unknown
    assert LAND in flight.verdicts
    return math.hypot(flight.pose.x, flight.pose.y)


def test_what_may_be_a_bridge_holds_the_vehicle_for_a_while_only():
    assert beyond_the_edge(patience=1000) < 6.0
    assert beyond_the_edge(patience=5) > 12.0


def test_a_fast_step_that_is_not_made_counts_as_a_move_forward_and_one_that_is_made_resets_the_count():
    limits = EnvConfig(task="Swimmers").limits
    vehicles = Vehicles(np.zeros((1, 4)), np.zeros((1, 2)), np.array([3]))
    fast, stay = (UnitAction(0.0, 0.0, forward, 0.0) for forward in (-1.0, 0.0))
    advance(vehicles, 0, limits, fast, LAND, stay)
    assert vehicles.held[0] == 4 and vehicles.pose[0, 0] == 0.0
    advance(vehicles, 0, limits, fast, PERMITTED, fast)
    assert vehicles.held[0] == 0 and vehicles.pose[0, 0] == 2.0


def test_a_move_backward_is_none_forward():
    limits = EnvConfig(allow_backward=True).limits
    vehicles = Vehicles(np.zeros((1, 4)), np.zeros((1, 2)), np.array([3]))
    back, stay = (UnitAction(0.0, 0.0, forward, 0.0) for forward in (-1.0, 0.0))
    advance(vehicles, 0, limits, back, LAND, stay)
    advance(vehicles, 0, limits, back, PERMITTED, back)
    assert vehicles.held[0] == 3 and vehicles.pose[0, 0] == -1.0


def test_land_beyond_water_holds_the_vehicle_for_good():
    flight = towards_a_bank(lookahead=0, patience=3)
    for _ in range(30):
        flight.step(FORWARD)
    assert flight.pose.x < 10.0 and flight.verdicts[-30:] == [LAND] * 30


def test_heights_have_a_floor_and_a_ceiling():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 14.5, 0.0))
    assert flight.step(CLIMB) == STAY
    assert flight.step(DESCEND) == DESCEND
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 1.0, 0.0))
    assert flight.step(CLIMB) == CLIMB
    assert flight.step(DESCEND) == DESCEND
    assert flight.step(DESCEND) == STAY and flight.verdicts[-1] == HEIGHT  # the rules allow no less than 0.5 m


def test_what_would_climb_too_high_flies_on_level_whatever_the_policy_thinks_of_descending():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 14.5, 0.0))
    odds = probabilities(UP_FORWARD, forward=0.1)
    odds[0, 0, DESCEND[0]] = -1.0
    assert flight.step(UP_FORWARD, odds) == FORWARD and flight.verdicts[-1] == HEIGHT


def low(z: float, **settings: Any) -> Flight:
    return Flight(Channel(straight(4.0)), (0.0, 0.0, z, 0.0), **settings)


def test_below_the_floor_moves_across_climb_and_only_others_descend():
    flight = low(4.0)
    assert flight.step(DESCEND) == DESCEND and flight.step(TURN_LEFT) == TURN_LEFT
    assert flight.step(FORWARD) == UP_FORWARD and flight.verdicts[-1] == HEIGHT
    assert low(4.0).step((2, 0, 0, 2)) == (1, 0, 0, 2)  # which stays above the floor
    assert low(2.0, floor_m=0.0).step(FORWARD) == FORWARD


def test_what_is_vetoed_for_its_height_goes_on_forward_whatever_the_policy_thinks_of_climbing():
    flight = low(1.0)
    for _ in range(3):
        assert flight.step(FORWARD, probabilities(FORWARD, forward=0.1)) == UP_FORWARD
    assert flight.shield.vehicles.held[0] == 0


def test_nothing_descends_under_the_floor_beside_what_may_be_a_bridge():
    assert low(4.0).step(DESCEND) == DESCEND
    for metres, made in ((0.9, STAY), (1.5, DESCEND)):
        flight = low(4.0)
        cell = int(metres / CELL_M)
        flight.shield.maps.veiled[0, cell - 1 : cell + 2, :] = 1
        assert flight.step(DESCEND) == made, metres


@pytest.mark.parametrize(("task", "made"), [("River", STAY), ("Swimmers", FORWARD)])
def test_the_dead_third_option_forward_has_the_effect_of_the_second(task: str, made: tuple[int, ...]):
    flight = Flight(Channel(straight(4.0)), (0.0, 3.5, 5.0, 0.0))
    flight.shield.config = EnvConfig(task=task)
    for _ in range(6):
        flight.step(FORWARD)
    log_probs = probabilities(LEFT, forward=0.0)
    log_probs[0, 2] = np.log([0.3, 0.2, 0.5])
    assert flight.step((1, 1, 2, 0), log_probs) == made and flight.verdicts[-1] == LAND


def test_the_vehicle_may_not_turn_from_the_way_flown():
    flight = Flight(Channel(lambda x, y: np.full(x.shape, True)), (0.0, 0.0, 5.0, 0.0), max_turn_deg=80.0)
    for _ in range(4):
        flight.step(FORWARD)
    for _ in range(12):
        flight.step(TURN_LEFT)
    assert math.degrees(flight.pose.yaw) == pytest.approx(80.0)
    assert flight.verdicts[-4:] == [TURN] * 4
    assert flight.step((1, 2, 1, 1)) == (1, 2, 1, 1)


def test_before_the_way_is_known_the_vehicle_may_turn():
    flight = Flight(Channel(lambda x, y: np.full(x.shape, True)), (0.0, 0.0, 5.0, 0.0))
    for _ in range(12):
        flight.step(TURN_LEFT)
    assert set(flight.verdicts) == {PERMITTED}


def test_unknown_cells_can_be_closed():
    flight = Flight(Channel(straight(4.0)), (0.0, 0.0, 5.0, 0.0), unknown_is_water=False)
    assert flight.step(FORWARD) != FORWARD
    assert flight.verdicts == [LAND]


def test_vehicles_do_not_depend_on_one_another():
    channel, rng = Channel(straight(4.0)), np.random.default_rng(3)
    both, alone = Shield(2), Shield(1)
    poses = [Pose(0.0, 0.0, 5.0, 0.0), Pose(0.0, 1.0, 6.0, 0.2)]
    for _ in range(40):
        actions = MOVE_OPTIONS[rng.integers(len(MOVE_OPTIONS), size=2)]
        masks = np.stack([channel.mask(np.array(pose)) for pose in poses])
        heights = np.array([pose.z for pose in poses])
        made, _ = both.screen(np.arange(2), masks, heights, actions)
        single, _ = alone.screen(ROW, masks[1:], heights[1:], actions[1:])
        assert (made[1] == single[0]).all()
        units = to_unit_actions("multidiscrete", made, 2)
        poses = [move(pose, UnitAction(*unit), LIMITS) for pose, unit in zip(poses, units, strict=True)]


def test_bad_input_is_refused():
    shield, mask = Shield(1), np.zeros((1, 128, 128), np.uint8)
    with pytest.raises(ConfigError, match=r"1 vehicles need masks uint8 \[1, H, W\] .* got float64 \[1, 128, 128\]"):
        shield.screen(ROW, mask.astype(float), np.ones(1), np.array([STAY]))
    with pytest.raises(ConfigError, match=r"heights \[1\], got uint8 \[1, 128, 128\] and \[2\]"):
        shield.screen(ROW, mask, np.ones(2), np.array([STAY]))
    with pytest.raises(ConfigError, match=r"1 vehicles need log_probs \[1, 4, 3\], got \[4, 3\]"):
        shield.screen(ROW, mask, np.ones(1), np.array([STAY]), np.zeros((4, 3)))
    with pytest.raises(ActionError, match="action 3 of environment 0"):
        shield.screen(ROW, mask, np.ones(1), np.array([[1, 1, 1, 3]]))
    with pytest.raises(ConfigError, match="multidiscrete"):
        Shield(1, EnvConfig(action="continuous"))
    with pytest.raises(ConfigError, match="count must be a whole number of at least 1"):
        Shield(0)
    with pytest.raises(ConfigError, match="margin_m"):
        ShieldConfig(margin_m=-1.0)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([2], r"different numbers from 0 to 1, not \[2\]"),
        ([-1], r"different numbers from 0 to 1, not \[-1\]"),
        ([1, 1], r"different numbers from 0 to 1, not \[1, 1\]"),
        ([2**63], "different numbers from 0 to 1"),
        ([False, True], r"not bool \[2\]: give np.flatnonzero\(mask\) for a mask"),
        ([1.0], r"whole numbers \[K\], not float64 \[1\]"),
        ([[0]], r"whole numbers \[K\], not int64 \[1, 1\]"),
        (0, r"whole numbers \[K\], not int64 \[\]"),
    ],
)
def test_rows_of_no_vehicle_are_refused_before_anything_changes(rows: Any, message: str):
    shield = Shield(2)
    shield.vehicles.pose[:] = 3.0
    rows = np.array(rows)
    masks, heights = np.zeros((rows.size, 128, 128), np.uint8), np.ones(rows.size)
    with pytest.raises(ConfigError, match=message):
        shield.screen(rows, masks, heights, np.array([STAY] * rows.size))
    with pytest.raises(ConfigError, match=message):
        shield.begin(rows)
    assert (shield.vehicles.pose == 3.0).all() and (shield.maps.corner == Shield(1).maps.corner).all()


@pytest.mark.parametrize("height", [np.nan, np.inf])
def test_a_height_that_is_not_finite_is_refused(height: float):
    mask = np.zeros((1, 128, 128), np.uint8)
    with pytest.raises(ConfigError, match=rf"heights must be finite, not \[{height}\]"):
        Shield(1).screen(ROW, mask, np.array([height]), np.array([STAY]))


def test_no_rows_at_all_are_fine():
    shield = Shield(2)
    shield.begin(np.array([]))
    none = np.zeros((0, 128, 128), np.uint8)
    assert shield.screen([], none, np.zeros(0), np.zeros((0, 4), np.int64)).actions.shape == (0, 4)  # pyright: ignore


def test_a_camera_with_a_lens_is_refused():
    with pytest.raises(ConfigError, match="masks of a pinhole, not of a camera with a lens"):
        Shield(1, EnvConfig(camera=Camera(lens=Lens("plumb_bob", (-0.2,)))))
