"""Domain randomisation in the environment: seeded, per episode or per environment, stored, and never in the rules."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.env.flights import FORWARD
from thalweg.env import EnvConfig, RiverEnv, RiverVectorEnv
from thalweg.env.config import ConfigError
from thalweg.env.snapshot import StateError
from thalweg.render import Camera, Randomisation, Renderer
from thalweg.world.record import World

CAMERA = Camera(16, 16)
LOOKS = Randomisation.only(haze=(0.0, 9.0), water_tint=(-1.0, 1.0), noise=(0.0, 8.0), season=(0.0, 1.0))


def river(world: World, count: int = 3, **changes) -> RiverVectorEnv:
    config = EnvConfig(camera=CAMERA, randomisation=LOOKS).with_options(**changes)
    return RiverVectorEnv([world], count, config)


def fly(env: RiverVectorEnv, steps: int) -> list[tuple]:
    return [env.step(np.tile(FORWARD, (env.num_envs, 1)))[:4] for _ in range(steps)]


@pytest.mark.slow
def test_the_frames_are_those_of_the_looks_in_the_state_and_the_rules_do_not_see_them(easy_world: World):
    varied, plain = river(easy_world), river(easy_world, randomisation=None)
    frames, info = varied.reset(seed=3)
    poses = info["pose"]
    state = varied.get_state()
    assert len(np.unique(state["look"], axis=0)) == 3
    expected = Renderer([easy_world], CAMERA).render(poses, None, state["time_s"], look=state["look"])
    np.testing.assert_array_equal(frames, expected)
    plain.reset(options={"pose": poses}, seed=3)
    for (_, r1, te1, tr1), (_, r2, te2, tr2) in zip(fly(varied, 4), fly(plain, 4), strict=True):
        np.testing.assert_array_equal(r1, r2)
        np.testing.assert_array_equal(te1, te2)
        np.testing.assert_array_equal(tr1, tr2)


def test_a_look_lasts_an_episode_or_as_long_as_the_seed(easy_world: World):
    for period, lasts in (("episode", False), ("environment", True)):
        ranges = Randomisation.only(haze=(0.0, 9.0), per=period)
        env = river(easy_world, 2, observation="none", randomisation=ranges)
        env.reset(seed=5)
        first = env.get_state()["look"]
        fly(env, 3)
        np.testing.assert_array_equal(env.get_state()["look"], first)
        env.reset()
        assert np.array_equal(env.get_state()["look"], first) == lasts
        env.reset(seed=5)
        np.testing.assert_array_equal(env.get_state()["look"], first)
        assert first[0, 0] != first[1, 0]


def test_one_environment_draws_as_a_vector_of_one_does(easy_world: World):
    for period in ("episode", "environment"):
        config = EnvConfig(observation="none", randomisation=Randomisation.only(haze=(0.0, 9.0), per=period))
        single, vector = RiverEnv(easy_world, config), RiverVectorEnv([easy_world], 1, config)
        single.reset(seed=8)
        vector.reset(seed=8)
        np.testing.assert_array_equal(single.get_state()["look"], vector.get_state()["look"])
        kept = single.get_state()["look"]
        single.reset()
        assert np.array_equal(single.get_state()["look"], kept) == (period == "environment")


@pytest.mark.slow
def test_the_last_frame_of_an_episode_has_the_look_of_that_episode(easy_world: World):
    env = river(easy_world, 2, max_steps=2)
    env.reset(seed=1)
    fly(env, 1)
    before = env.get_state()
    _, _, _, truncated, info = env.step(np.tile(FORWARD, (2, 1)))
    assert truncated.all()
    poses = info["final_info"]["pose"]
    last = Renderer([easy_world], CAMERA).render(poses, None, before["time_s"] + 0.25, look=before["look"])
    np.testing.assert_array_equal(np.stack(list(info["final_obs"])), last)
    assert (env.get_state()["look"] != before["look"]).any()


@pytest.mark.slow
def test_a_stored_state_brings_back_the_looks_and_what_is_drawn_next(easy_world: World):
    env, other = river(easy_world), river(easy_world)
    env.reset(seed=2)
    fly(env, 2)
    state = env.get_state()
    other.reset(seed=99)
    other.set_state(state)
    np.testing.assert_array_equal(env.observe(), other.observe())
    np.testing.assert_array_equal(env.reset()[0], other.reset()[0])
    for name, value in (("look", 1e9), ("sun", 1)):
        broken = {**state, name: np.full_like(state[name], value)}
        with pytest.raises(StateError, match=name):
            other.set_state(broken)


@pytest.mark.slow
def test_each_sun_is_the_world_relit(easy_world: World):
    suns = Randomisation.only(sun_azimuth_deg=(0.0, 360.0), sun_elevation_deg=(25.0, 60.0), suns=2)
    env = river(easy_world, 6, randomisation=suns)
    frames, info = env.reset(seed=0)
    state = env.get_state()
    assert set(state["sun"]) == {0, 1}
    for sun, light in enumerate(suns.lights(easy_world.seed)):
        rows = np.flatnonzero(state["sun"] == sun)
        drawn = Renderer([easy_world.relit(*light)], CAMERA).render(info["pose"][rows], None, state["time_s"][rows])
        np.testing.assert_array_equal(frames[rows], drawn)
    # The sun chooses the side from which plants are shown, so that a leaf may hide another pixel of water.
    assert (frames[..., 3] == Renderer([easy_world], CAMERA).render(info["pose"])[..., 3]).mean() > 0.99


def test_it_is_off_by_default_on_by_true_and_refused_where_it_cannot_be(easy_world: World):
    assert EnvConfig().randomisation is None
    assert EnvConfig(randomisation=True).randomisation == Randomisation()  # pyright: ignore
    assert EnvConfig(randomisation=np.True_) == EnvConfig(randomisation=Randomisation())  # pyright: ignore
    assert EnvConfig(randomisation=np.False_) == EnvConfig()  # pyright: ignore
    with pytest.raises(ConfigError, match=r"randomisation must be a Randomisation or None \(True: .*\), got 'haze'"):
        EnvConfig(randomisation="haze")  # pyright: ignore
    config = EnvConfig(camera=CAMERA, randomisation=LOOKS)
    with pytest.raises(ConfigError, match="needs a renderer of its own"):
        RiverVectorEnv([easy_world], 1, config, renderer=Renderer([easy_world], CAMERA))
    steep = EnvConfig(camera=Camera(16, 16, pitch_deg=86.0), randomisation=Randomisation.only(pitch_deg=(-5.0, 5.0)))
    with pytest.raises(ValueError, match="pitch_deg = 91; it must be from -89 to 89"):
        RiverVectorEnv([easy_world], 1, steep, autoreset_mode=AutoresetMode.DISABLED)
