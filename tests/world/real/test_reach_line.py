"""Tests of the line of a reach, of worlds along it, and of the errors for unusable lines and arguments."""

import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from tests.world.real.geojson_files import EAST, feature, from_metres, read, written
from thalweg.env import DoneReason, EnvConfig, RiverVectorEnv, make_vector
from thalweg.world import Reach, World, WorldError, WorldFileError
from thalweg.world.errors import ShapeError
from thalweg.world.real.file_river import read_centerline
from thalweg.world.real.geodesy import local_metres
from thalweg.world.real.reach_line import MAX_SMOOTH_M, errors_naming, monotone_levels, smooth_line, thin_indices

CAM = Path(__file__).resolve().parents[3] / "thalweg" / "world" / "real" / "rivers" / "cam.geojson"


def test_a_line_is_in_metres_about_its_middle(tmp_path):
    line = read(tmp_path, feature(EAST, name=" Dora  Baltea "))
    np.testing.assert_allclose(line.points[:, 0], np.linspace(-788.468, 788.468, 5), atol=1e-3)
    np.testing.assert_allclose(line.points[:, 1], [0.0486, 0.0122, 0, 0.0122, 0.0486], atol=1e-3)
    np.testing.assert_array_equal(line.points[:, 2:], [[0.0, 12.0]] * 5)
    assert (line.name, line.closed, line.datum_m) == ("Dora Baltea", False, 0.0)
    assert line.origin_deg == pytest.approx((7.01, 45.0))


def test_the_file_of_a_reach_may_be_a_text():
    assert Reach(str(CAM)) == Reach(CAM) and Reach(str(CAM)).as_data() == Reach(CAM).as_data()  # pyright: ignore[reportArgumentType]


def test_a_reach_is_cut_out_by_metres_along_the_line(tmp_path):
    level = [[*place, height] for place, height in zip(EAST, [50, 40, 30, 20, 10], strict=True)]
    line = read(tmp_path, feature(level, width_m=[10, 20, 30, 40, 50]), start_m=197.117, length_m=788.468)
    assert line.origin_deg == pytest.approx((7.0075, 45.0), abs=1e-7)
    np.testing.assert_allclose(line.points[:, 0], [-394.234, -197.117, 197.117, 394.234], atol=2e-3)
    np.testing.assert_allclose(line.points[:, 2], [20, 15, 5, 0], atol=1e-3)
    np.testing.assert_allclose(line.points[:, 3], [15, 20, 30, 35], atol=1e-3)
    assert line.datum_m == pytest.approx(25.0, abs=1e-3)


def test_a_line_across_180_degrees_is_one_piece(tmp_path):
    line = read(tmp_path, feature([[179.99, 65.0], [-180.0, 65.0], [-179.99, 65.0], [-179.98, 65.0]]))
    np.testing.assert_allclose(np.diff(line.points[:, 0]), 471.77, atol=0.1)
    assert line.origin_deg == pytest.approx((-179.995, 65.0))


@pytest.mark.parametrize(
    ("given", "above_datum", "datum"),
    [
        ([110, 108, 109, 107, 107], [3, 1.5, 1.5, 0, 0], 107),
        ([107, 109, 108, 110, 110], [0, 1.5, 1.5, 3, 3], 107),
        ([-430, -430, -430, -430, -430], [0] * 5, -430),
    ],
    ids=["falls", "drawn upstream", "level"],
)
def test_elevations_become_monotone_water_levels(tmp_path, given, above_datum, datum):
    line = read(tmp_path, feature([[*place, height] for place, height in zip(EAST, given, strict=True)]))
    np.testing.assert_allclose(line.points[:, 2], above_datum)
    assert line.datum_m == datum


@pytest.mark.parametrize("smooth_m", [0.0, 8.0])
def test_a_ring_that_is_no_wider_than_a_sample_is_refused(tmp_path, smooth_m: float):
    turn = np.linspace(0, 2 * np.pi, 9)
    ring = from_metres(0.25 * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    ring[-1] = ring[0]
    with pytest.raises(WorldFileError, match=r"the line lies within 1\.3 m of one place: choose a longer reach"):
        read(tmp_path, feature(ring), smooth_m=smooth_m)


def test_a_loop_keeps_its_elevations():
    levels = np.array([3.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(monotone_levels(levels, closed=True), levels)
    np.testing.assert_array_equal(monotone_levels(levels, closed=False), [3.0, 2.0, 2.0, 2.0])


def test_a_line_that_ends_where_it_begins_is_a_loop_unless_a_reach_is_cut_out(tmp_path):
    turn = np.linspace(0, 2 * np.pi, 21)
    ring = from_metres(60.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    ring[-1] = ring[0]
    world = World.from_file(written(tmp_path, feature(ring)), plants=False)
    assert world.river.closed
    assert world.river.length_m == pytest.approx(2 * np.pi * 60.0, rel=1e-3)
    assert not read(tmp_path, feature(ring), length_m=100.0).closed


def test_positions_nearer_than_the_course_s_samples_are_left_out_but_not_the_ends():
    line = np.stack([np.array([0.0, 0.0, 0.5, 1.2, 2.0, 10.0, 20.0, 20.3]), np.zeros(8)], axis=1)
    assert thin_indices(line, closed=False).tolist() == [0, 4, 5, 7]
    ring = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0], [0.0, 1.0], [0.0, 0.0]])
    assert thin_indices(ring, closed=True).tolist() == [0, 1, 2, 3]


def curvature(points: np.ndarray) -> float:
    """Largest of the spline through points that lie densely enough."""
    from thalweg.world.geometry import curvature
    from thalweg.world.real.centerline import resample

    return float(np.abs(curvature(resample(points, False)[:, :2], False)).max())


def test_a_smoothed_corner_has_the_radius_of_the_formula():
    corner = np.array([[-200.0, 0, 2, 9], [0, 0, 1, 9], [0, 200, 0, 9]])
    for smooth_m in (12.0, 30.0):
        points = smooth_line(corner, False, smooth_m)
        assert 1 / curvature(points) == pytest.approx(smooth_m * math.sqrt(2 * math.pi) / (2 * math.sqrt(2)), rel=0.05)
        np.testing.assert_allclose(points[[0, -1]], corner[[0, -1]], atol=1e-6)
        assert (np.diff(points[:, 2]) < 0).all()


def test_smoothing_leaves_a_straight_line_and_widens_no_ring():
    straight = np.array([[0.0, 0, 0, 9], [300.0, 0, 0, 9]])
    points = smooth_line(straight, False, 20.0)
    np.testing.assert_allclose(points[:, 1], 0.0, atol=1e-9)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([80 * np.cos(turn), 80 * np.sin(turn), 0 * turn, 9 + 0 * turn], axis=1)
    radius = np.hypot(*smooth_line(ring, True, 10.0)[:, :2].T)
    np.testing.assert_allclose(radius, 80 * math.exp(-((10 / 80) ** 2) / 2), atol=0.3)


def test_a_line_with_corners_is_built_once_it_is_smoothed(tmp_path):
    corners = [[0, 0], [60, 0], [60, 60], [120, 60], [120, 120], [180, 120]]
    path = written(
        tmp_path, feature(from_metres(np.repeat(corners, 2, axis=0)[:-1] + np.tile([[0, 0], [4, 0]], (6, 1))[:-1]))
    )
    with pytest.raises(WorldFileError, match=r"radius of \d.*; smoothing the line may help, for example smooth_m=8"):
        World.from_file(path, plants=False)
    world = World.from_file(path, smooth_m=12.0, plants=False)
    assert 200 < world.river.length_m < 300
    with (
        pytest.raises(WorldFileError, match=r"^[^;]*$"),
        errors_naming(path, MAX_SMOOTH_M),  # there is no greater one to suggest
    ):
        raise ShapeError("folds")


def test_a_world_has_the_name_of_the_file_and_another_seed_gives_other_land(tmp_path):
    path = written(tmp_path, feature(from_metres([[0, 0], [20, 0], [40, 3], [60, 10]]), name="Dora $x_"))
    first, other = (World.from_file(path, seed=seed, plants=False) for seed in (0, 1))
    assert first.name == "Dora $x_"
    assert first.river.length_m == pytest.approx(61.4, abs=0.2)
    assert np.abs(first.ground_m[:100, :100] - other.ground_m[:100, :100]).max() > 0.1


CROSSING = from_metres([[0, 0], [100, 0], [100, 80], [50, 80], [50, -60]])


BULB = [[0, 0], [20, 0], [40, 0], [60, 0], [75, -8], [90, -15], [110, -10], [120, 5]]


BULB = BULB + [[x, 10 - y] for x, y in BULB[-2::-1]]


BAD_COURSES = {
    "curls when drawn": (
        feature(from_metres([[0, 0], [60, 0], [90, -15], [120, 5], [90, 25], [60, 10], [0, 10]])),
        r"crosses itself at \(-?\d+\.\d, -?\d+\.\d\) m: .*; smoothing the line may help, for example smooth_m=8",
    ),
    "a hill": (
        feature([[*p, z] for p, z in zip(EAST, [50, 49, 70, 47, 46], strict=True)]),
        r"an elevation of 70 m lies 1\d\.\d m from a profile that falls all the way; limit 5 m",
    ),
    "crosses": (feature(CROSSING), r"crosses itself between its piece at longitude 11\.0\d+, latitude 4[78]\.\d+ and"),
    "one place": (feature([[7, 45], [7, 45]]), r"reach from 0 to 0 m is not on the line, which is 0 m long"),
    "too short": (feature(from_metres([[0, 0], [3, 0], [6, 0], [9, 0]])), r"9\.\d m .* too short; at least 15\.0 m"),
    "too narrow": (feature(EAST, width_m=1.5), "1.50 m wide .* at least 2.00 m"),
    "too wide": (feature(EAST, width_m=250), "the width is 250.00 m at arc 0.0 m .* limit 100 m"),
    "too long": (
        feature([[7.0, 45.0], [7.5, 45.0], [8.0, 45.0], [8.5, 45.0]]),
        r"the line is 1182\d\d m long; limit 10400 m: choose a reach by start_m and length_m",
    ),
    "too large": (
        feature(from_metres([[0, 0], [2500, 0], [2500, 2500], [0, 2500]])),
        r"covers 26\d\d x 26\d\d m, 6\.8 km²; limit 6\.0 km²: choose a shorter reach",
    ),
    "arms": (
        feature(from_metres(BULB)),
        r"banks of two arms overlap: arc \d+\.\d m and \d+\.\d m are \d+\.\d+ m apart; limit 12\.50 m",
    ),
}


@pytest.mark.parametrize(("content", "message"), BAD_COURSES.values(), ids=BAD_COURSES)
def test_an_unusable_line_is_refused_with_its_path_and_the_reason(tmp_path, content, message):
    path = written(tmp_path, content)
    with pytest.raises(WorldFileError, match=message) as raised:
        World.from_file(path, plants=False)
    assert str(raised.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width_m": -3}, "width_m is -3 m; expected at least 2 m"),
        ({"width_m": "12"}, "width_m is '12'; expected a number of metres"),
        ({"width_m": math.nan}, "width_m is nan; expected a number of metres"),
        ({"start_m": math.inf}, "start_m is inf; expected a number of metres"),
        ({"start_m": -1.0}, "start_m is -1 m; expected at least 0 m"),
        ({"start_m": True}, "start_m is True"),
        ({"length_m": 5}, "length_m is 5 m; expected 15 to 10400 m"),
        ({"length_m": 20_000}, "length_m is 20000 m; expected 15 to 10400 m"),
        ({"smooth_m": -1}, "smooth_m is -1 m; expected 0 to 200 m"),
        ({"smooth_m": 500}, "smooth_m is 500 m; expected 0 to 200 m"),
        ({"start_m": 2000}, r"reach from 2000 to 1577 m is not on the line, which is 1577 m long"),
        ({"start_m": 1000, "length_m": 600}, r"reach from 1000 to 1600 m is not on the line, which is 1577 m long"),
        ({"seed": -1}, "a seed is 0 or more, not -1"),
    ],
)
def test_an_invalid_argument_is_refused_with_its_limits(tmp_path, options, message):
    with pytest.raises(WorldError, match=message):
        World.from_file(written(tmp_path, feature(EAST)), plants=False, **options)


def test_a_long_course_gets_its_step_limit_from_its_length(tmp_path):
    world = World.from_file(written(tmp_path, feature(EAST, name="Medium")), plants=False)
    limit = math.ceil(1.35 * world.river.length_m)
    assert limit == 2129
    config = EnvConfig(observation="none", max_idle_steps=10_000)
    hover = np.array([[1, 1, 1, 1]])
    one = gymnasium.make("thalweg/Easy-v0", world=world, config=config)
    one.reset(seed=0)
    for make in (lambda: RiverVectorEnv(world, 1, config), lambda: make_vector("Hard", 1, worlds=world, config=config)):
        env = make()
        env.reset(seed=0)
        for _ in range(limit - 1):
            assert not env.step(hover)[3][0]
        _, _, terminated, truncated, info = env.step(hover)
        assert (terminated[0], truncated[0], info["done_reason"][0]) == (False, True, DoneReason.MAX_STEP_REACHED)
    for _ in range(limit - 1):
        assert not one.step(hover[0])[3]
    assert one.step(hover[0])[3]


LANDMARKS = {
    "Silver Street Bridge": (0.115311, 52.20175),
    "Clare Bridge": (0.114047, 52.204972),
    "Trinity Bridge": (0.113853, 52.206644),
    "Bridge of Sighs": (0.115767, 52.208425),
    "Magdalene Bridge": (0.11657, 52.20987),
    "Jesus Lock": (0.12083, 52.21278),
}
"""Published coordinates of what stands across the Cam."""


def test_the_cam_passes_its_landmarks_within_20_metres_in_their_order():
    line = read_centerline(CAM)
    places = local_metres(np.array(list(LANDMARKS.values())), np.array(line.origin_deg))
    away = np.hypot(*(places[:, None, :] - line.points[None, :, :2]).transpose(2, 0, 1))
    assert away.min(axis=1).max() < 20.0
    assert (np.diff(away.argmin(axis=1)) > 0).all()


@pytest.mark.slow
def test_the_pilot_flies_the_whole_cam_both_ways():
    world = World.from_file(CAM, plants=False)
    river = world.river
    assert river.length_m == pytest.approx(1446, abs=1)
    env = RiverVectorEnv(world, 2, EnvConfig(observation="none"))
    ahead = np.arctan2(river.tangent[[0, -1], 1], river.tangent[[0, -1], 0]) + np.array([0.0, np.pi])
    env.reset(seed=0, options={"pose": np.column_stack([river.position_m[[0, -1]], [4.0, 4.0], ahead])})
    reasons, earned = np.full(2, -1), np.zeros(2)
    for _ in range(math.ceil(0.95 * river.length_m)):
        _, reward, _, _, info = env.step(env.pilot_actions())
        earned += np.where(reasons < 0, reward, 0.0)
        reasons = np.where(reasons < 0, info["done_reason"], reasons)
    assert reasons.tolist() == [DoneReason.SUCCESS] * 2
    np.testing.assert_allclose(earned, 10.0)
