"""Tests of motion under wind, current and inertia against closed forms, and that without them nothing changes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.env.forces.flights import FORWARD, MIDDLE, STILL, begun, flown, wide_water
from tests.env.handmade import canal, ring
from tests.env.task.priced.flights import PRICED, erratic, made, rivers
from tests.env.vehicle.basins import basin
from tests.env.winds import wind_of
from thalweg.env import EnvConfig, RiverVectorEnv
from thalweg.env.config import DoneReason
from thalweg.env.forces.weather import wind_now
from thalweg.env.physics.inertia import Inertia

STEADY = wind_of(speed_m_per_s=4.0, towards_deg=90.0, gust_share=0.0, drift_share=0.2)
"""Wind without gusts, towards north."""


def test_a_wind_drives_a_kinematic_vehicle_by_its_share_each_step():
    poses = flown(begun(wide_water(), wind=STEADY), STILL, 40)
    np.testing.assert_allclose(poses[:, 1], 0.2 * 4.0 * 0.25 * np.arange(1, 41), rtol=1e-12)
    np.testing.assert_allclose(poses[:, [0, 2, 3]], np.tile(MIDDLE[[0, 2, 3]], (40, 1)), atol=1e-12)


def test_a_kinematic_vehicle_makes_its_own_steps_beside_the_drift():
    poses = flown(begun(wide_water(), wind=STEADY), FORWARD, 10)
    assert poses[-1, 0] == pytest.approx(500.0 + 10.0)
    assert poses[-1, 1] == pytest.approx(0.2 * 4.0 * 2.5)


def test_a_vehicle_with_inertia_reaches_its_terminal_velocity_in_the_wind():
    inertia = Inertia(time_constant_s=0.4, drag_per_s=0.5)
    env = begun(wide_water(), wind=STEADY, dynamics="inertial", inertia=inertia)
    poses = flown(env, STILL, 80)
    assert env.forces.state.velocity[0] == pytest.approx([0.0, 0.4 * 0.5 * 4.0, 0.0, 0.0])
    np.testing.assert_allclose(np.diff(poses[60:, 1]), 0.4 * 0.5 * 4.0 * 0.25, rtol=1e-9)


def test_a_command_against_the_wind_holds_the_place():
    inertia = Inertia(time_constant_s=0.4, drag_per_s=0.5)
    env = begun(wide_water(), wind=STEADY, dynamics="inertial", inertia=inertia)
    right = np.array([[0.0, 0.0, 0.0, -0.4 * 0.5 * 4.0 / inertia.lateral_m_per_s]], np.float32)
    assert flown(env, right, 40)[-1] == pytest.approx(MIDDLE, abs=1e-6)


def test_a_vehicle_with_inertia_follows_the_command_with_a_lag():
    inertia = Inertia(acceleration_m_per_s2=1e6)
    env = begun(wide_water(), dynamics="inertial", inertia=inertia)
    poses = flown(env, FORWARD, 12)
    t = 0.25 * np.arange(1, 13)
    wanted = 4.0 * (t - 0.4 * (1 - np.exp(-t / 0.4)))
    np.testing.assert_allclose(poses[:, 0] - 500.0, wanted, rtol=1e-12)
    assert env.forces.state.velocity[0, 0] == pytest.approx(4.0 * (1 - math.exp(-3.0 / 0.4)))


def test_a_vehicle_with_inertia_accelerates_by_no_more_than_its_limit():
    env = begun(wide_water(), dynamics="inertial", inertia=Inertia(acceleration_m_per_s2=2.0))
    poses = flown(env, FORWARD, 4)
    t = 0.25 * np.arange(1, 5)
    np.testing.assert_allclose(poses[:, 0] - 500.0, 0.5 * 2.0 * t * t, rtol=1e-12)


UP = np.array([[1.0, 0.0, 0.0, 0.0]], np.float32)
SLOW_CLIMB = Inertia(vertical_m_per_s=1.5, vertical_time_constant_s=0.2, vertical_acceleration_m_per_s2=1e6)
"""Numbers of the climb that differ from those of the other directions."""


def test_a_climb_has_a_speed_and_a_lag_of_its_own():
    t = 0.25 * np.arange(1, 9)
    climbed = flown(begun(wide_water(), dynamics="inertial", inertia=SLOW_CLIMB), UP, 8)[:, 2] - MIDDLE[2]
    np.testing.assert_allclose(climbed, 1.5 * (t - 0.2 * (1 - np.exp(-t / 0.2))), rtol=1e-9)


def test_a_climb_has_an_acceleration_of_its_own():
    quick = Inertia(vertical_m_per_s=4.0, vertical_time_constant_s=0.2, vertical_acceleration_m_per_s2=0.8)
    t = 0.25 * np.arange(1, 5)
    climbed = flown(begun(wide_water(), dynamics="inertial", inertia=quick), UP, 4)[:, 2] - MIDDLE[2]
    np.testing.assert_allclose(climbed, 0.5 * 0.8 * t * t, rtol=1e-9)


def test_a_gust_lifts_a_vehicle_with_inertia_by_its_drag():
    inertia = replace(SLOW_CLIMB, drag_per_s=0.7)
    env = begun(wide_water(), wind=wind_of(speed_m_per_s=3.0, gust_share=0.2), dynamics="inertial", inertia=inertia)
    expected, velocity, left = MIDDLE[2], 0.0, math.exp(-0.25 / 0.2)
    for _ in range(20):
        upwards = wind_now(0, env.forces.numbers, env.forces.state)[2]
        target = 0.7 * 0.2 * upwards
        expected += target * 0.25 + (velocity - target) * 0.2 * (1 - left)
        velocity = target + (velocity - target) * left
        z = env.step(STILL)[0][0, 2]
        assert z == pytest.approx(expected, abs=1e-9)
    assert abs(expected - MIDDLE[2]) > 0.01


def test_a_boat_with_inertia_neither_climbs_nor_says_so():
    env = begun(basin(), np.array([30.0, 0.0, 1.2, 0.0]), vehicle="asv", dynamics="inertial", wind=STEADY)
    for _ in range(3):
        poses, *_, info = env.step(np.array([[1.0, 0.0, 0.0, 0.0]], np.float32))
        assert info["velocity"][0, 2] == 0.0 and poses[0, 2] == pytest.approx(1.2)


def test_yaw_rate_follows_with_a_lag_and_stays_in_its_limit():
    env = begun(wide_water(), dynamics="inertial")
    turning = np.array([[0.0, 1.0, 0.0, 0.0]], np.float32)
    yaw = flown(env, turning, 8)[:, 3]
    t = 0.25 * np.arange(1, 9)
    rate = math.radians(40.0)
    np.testing.assert_allclose(yaw, rate * (t - 0.15 * (1 - np.exp(-t / 0.15))), rtol=1e-9)
    assert env.forces.state.velocity[0, 3] == pytest.approx(rate, rel=1e-5) and np.diff(yaw).max() <= rate * 0.25


def test_without_lag_inertial_motion_is_kinematic_motion():
    quick = {"time_constant_s": 1e-9, "vertical_time_constant_s": 1e-9, "yaw_time_constant_s": 1e-9}
    inertia = Inertia(**quick, acceleration_m_per_s2=1e12, vertical_acceleration_m_per_s2=1e12)
    envs = begun(wide_water(), dynamics="inertial", inertia=inertia), begun(wide_water())
    rng = np.random.default_rng(0)
    for _ in range(50):
        action = rng.uniform(-1, 1, (1, 4)).astype(np.float32) * [[1, 0.3, 1, 1]]
        inertial, kinematic = (env.step(action)[0] for env in envs)
        np.testing.assert_allclose(inertial, kinematic, atol=1e-5)


def test_backward_commands_only_brake_unless_they_are_allowed():
    back = -FORWARD
    assert flown(begun(wide_water(), dynamics="inertial"), back, 8)[-1, 0] == 500.0
    assert flown(begun(wide_water(), dynamics="inertial", allow_backward=True), back, 8)[-1, 0] < 496.0


def test_velocity_is_zero_at_the_start_of_each_episode():
    env = begun(wide_water(), dynamics="inertial")
    flown(env, FORWARD, 4)
    _, info = env.reset(options={"pose": MIDDLE})
    assert (info["velocity"] == 0).all() and (env.forces.state.velocity == 0).all()


def test_the_middle_of_the_current_carries_what_floats_by_its_speed():
    poses = flown(begun(wide_water(), current_m_per_s=0.8, carried_by_current=True), STILL, 40)
    np.testing.assert_allclose(poses[:, 0] - 500.0, 0.8 * 0.25 * np.arange(1, 41), rtol=1e-9)
    np.testing.assert_allclose(poses[:, 1:], np.tile(MIDDLE[1:], (40, 1)), atol=1e-12)


@pytest.mark.parametrize(("across", "share"), [(0.5, 0.75), (-0.8, 0.36), (1.0, 0.0)])
def test_the_current_is_a_parabola_across_the_channel(across: float, share: float):
    pose = np.array([500.0, across * 500.0, 8.0, 0.0])
    carried = flown(begun(wide_water(), pose, current_m_per_s=0.8, carried_by_current=True), STILL, 1)
    assert carried[0, 0] - 500.0 == pytest.approx(share * 0.8 * 0.25)


def test_the_current_flows_downhill():
    rising = wide_water(level_m=np.linspace(0.0, 1.0, 101))
    poses = flown(begun(rising, current_m_per_s=0.8, carried_by_current=True), STILL, 4)
    assert poses[-1, 0] == pytest.approx(500.0 - 0.8)


def test_the_current_is_faster_where_the_channel_is_narrower():
    width = np.where(np.arange(101) < 50, 1000.0, 500.0)
    env = begun(wide_water(width_m=width), current_m_per_s=0.5, carried_by_current=True)
    speeds = [
        flown(begun(wide_water(width_m=width), np.array([x, 0.0, 8.0, 0.0]), **_afloat(0.5)), STILL, 1)[0, 0] - x
        for x in (200.0, 800.0)
    ]
    assert speeds[1] == pytest.approx(2 * speeds[0]) and env.courses.flow[0] < 1 < env.courses.flow[-1]


def _afloat(current: float) -> dict:
    return {"current_m_per_s": current, "carried_by_current": True}


def test_a_current_does_not_move_what_flies():
    poses = flown(begun(wide_water(), current_m_per_s=0.8), STILL, 10)
    np.testing.assert_array_equal(poses, np.tile(MIDDLE, (10, 1)))


def test_a_current_carries_a_vehicle_with_inertia_beside_its_own_velocity():
    still = flown(begun(wide_water(), dynamics="inertial"), FORWARD, 10)
    carried = flown(begun(wide_water(), dynamics="inertial", **_afloat(0.8)), FORWARD, 10)
    np.testing.assert_allclose(carried[:, 0] - still[:, 0], 0.8 * 0.25 * np.arange(1, 11), rtol=1e-9)


def test_gusts_lift_what_flies_and_not_what_floats():
    gusty = wind_of(speed_m_per_s=3.0, gust_share=0.2)
    assert np.ptp(flown(begun(wide_water(), wind=gusty), STILL, 40)[:, 2]) > 0.05
    assert np.ptp(flown(begun(wide_water(), wind=gusty, **_afloat(0.0)), STILL, 40)[:, 2]) == 0.0


def test_a_wind_blows_a_vehicle_out_of_the_channel():
    env = begun(canal(), np.array([30.0, 2.9, 8.0, 0.0]), wind=STEADY)
    *_, info = env.step(STILL)
    assert info["done_reason"][0] == DoneReason.OUT_OF_VOLUME_HORIZONTAL and info["costs"][0].tolist() == [1.0, 0.0]


@pytest.mark.parametrize(
    "options", [{"wind": wind_of(speed_m_per_s=0.0)}, {"current_m_per_s": 1.0}], ids=["calm", "below"]
)
def test_forces_that_push_nothing_give_the_same_bits_as_none(options: dict):
    actions = np.random.default_rng(0).integers(0, 3, (120, 4, 4))
    actions[..., :2] = 1  # level and straight on, so that no episode ends
    results = []
    for more in ({}, options):
        env = RiverVectorEnv(wide_water(), 4, EnvConfig(observation="none", max_idle_steps=500, **more))
        env.reset(seed=3)
        results.append([each for chosen in actions for each in env.step(chosen)[:2]])
        assert (env.state.steps == 120).all()
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))


def test_without_forces_info_and_state_have_no_more_than_before():
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation="none"))
    _, info = env.reset(seed=0)
    assert not {"wind", "velocity"} & info.keys() and not [key for key in env.get_state() if key.startswith("force")]


@pytest.mark.parametrize("task", PRICED)
def test_a_step_under_forces_pays_and_costs_what_its_task_says(task: str):
    """A current that carries nothing makes the step that of forces, and changes nothing."""
    river = rivers()["ring"]
    calm = made(task, river, mode="DISABLED")
    pushed = made(task, river, mode="DISABLED", current_m_per_s=0.5)
    calm.reset(seed=3)
    pushed.reset(seed=3)
    rng, going, total = np.random.default_rng(5), np.ones(calm.num_envs, bool), 0.0
    for _ in range(40):
        actions = erratic(calm, rng)
        for env in (calm, pushed):
            env.episodes.ended[:] = False
        (_, paid, _, _, one), (_, rewards, _, _, other) = calm.step(actions), pushed.step(actions)
        np.testing.assert_array_equal(rewards[going], paid[going])
        for name in ("costs", "pose", "done_reason", "progress"):
            np.testing.assert_array_equal(other[name][going], one[name][going])
        total += one["costs"][going, 2].sum()
        going &= one["done_reason"] < 0
    assert total > 0
