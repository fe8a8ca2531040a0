"""Tests of the weather of episodes: ranges, seeds, statistics, and restored states."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.env.forces.flights import begun, wide_water
from tests.env.handmade import BlankRenderer, hairpin, ring
from tests.env.winds import wind_of
from tests.render.plain import plane
from thalweg.env import EnvConfig, RiverEnv, RiverVectorEnv, StateError
from thalweg.env.config import ConfigError
from thalweg.env.physics.wind import Wind, horizontal_length, horizontal_ratio
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.render import Camera

VARYING = wind_of(speed_m_per_s=(1.0, 3.0), towards_deg=(90.0, 180.0), gust_share=(0.05, 0.15))
OPTIONS = {
    "action": "continuous", "dynamics": "inertial", "wind": VARYING, "current_m_per_s": (0.1, 0.5),
    "carried_by_current": True,
}  # fmt: skip


def many(count: int, wind: Wind, seed: int = 0) -> RiverVectorEnv:
    env = RiverVectorEnv(wide_water(), count, EnvConfig(observation="none", wind=wind))
    env.reset(seed=seed)
    return env


def test_each_episode_draws_its_means_from_the_ranges():
    env = RiverVectorEnv(wide_water(), 2000, EnvConfig(observation="none", wind=VARYING, current_m_per_s=(0.1, 0.5)))
    env.reset(seed=0)
    drawn = np.column_stack([env.forces.state.mean_wind, env.forces.state.current])
    low, high = np.array([1.0, math.pi / 2, 0.05, 0.1]), np.array([3.0, math.pi, 0.15, 0.5])
    assert (drawn >= low).all() and (drawn <= high).all()
    # The mean of 2,000 uniform numbers has a standard error of 0.0065 of the range.
    np.testing.assert_allclose((drawn.mean(axis=0) - low) / (high - low), 0.5, atol=0.03)
    np.testing.assert_allclose(np.corrcoef(drawn.T), np.eye(4), atol=0.1)


def test_the_weather_follows_from_the_seed_whatever_the_number_of_environments():
    few, more, other = many(2, VARYING), many(5, VARYING), many(2, VARYING, seed=9)
    still = np.ones((5, 4), np.int64)
    for _ in range(30):
        winds = [env.step(still[: env.num_envs])[4]["wind"] for env in (few, more, other)]
        np.testing.assert_array_equal(winds[0], winds[1][:2])
        assert not np.isclose(winds[0], winds[2]).any()


def test_a_new_episode_is_told_its_own_wind_and_velocity_in_the_step_that_begins_it():
    options = {**OPTIONS, "current_m_per_s": None, "carried_by_current": False, "max_steps": 5}
    env = RiverVectorEnv(wide_water(), 3, EnvConfig(observation="none", **options))
    env.reset(seed=0)
    for _ in range(5):
        *_, info = env.step(np.full((3, 4), 0.5, np.float32))
    assert info["_final_info"].all()
    np.testing.assert_array_equal(info["velocity"], 0.0)
    np.testing.assert_array_equal(info["wind"], env.forces.info()["wind"])
    final = info["final_info"]
    assert (np.abs(final["velocity"]).max(axis=1) > 0.1).all()
    assert not np.isclose(final["wind"][:, :2], info["wind"][:, :2]).any()
    kept = {name: info[name].copy() for name in ("wind", "velocity")}
    env.step(np.ones((3, 4), np.float32))
    for name, values in kept.items():
        np.testing.assert_array_equal(info[name], values)


def test_the_next_episode_has_another_weather():
    env = many(1, VARYING)
    before = env.forces.state.mean_wind.copy()
    env.reset()
    assert not np.isclose(env.forces.state.mean_wind, before).any()


def test_wind_blows_towards_its_direction():
    env = begun(wide_water(), wind=wind_of(speed_m_per_s=3.0, towards_deg=120.0, gust_share=0.0))
    wanted = [3.0 * math.cos(math.radians(120.0)), 3.0 * math.sin(math.radians(120.0)), 0.0]
    assert env.step(np.zeros((1, 4), np.float32))[4]["wind"][0] == pytest.approx(wanted)


def test_winds_have_the_deviations_and_autocorrelations_of_the_model():
    wind = wind_of(speed_m_per_s=4.0, towards_deg=0.0, gust_share=0.1, drift_share=0.0)
    env = many(4000, wind)
    still, steps = np.ones((4000, 4), np.int64), 20
    first = env.forces.info()["wind"] - [4.0, 0.0, 0.0]
    for _ in range(steps):
        *_, info = env.step(still)
    last = info["wind"] - [4.0, 0.0, 0.0]
    ratio = horizontal_ratio(wind.height_m)
    deviation = np.array([0.4 * ratio, 0.4 * ratio, 0.4])
    for gusts in (first, last):
        np.testing.assert_allclose(gusts.std(axis=0), deviation, rtol=0.05)
        np.testing.assert_allclose(gusts.mean(axis=0), 0.0, atol=0.06)
    t = 4.0 * steps * 0.25 / np.array([horizontal_length(wind.height_m)] * 2 + [wind.height_m])
    wanted = np.exp(-t) * (1 - t * [0.0, 0.5, 0.5])
    np.testing.assert_allclose((first * last).mean(axis=0) / deviation**2, wanted, atol=0.06)


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_a_resumed_run_is_equal_to_the_bit(mode: str):
    config = EnvConfig(**OPTIONS)

    def made() -> RiverVectorEnv:
        return RiverVectorEnv([ring(), hairpin()], 4, config, renderer=BlankRenderer(), autoreset_mode=mode)

    def flown(env: RiverVectorEnv, steps: int, seed: int) -> list[np.ndarray]:
        actions = np.random.default_rng(seed).uniform(-1, 1, (steps, 4, 4)).astype(np.float32)
        results = [env.step(chosen) for chosen in actions]
        return [each for _, reward, ended, _, info in results for each in (reward, ended, *_arrays(info))]

    env = made()
    env.reset(seed=0)
    flown(env, 37, seed=1)
    state = env.get_state()
    expected = flown(env, 200, seed=2)
    other = made()
    other.set_state(state)
    assert sum(each.sum() for each in expected[1::6]) > 10
    assert all(np.array_equal(a, b) for a, b in zip(expected, flown(other, 200, seed=2), strict=True))


def _arrays(info: dict) -> list[np.ndarray]:
    return [info[name] for name in ("pose", "wind", "velocity", "costs")]


def test_an_impossible_state_is_refused_before_anything_changes():
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation="none", **OPTIONS))
    env.reset(seed=0)
    before = env.get_state()
    gust = before["force_gust"].copy()
    gust[1, 3] = np.nan
    with pytest.raises(StateError, match=r"force_gust has .*nan.*; allowed: finite numbers \(environment 1\)"):
        env.set_state({**before, "force_gust": gust, "steps": before["steps"] + 1})
    assert all(np.array_equal(value, before[name]) for name, value in env.get_state().items())
    calm = RiverVectorEnv(ring(), 2, EnvConfig(observation="none"))
    calm.reset(seed=0)
    with pytest.raises(StateError, match="the state lacks"):
        env.set_state(calm.get_state())


def test_a_single_environment_has_the_weather_of_a_vector_of_one():
    config = EnvConfig(observation="none", **OPTIONS)
    single, vector = RiverEnv(wide_water(), config), RiverVectorEnv(wide_water(), 1, config)
    _, info = single.reset(seed=4)
    _, infos = vector.reset(seed=4)
    for _ in range(10):
        np.testing.assert_array_equal(info["wind"], infos["wind"][0])
        np.testing.assert_array_equal(info["velocity"], infos["velocity"][0])
        *_, info = single.step(np.array([0.0, 0.2, 1.0, 0.0], np.float32))
        *_, infos = vector.step(np.array([[0.0, 0.2, 1.0, 0.0]], np.float32))


@pytest.mark.parametrize("kinematic", [False, True])
def test_tensors_step_as_the_vector_environment_with_the_same_random_numbers(kinematic: bool):
    import torch

    options = {**OPTIONS, "dynamics": "kinematic"} if kinematic else OPTIONS
    config = EnvConfig(observation="none", **options)
    tensors = TensorRiverEnv([ring(), hairpin()], 5, config, device="cpu")
    vector = RiverVectorEnv([ring(), hairpin()], 5, config, autoreset_mode="next_step")
    vector.reset(seed=0)
    poses, _ = tensors.reset(seed=0)
    vector.reset(options={"pose": poses.numpy()})
    ends, begun = 0, np.ones(5, bool)
    for actions in torch.rand(200, 5, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 2 - 1:
        state = tensors.get_state()
        for name, values in vector.forces.state._asdict().items():
            values[begun] = state[f"force_{name}"][begun]  # the keys of the other's episodes
        begun = state["ended"].astype(bool)
        obs, reward, terminated, truncated, info = tensors.step(actions)
        theirs, their_reward, *_, their_info = vector.step(actions.numpy())
        if begun.any():
            theirs, their_info = vector.reset(options={"reset_mask": begun, "pose": obs.numpy()})
        np.testing.assert_array_equal(obs.numpy(), theirs)
        np.testing.assert_array_equal(reward.numpy(), their_reward)
        going = ~begun
        for name in ("costs", "done_reason", "wind", "velocity")[: 3 if kinematic else 4]:
            np.testing.assert_array_equal(info[name].numpy()[going], their_info[name][going])
        ends += int(terminated.sum() + truncated.sum())
    assert ends > 5


def test_tensors_resume_from_a_state_and_depend_on_seed_and_episode_alone():
    import torch

    config = EnvConfig(observation="none", **OPTIONS)
    env, fewer = (TensorRiverEnv([ring(), hairpin()], count, config, device="cpu") for count in (5, 2))
    _, info = env.reset(seed=7)
    np.testing.assert_array_equal(info["wind"][:2], fewer.reset(seed=7)[1]["wind"])
    assert len(np.unique(env.get_state()["force_key"])) == 5
    actions = torch.rand(80, 5, 4, generator=torch.Generator().manual_seed(0)) * 2 - 1
    for chosen in actions[:30]:
        env.step(chosen)
    state = env.get_state()
    flown = [env.step(chosen)[4]["velocity"] for chosen in actions[30:]]
    other = TensorRiverEnv([ring(), hairpin()], 5, config, device="cpu")
    other.set_state(state)
    assert all(torch.equal(a, other.step(chosen)[4]["velocity"]) for a, chosen in zip(flown, actions[30:], strict=True))


def test_a_wind_that_cannot_be_held_is_refused_before_an_environment_exists():
    with pytest.raises(ConfigError, match="holds against a wind of"):
        EnvConfig(wind=wind_of(speed_m_per_s=30.0))


def test_frames_show_the_wind_of_the_episode_in_all_environments():
    world = plane(water_level=0.5)
    config = EnvConfig(camera=Camera(32, 32), wind=wind_of(speed_m_per_s=4.0, towards_deg=(0, 360)))
    tensors = TensorRiverEnv(world, 2, config, device="cpu")
    frames, info = tensors.reset(seed=1)
    state = tensors.get_state()
    vector, calm = (RiverVectorEnv(world, 2, each) for each in (config, replace(config, wind=None)))
    for env in (vector, calm):
        env.reset(seed=0, options={"pose": info["pose"].numpy()})
        env.state.time_s[:] = state["time_s"]
    given = {name: value for name, value in state.items() if name.startswith("force_")}
    vector.set_state({**vector.get_state(), **given})
    np.testing.assert_array_equal(frames.numpy(), vector.observe())
    assert (vector.observe() != calm.observe()).any(axis=(1, 2, 3)).all()
