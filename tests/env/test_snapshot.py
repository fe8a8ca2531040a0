"""Tests that an environment resumes from its saved state, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from tests.env.handmade import BlankRenderer, hairpin, ring
from thalweg.env import EnvConfig, RiverEnv, RiverVectorEnv, StateError
from thalweg.env.config import DEFAULT_CONFIG
from thalweg.world.record import World


def make(mode: str = "SAME_STEP", worlds=None, num_envs: int = 4, config: EnvConfig = DEFAULT_CONFIG) -> RiverVectorEnv:
    return RiverVectorEnv(
        worlds or [ring(), hairpin()], num_envs, config, renderer=BlankRenderer(), autoreset_mode=mode
    )


def planted(world: World) -> World:
    """The world with one plant more."""
    return replace(world, plants=replace(world.plants, position_m=np.zeros((1, 3), np.float32)))


def flown(env: RiverVectorEnv, steps: int, seed: int) -> list[np.ndarray]:
    """Everything that `steps` random actions return."""
    rng = np.random.default_rng(seed)
    results = []
    for _ in range(steps):
        observations, rewards, terminated, truncated, info = env.step(rng.integers(0, 3, size=(env.num_envs, 4)))
        results += [observations, rewards, terminated, truncated, info["pose"], info["cost"], info["progress"]]
    return results


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_a_resumed_run_is_equal_to_the_bit(mode: str):
    env = make(mode)
    env.reset(seed=0)
    flown(env, 37, seed=1)
    state = env.get_state()
    expected = flown(env, 200, seed=2)
    other = make(mode)
    other.set_state(state)
    assert np.array_equal(other.observe()[..., 3], np.full((4, 8, 8), 255))
    assert all(np.array_equal(a, b) for a, b in zip(expected, flown(other, 200, seed=2), strict=True))


def test_a_state_is_a_copy():
    env = make()
    env.reset(seed=0)
    state = env.get_state()
    kept = {key: value.copy() for key, value in state.items()}
    flown(env, 60, seed=1)
    assert all(np.array_equal(state[key], kept[key]) for key in kept)
    env.set_state(state)
    flown(env, 60, seed=1)
    assert all(np.array_equal(state[key], kept[key]) for key in kept)


def test_a_state_survives_a_file(tmp_path):
    env = make()
    env.reset(seed=0)
    flown(env, 10, seed=1)
    np.savez(tmp_path / "state.npz", **env.get_state())  # pyright: ignore[reportArgumentType]
    expected = flown(env, 50, seed=2)
    with np.load(tmp_path / "state.npz") as stored:
        env.set_state(dict(stored))
    assert all(np.array_equal(a, b) for a, b in zip(expected, flown(env, 50, seed=2), strict=True))


def test_the_observation_after_resuming_is_what_was_seen():
    env = make()
    env.reset(seed=0)
    seen = flown(env, 5, seed=1)[-7]
    state = env.get_state()
    flown(env, 5, seed=2)
    env.set_state(state)
    assert np.array_equal(env.observe(), seen)


def test_one_environment_resumes_too():
    env = RiverEnv(ring(), EnvConfig(observation="none"))
    env.reset(seed=0)
    state = env.get_state()
    first = [env.reset()[0] for _ in range(3)]
    env.set_state(state)
    assert np.array_equal(first, [env.reset()[0] for _ in range(3)])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"num_envs": 2}, "this environment has"),
        ({"worlds": [ring(), hairpin(width_m=5.9)]}, "other worlds"),
        ({"worlds": [hairpin(), ring()]}, "other worlds"),
        ({"worlds": [ring(), hairpin(name="other")]}, "other worlds"),
        ({"worlds": [ring(), replace(hairpin(), seed=1)]}, "other worlds"),
        ({"worlds": [ring(), replace(hairpin(), sun_azimuth=1.0)]}, "other worlds"),
        ({"worlds": [ring(), replace(hairpin(), sun_elevation=0.5)]}, "other worlds"),
        ({"worlds": [ring(), replace(hairpin(), ground_m=np.ones((2, 2), np.float32))]}, "other worlds"),
        ({"worlds": [ring(), replace(hairpin(), albedo=np.ones((2, 2, 3), np.uint8))]}, "other worlds"),
        ({"worlds": [ring(), planted(hairpin())]}, "other worlds"),
        ({"config": EnvConfig(max_height_m=14.0)}, "another config"),
        ({"config": EnvConfig(reward_scheme="package")}, "another config"),
        ({"config": EnvConfig(max_steps=500)}, "another config"),
    ],
)
def test_a_state_of_another_environment_is_refused_before_anything_changes(other: dict, message: str):
    env = make()
    env.reset(seed=0)
    foreign = make(**other)
    foreign.reset(seed=1)
    before = foreign.get_state()
    with pytest.raises(StateError, match=message):
        foreign.set_state(env.get_state())
    assert all(np.array_equal(value, before[key]) for key, value in foreign.get_state().items())


def test_a_state_that_lacks_an_array_is_refused():
    env = make()
    state = env.get_state()
    del state["idle"]
    with pytest.raises(StateError, match=r"lacks.*idle"):
        env.set_state(state)


def test_an_environment_that_never_began_has_a_state():
    env, other = make(), make()
    other.reset(seed=0)
    other.set_state(env.get_state())
    assert other.generators == [None] * 4


@pytest.mark.parametrize(
    ("name", "wrong", "message"),
    [
        ("segment", 96, r"segment.*0\.\.95.*environment 0"),
        ("segment", -1, r"segment.*environment 0"),
        ("travel", 0, r"travel.*environment 0"),
        ("pose", np.nan, r"pose.*environment 0"),
        ("time_s", np.inf, r"time_s.*environment 0"),
        ("visited", 2, r"visited.*environment 0"),
        ("visited_count", 90, r"visited_count.*environment 0"),
        ("steps", -1, r"steps.*environment 0"),
        ("idle", -1, r"idle.*environment 0"),
        ("generator", 0, r"generator.*environment 0"),
    ],
)
def test_values_that_no_episode_has_are_refused_by_name(name: str, wrong: float, message: str):
    env = make()
    env.reset(seed=0)
    before, state = env.get_state(), env.get_state()
    state[name][0] = wrong
    with pytest.raises(StateError, match=message):
        env.set_state(state)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


@pytest.mark.parametrize(("word", "value"), [(3, 0), (3, 2), (4, 2), (5, 1 << 32)])
def test_a_generator_with_a_word_that_none_has_is_refused_before_anything_changes(word: int, value: int):
    env = make()
    env.reset(seed=0)
    before, state = env.get_state(), env.get_state()
    state["generator"][1, word] = value
    with pytest.raises(StateError, match=r"generator has an impossible value.*the words of a PCG64.*environment 1"):
        env.set_state(state)
    assert all(np.array_equal(array, before[key]) for key, array in env.get_state().items())


def test_an_equal_config_written_otherwise_takes_the_state():
    env, other = make(config=EnvConfig(max_height_m=15)), make(config=EnvConfig(max_height_m=15.0))
    env.reset(seed=0)
    other.set_state(env.get_state())
    assert np.array_equal(env.state.pose, other.state.pose)
