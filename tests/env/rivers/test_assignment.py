"""Tests of environments that change river with each episode."""

import gc
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.env.flights import HOVER
from tests.env.handmade import BlankRenderer, canal, hairpin, ring
from tests.env.test_snapshot import flown
from thalweg.env import ConfigError, EnvConfig, RiverVectorEnv, StateError, make_vector
from thalweg.env.rivers import bare_river, sounded_river
from thalweg.env.rivers.assignment import DrawnRivers
from thalweg.env.rivers.bare_river import bare_path, load_or_plan
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.rivers.sounded_river import sounded_path
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.torch_env import TensorRiverEnv
from thalweg.render import Camera, Randomisation, Renderer
from thalweg.world import LEVELS, World, level_named, load_or_build

PRIVILEGED = EnvConfig(observation="privileged", max_steps=9)
MODES = ["SAME_STEP", "NEXT_STEP"]


def worlds(count: int = 12) -> list[World]:
    """Courses of different shape and length."""
    return [(ring, hairpin)[index % 2](20.0 + index, name=f"river {index}") for index in range(count)]


def make(num_envs: int = 3, in_memory: int | None = None, mode: str = "SAME_STEP", count: int = 12) -> RiverVectorEnv:
    return RiverVectorEnv(RiverList(worlds(count), in_memory), num_envs, PRIVILEGED, autoreset_mode=mode)


def rivers_flown(env: RiverVectorEnv, steps: int) -> np.ndarray:
    """The river [steps, N] of each step, with episodes of nine steps."""
    return np.array([env.step(np.array([HOVER] * env.num_envs))[4]["river"] for _ in range(steps)])


def test_each_episode_is_in_a_river_of_its_own_and_all_come_up():
    env = make()
    _, info = env.reset(seed=0)
    rivers = rivers_flown(env, 9 * 60)
    assert np.array_equal(info["river"], rivers[0])
    episodes = rivers.reshape(60, 9, 3)
    assert (episodes == episodes[:, :1]).all()
    drawn = episodes[:, 0]
    counts = np.bincount(drawn.ravel(), minlength=12)
    # 180 draws of 12 rivers: 15 each, with a standard deviation of 3.7.
    assert counts.min() >= 4 and counts.max() <= 26
    assert (drawn[:, 0] != drawn[:, 1]).mean() > 0.8
    env.close()


class Broken(RiverList):
    """A list whose rivers cannot be loaded any more, once they are `broken`."""

    broken = False

    def course(self, index: int) -> World:
        if self.broken:
            raise KeyboardInterrupt(f"while river {index} was loaded")
        return super().course(index)


@pytest.mark.parametrize("steps", range(6, 14))
def test_an_error_while_a_river_is_loaded_leaves_an_environment_that_can_be_reset(steps: int):
    rivers = Broken(worlds(), in_memory=6)
    env = RiverVectorEnv(rivers, 2, PRIVILEGED)
    env.reset(seed=0)
    rivers_flown(env, steps)
    state = env.get_state()
    assert isinstance(env.rivers, DrawnRivers)
    pool = env.rivers.pool
    rivers.broken = True
    with pytest.raises(KeyboardInterrupt):
        rivers_flown(env, 100)
    with pytest.raises(KeyboardInterrupt):
        for seed in range(100):
            env.reset(seed=seed)
    rivers.broken = False
    if steps % 2:  # a state can be restored without a reset before
        env.set_state(state)
    for seed in range(5):
        env.reset(seed=seed)
        assert min(pool._uses) >= 0 and sum(pool._uses) == 2
        other = RiverVectorEnv(RiverList(worlds(), in_memory=6), 2, PRIVILEGED)
        other.reset(seed=seed)
        np.testing.assert_array_equal(rivers_flown(env, 40), rivers_flown(other, 40))
        other.close()
    env.close()


def test_an_error_while_a_state_is_restored_changes_nothing():
    rivers = Broken(worlds(), in_memory=6)
    env = RiverVectorEnv(rivers, 2, PRIVILEGED)
    env.reset(seed=0)
    states = [env.get_state()]
    for _ in range(6):
        rivers_flown(env, 9)
        states.append(env.get_state())
    assert isinstance(env.rivers, DrawnRivers)
    rivers.broken = True
    refused = 0
    for state in states:
        try:
            env.set_state(state)
        except KeyboardInterrupt:
            refused += 1
        assert sum(env.rivers.pool._uses) == 2 and min(env.rivers.pool._uses) >= 0
    assert refused
    env.close()


def test_an_environment_that_is_dropped_ends_its_thread_and_frees_its_rivers():
    env = make(2, in_memory=6)
    env.reset(seed=0)
    rivers_flown(env, 20)
    assert isinstance(env.rivers, DrawnRivers) and env.rivers.pool._worker is not None
    pool, thread = weakref.ref(env.rivers.pool), env.rivers.pool._worker._thread
    del env
    gc.collect()
    thread.join(30)
    assert not thread.is_alive()
    gc.collect()
    assert pool() is None


def test_no_rivers_load_nothing():
    env = make()
    assert isinstance(env.rivers, DrawnRivers)
    assert list(env.rivers.loaded(np.empty(0, np.int64))) == []
    env.close()


def test_rivers_without_land_are_stored_under_the_code_that_makes_them(monkeypatch: pytest.MonkeyPatch):
    for module, path in ((bare_river, bare_path), (sounded_river, sounded_path)):
        usual = path(LEVELS["Easy"], 3)
        monkeypatch.setattr(module, "BUILT_BY", "0" * 8)
        assert usual.parent == path(LEVELS["Easy"], 3).parent and usual.name != path(LEVELS["Easy"], 3).name


@pytest.mark.parametrize("mode", MODES)
def test_the_memory_of_rivers_changes_no_number(mode: str):
    whole, tight = make(mode=mode), make(in_memory=9, mode=mode)
    for env in (whole, tight):
        env.reset(seed=5)
    for a, b in zip(flown(whole, 300, seed=1), flown(tight, 300, seed=1), strict=True):
        assert np.array_equal(a, b)
    assert tight.rivers.pool.slots == 6  # pyright: ignore[reportAttributeAccessIssue]
    assert tight.rivers.pool.most_loaded <= 9  # pyright: ignore[reportAttributeAccessIssue]
    for env in (whole, tight):
        env.close()


def test_an_environment_draws_the_same_rivers_alone_and_among_others():
    many, alone = make(6), make(1)
    many.reset(seed=20)
    alone.reset(seed=23)
    assert np.array_equal(rivers_flown(many, 90)[:, 3], rivers_flown(alone, 90)[:, 0])


def test_an_episode_is_flown_by_the_rules_of_its_river():
    env = make()
    env.reset(seed=0)
    rng = np.random.default_rng(1)
    for _ in range(40):
        before = env.state.pose.copy(), env.state.travel.copy(), env.rivers.state()["river"]
        actions = rng.integers(0, 3, size=(3, 4))
        seen, *_, info = env.step(actions)
        for row in range(3):
            single = RiverVectorEnv(worlds()[before[2][row]], 1, PRIVILEGED, autoreset_mode="DISABLED")
            single.reset(seed=0, options={"pose": before[0][row]})
            single.state.travel[0] = before[1][row]
            alone, *_, info_alone = single.step(actions[row : row + 1])
            assert np.allclose(info["pose"][row], info_alone["pose"][0], atol=0, rtol=0)
            last = info.get("final_obs", [None] * 3)[row]
            assert np.array_equal(seen[row] if last is None else last, alone[0])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("steps", [0, 1, 8, 9, 10, 37])
def test_a_resumed_run_is_equal_to_the_bit_at_any_moment(mode: str, steps: int):
    env = make(in_memory=9, mode=mode)
    env.reset(seed=0)
    flown(env, steps, seed=1)
    state = env.get_state()
    expected = flown(env, 100, seed=2)
    other = make(mode=mode)
    other.set_state(state)
    assert all(np.array_equal(a, b) for a, b in zip(expected, flown(other, 100, seed=2), strict=True))
    env.set_state(state)
    assert all(np.array_equal(a, b) for a, b in zip(expected, flown(env, 100, seed=2), strict=True))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("river", 12, r"^river has an impossible value, 12; allowed: 0\.\.11 \(environment 1\)"),
        ("next_river", -2, r"next_river has an impossible value, -2; allowed: -1\.\.11 \(environment 1\)"),
        ("segment", 500, r"segment has an impossible value, 500; allowed: 0\.\.\d+ \(environment 1\)"),
    ],
)
def test_a_state_with_rivers_that_are_not_there_is_refused(name: str, value: int, message: str):
    env = make()
    env.reset(seed=0)
    state, before = env.get_state(), env.get_state()
    state[name][1] = value
    with pytest.raises(StateError, match=message):
        env.set_state(state)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


def test_a_state_of_other_rivers_is_refused():
    env, fixed = make(), RiverVectorEnv(worlds(), 3, PRIVILEGED)
    env.reset(seed=0)
    fixed.reset(seed=0)
    with pytest.raises(StateError, match="other worlds"):
        make(count=11).set_state(env.get_state())
    with pytest.raises(StateError, match=r"lacks \['next_river', 'river'\]"):
        env.set_state(fixed.get_state())


def test_a_new_seed_draws_new_rivers_and_an_old_one_the_old():
    env = make(1)
    env.reset(seed=0)
    first = rivers_flown(env, 60)
    env.reset(seed=1)
    assert not np.array_equal(rivers_flown(env, 60), first)
    env.reset(seed=0)
    assert np.array_equal(rivers_flown(env, 60), first)


def test_a_pose_is_refused_because_it_lies_in_one_river():
    with pytest.raises(ConfigError, match="stay in one river"):
        make().reset(seed=0, options={"pose": [10.5, 0.0, 5.0, 0.0]})


def test_the_pilot_flies_whatever_river_an_episode_is_in():
    env = RiverVectorEnv(RiverList([ring(), hairpin(), canal()]), 2, EnvConfig(observation="none"))
    env.reset(seed=0)
    reasons = []
    for _ in range(120):
        *_, info = env.step(env.pilot_actions())
        reasons += info["done_reason"][info["done_reason"] >= 0].tolist()
    assert len(reasons) >= 3
    assert set(reasons) == {6}


def test_rivers_without_land_have_the_courses_of_the_whole_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    config = EnvConfig(observation="none")
    expected = pack_courses([load_or_build("Medium")], config)
    monkeypatch.setenv("THALWEG_CACHE", str(tmp_path))
    level, seed = level_named("Medium"), LEVELS["Medium"].default_seed
    for _ in range(2):
        found = pack_courses([load_or_plan(level, seed)], config)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
        assert bare_path(level, seed).is_file()
    bare_path(level, seed).write_bytes(b"damaged")
    assert np.array_equal(pack_courses([load_or_plan(level, seed)], config).position, expected.position)
    assert bare_path(level, seed).stat().st_size > 1000


def test_a_list_of_levels_and_seeds_names_its_rivers():
    rivers = RiverList.of_levels([("easy", "3 10:12"), ("Hard", range(2))])
    assert rivers.names == ["Easy-3", "Easy-10", "Easy-11", "Hard-0", "Hard-1"]
    assert rivers.most_segments == LEVELS["Hard"].samples
    other = RiverList.of_levels([("easy", "3 10:12"), ("Hard", [1, 0])])
    assert not np.array_equal(rivers.identity(), other.identity())


@pytest.mark.slow
def test_frames_show_the_river_of_each_episode(easy_world: World, medium_world: World, hard_world: World):
    shown = [easy_world, medium_world, hard_world, replace(easy_world, name="Easy again")]
    config = EnvConfig(camera=Camera(16, 16), max_steps=4)
    env = RiverVectorEnv(RiverList(shown, in_memory=3), 1, config)
    renderer = Renderer(shown, config.camera)
    env.reset(seed=0)
    flown_in, last_time = set(), 0.0
    for _ in range(24):
        frames, *_, info = env.step(np.array([HOVER]))
        river = info["river"][0]
        flown_in.add(int(river))
        if "final_obs" in info:
            frames, time_s = [info["final_obs"][0]], last_time + config.step_s
        else:
            time_s = env.state.time_s[0]
        last_time = env.state.time_s[0]
        assert np.array_equal(frames[0], renderer.render(info["pose"], [river], time_s)[0])
    assert len(flown_in) >= 3
    pool = env.rivers.pool  # pyright: ignore[reportAttributeAccessIssue]
    assert (pool.slots, pool.most_loaded) == (2, 3)
    env.close()


def test_what_rivers_that_change_cannot_have_is_refused(easy_world: World):
    rivers = RiverList([easy_world])
    with pytest.raises(ConfigError, match="renderer of their own"):
        RiverVectorEnv(rivers, 1, renderer=BlankRenderer())
    with pytest.raises(ConfigError, match="tensors do not change river"):
        TensorRiverEnv(rivers, 1, device="cpu")  # pyright: ignore[reportArgumentType]


def test_each_river_that_changes_has_a_sun_of_its_own(easy_world: World):
    ranges = Randomisation.only(sun_azimuth_deg=(0.0, 360.0), sun_elevation_deg=(25.0, 60.0), suns=3)
    env = RiverVectorEnv(RiverList([easy_world]), 1, EnvConfig(randomisation=ranges))
    frames, info = env.reset(seed=0)
    ((azimuth, elevation),) = replace(ranges, suns=1).lights(easy_world.seed)
    renderer = Renderer([easy_world.relit(azimuth, elevation)])
    assert np.array_equal(frames[0], renderer.render(info["pose"], [0], env.state.time_s)[0])
    env.close()


@pytest.mark.parametrize("in_memory", [2.5, 0, True])
def test_a_number_of_rivers_in_memory_that_is_not_whole_is_refused(in_memory: Any, easy_world: World):
    with pytest.raises(ConfigError, match=f"in_memory must be a whole number of at least 1, not {in_memory}"):
        RiverList([easy_world], in_memory)


@pytest.mark.parametrize("observation", ["none", "rgb+mask"])
@pytest.mark.parametrize("kind", [RiverVectorEnv, TensorRiverEnv])
def test_no_worlds_are_refused(kind: Any, observation: Any):
    with pytest.raises(ConfigError, match="worlds must hold at least one river"):
        kind([], 2, EnvConfig(observation=observation))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"world_seeds": "9:3"}, "world_seeds: 9:3 holds no seed; write 3:9"),
        ({"world_seeds": ()}, "at least one seed"),
        ({"rivers": "sometimes"}, "rivers must be 'fixed' or 'episode'"),
    ],
)
def test_wrong_lists_of_rivers_are_refused(wrong: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        make_vector("Medium", 2, observation="none", **wrong)


def test_gymnasium_makes_environments_that_change_river():
    env = make_vector("Medium", 2, world_seeds="1:3", rivers="episode", observation="none", max_steps=5)
    env.reset(seed=0)
    assert env.river_names == ["Medium-1", "Medium-2"]
    assert set(rivers_flown(env, 100).ravel()) == {0, 1}
    env.close()


def test_closing_ends_what_runs_in_the_background():
    env = make(2, in_memory=6)
    env.reset(seed=0)
    rivers_flown(env, 20)
    assert isinstance(env.rivers, DrawnRivers) and env.rivers.pool._worker is not None
    thread = env.rivers.pool._worker._thread
    env.close()
    assert not thread.is_alive()
