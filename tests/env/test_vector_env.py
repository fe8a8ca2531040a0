"""Tests of the vector environment: autoreset modes, infos and masked resets."""

import re
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from tests.env.flights import FORWARD, HOVER, at
from tests.env.handmade import BlankMaskRenderer, BlankRenderer, canal, hairpin, ring
from thalweg.env import ConfigError, EnvConfig, RiverEnv, RiverVectorEnv
from thalweg.render.records.camera import Camera

NONE = EnvConfig(observation="none")
KEYS = ("cost", "costs", "done_reason", "progress", "pose")
END = (50.5, 0.0, 5.0, 0.0)
"""Nine steps before the end of a canal of 60 m."""


def two(mode: str, **options) -> RiverVectorEnv:
    """Two environments of which the first is done after 9 steps forward and the second flies on."""
    env = RiverVectorEnv(canal(), 2, EnvConfig(**{"observation": "none", **options}), autoreset_mode=mode)
    env.reset(seed=4, options={"pose": np.array([END, (10.5, 0.0, 5.0, 0.0)])})
    return env


def forward(env, steps: int):
    result = None
    for _ in range(steps):
        result = env.step(np.array([FORWARD] * env.num_envs))
    assert result is not None
    return result


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP", "DISABLED"])
def test_info_belongs_to_the_action_just_taken_in_every_mode(mode: str):
    env = two(mode)
    _, rewards, terminated, truncated, info = forward(env, 9)
    assert info["done_reason"].tolist() == [6, -1]
    assert info["pose"][0] == pytest.approx((59.5, 0.0, 5.0, 0.0))
    assert info["progress"].tolist() == [10 / 60, 10 / 60]
    assert terminated.tolist() == [True, False]
    assert not truncated.any()
    assert rewards == pytest.approx([10 / 60, 10 / 60])
    assert all(info["_" + key].tolist() == [True, True] for key in KEYS)
    assert env.metadata["autoreset_mode"] is AutoresetMode[mode]


def test_same_step_resets_at_once_and_returns_the_final_observation():
    env = two("SAME_STEP")
    observations, _, _, _, info = forward(env, 9)
    assert info["final_obs"][0] == pytest.approx((59.5, 0.0, 5.0, 0.0))
    assert info["final_obs"][1] is None
    assert info["_final_obs"].tolist() == info["_final_info"].tolist() == [True, False]
    assert info["final_info"]["done_reason"][0] == 6
    assert info["final_info"]["_done_reason"].tolist() == [True, False]
    assert info["final_info"]["pose"][0] == pytest.approx((59.5, 0.0, 5.0, 0.0))
    assert np.array_equal(observations[0], env.state.pose[0])
    assert not np.array_equal(observations[0], info["final_obs"][0])
    assert (env.state.steps.tolist(), env.state.visited_count.tolist()) == ([0, 9], [0, 10])
    assert "final_obs" not in env.step(np.array([HOVER, HOVER]))[4]


def test_next_step_spends_one_step_on_the_reset():
    env = two("NEXT_STEP")
    observations, *_ = forward(env, 9)
    assert observations[0] == pytest.approx((59.5, 0.0, 5.0, 0.0))
    observations, rewards, terminated, truncated, info = forward(env, 1)
    assert (rewards[0], terminated[0], truncated[0]) == (0.0, False, False)
    assert (info["cost"][0], info["done_reason"][0], info["progress"][0]) == (0.0, -1, 0.0)
    assert np.array_equal(observations[0], env.state.pose[0])
    assert env.state.steps.tolist() == [0, 10]
    forward(env, 1)
    assert env.state.steps.tolist() == [1, 11]


def test_disabled_waits_for_a_reset_of_those_that_ended():
    env = two("DISABLED")
    forward(env, 9)
    with pytest.raises(ResetNeeded, match=r"\[0\]"):
        forward(env, 1)
    observations, info = env.reset(options={"reset_mask": np.array([True, False])})
    assert observations[1] == pytest.approx((19.5, 0.0, 5.0, 0.0))
    assert info["_pose"].tolist() == [True, False]
    forward(env, 1)
    assert env.state.steps.tolist() == [1, 10]


def test_a_masked_reset_leaves_the_other_episodes_alone():
    env = two("SAME_STEP")
    forward(env, 3)
    before = env.get_state()
    env.reset(seed=11, options={"reset_mask": np.array([True, False])})
    after = env.get_state()
    for key in ("pose", "visited", "steps", "generator", "time_s"):
        assert np.array_equal(before[key][1], after[key][1])
        assert key == "visited" or not np.array_equal(before[key][0], after[key][0])


@pytest.mark.parametrize("mask", [np.array([1, 0]), np.array([True]), np.array([False, False])])
def test_a_bad_reset_mask_is_refused(mask):
    with pytest.raises(ConfigError, match="reset_mask"):
        two("SAME_STEP").reset(options={"reset_mask": mask})


def test_step_before_reset_is_refused():
    with pytest.raises(ResetNeeded):
        RiverVectorEnv(canal(), 1, NONE).step(np.array([HOVER]))


@pytest.mark.parametrize(
    ("what", "asked"),
    [
        ("render()", lambda env: env.render()),
        ("observe()", lambda env: env.observe()),
        ("ideal_eye()", lambda env: env.ideal_eye()),
        ("camera_matrices", lambda env: env.camera_matrices),
        ("asking a pilot", lambda env: env.pilot_actions()),
        ("asking a pilot", lambda env: env.move_worths()),
    ],
)
def test_what_shows_a_state_is_refused_before_there_is_one(what, asked):
    renderer = BlankRenderer() if what == "render()" else None
    env = RiverVectorEnv(canal(), 2, NONE, renderer=renderer, render_mode="rgb_array")
    with pytest.raises(ResetNeeded, match=re.escape(f"call reset() before {what}")):
        asked(env)
    env.reset(seed=0)
    assert len(asked(env)) > 0


@pytest.mark.parametrize("seed", [7, np.int64(7), np.array(7)], ids=repr)
def test_its_own_generator_is_that_of_the_seed(seed: Any):
    env = RiverVectorEnv(canal(), 2, NONE)
    env.reset(seed=seed)
    assert env.np_random_seed == 7
    assert env.np_random.integers(2**62) == np.random.default_rng(7).integers(2**62)


def test_an_environment_flies_alike_alone_and_among_others():
    many = RiverVectorEnv([ring(), hairpin()], 6, NONE)
    alone = RiverVectorEnv(hairpin(), 1, NONE)
    many.reset(seed=20)
    alone.reset(seed=23)
    rng = np.random.default_rng(0)
    for _ in range(300):
        actions = rng.integers(0, 3, size=(6, 4))
        seen, rewards, *_, info = many.step(actions)
        seen_alone, rewards_alone, *_, info_alone = alone.step(actions[3:4])
        assert np.array_equal(seen[3], seen_alone[0])
        assert rewards[3] == rewards_alone[0]
        assert all(np.array_equal(info[key][3], info_alone[key][0]) for key in KEYS)


def test_the_same_seed_gives_the_same_episodes_and_another_seed_others():
    def flown(seed: int) -> np.ndarray:
        env = RiverVectorEnv(ring(), 3, NONE)
        env.reset(seed=seed)
        rng = np.random.default_rng(0)
        return np.array([env.step(rng.integers(0, 3, size=(3, 4)))[4]["pose"] for _ in range(100)])

    assert np.array_equal(flown(1), flown(1))
    assert not np.array_equal(flown(1), flown(9))


def test_a_reset_without_a_seed_continues_the_random_sequence():
    env = RiverVectorEnv(ring(), 2, NONE)
    first, _ = env.reset(seed=0)
    second, _ = env.reset()
    assert not np.array_equal(first, second)


def test_seeds_may_be_listed():
    env = RiverVectorEnv(ring(), 2, NONE)
    listed, _ = env.reset(seed=[5, 9])
    assert np.array_equal(listed[1], RiverEnv(ring(), NONE).reset(seed=9)[0])
    with pytest.raises(ConfigError, match="3 seeds for 2"):
        env.reset(seed=[1, 2, 3])


@pytest.mark.parametrize(
    ("kind", "shape"), [("rgb+mask", (8, 8, 4)), ("rgb", (8, 8, 3)), ("mask", (8, 8, 1)), ("none", (4,))]
)
def test_what_is_seen_is_chosen_by_the_config(kind: str, shape):
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation=kind), renderer=BlankRenderer())  # pyright: ignore[reportArgumentType]
    observations, _ = env.reset(seed=0)
    assert observations.shape == (2, *shape)
    assert observations in env.observation_space
    frames = BlankRenderer().render(env.state.pose, env.world_index, env.state.time_s)
    expected = {"rgb+mask": frames, "rgb": frames[..., :3], "mask": frames[..., 3:], "none": env.state.pose}[kind]
    assert np.array_equal(observations, expected)


def test_a_dict_holds_colours_and_mask():
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation="dict", max_steps=1), renderer=BlankRenderer())
    env.reset(seed=0)
    observations, _, _, _, info = env.step(np.array([HOVER, HOVER]))
    assert observations in env.observation_space
    assert (observations["rgb"].shape, observations["mask"].shape) == ((2, 8, 8, 3), (2, 8, 8, 1))
    frames = BlankRenderer().render(env.state.pose, env.world_index, env.state.time_s)
    assert np.array_equal(observations["rgb"], frames[..., :3])
    assert np.array_equal(observations["mask"], frames[..., 3:])
    last = BlankRenderer().render(info["pose"], env.world_index, env.state.time_s)
    assert np.array_equal(info["final_obs"][1]["rgb"][0], last[1, 0, :, :3])


def test_the_last_frame_of_an_episode_shows_its_last_pose_with_one_call_of_the_renderer():
    blank = BlankRenderer()
    env = RiverVectorEnv(ring(), 3, EnvConfig(max_steps=1), renderer=blank)
    _, info = env.reset(seed=0)
    observations, _, _, _, info = env.step(np.array([HOVER] * 3))
    assert blank.calls == [3, 6]
    assert np.array_equal(info["final_obs"][2][0, :4, 0], np.mod(info["pose"][2] * 16, 256).astype(np.uint8))
    assert np.array_equal(observations[2][0, :4, 0], np.mod(env.state.pose[2] * 16, 256).astype(np.uint8))


def test_what_was_returned_is_never_written_again():
    env = RiverVectorEnv(ring(), 2, EnvConfig(), renderer=BlankRenderer())
    env.reset(seed=0)
    results = [env.step(np.array([FORWARD, FORWARD])) for _ in range(2)]
    kept = [[np.array(value) for value in (*results[0][:4], results[0][4]["pose"])]]
    env.step(np.array([FORWARD, FORWARD]))
    assert all(np.array_equal(a, b) for a, b in zip(kept[0], (*results[0][:4], results[0][4]["pose"]), strict=True))
    assert not np.shares_memory(results[0][0], results[1][0])


def test_render_gives_the_frames_now_seen():
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation="mask"), renderer=BlankRenderer(), render_mode="rgb_array")
    env.reset(seed=0)
    frames = env.render()
    assert frames is not None
    assert [frame.shape for frame in frames] == [(8, 8, 3)] * 2
    assert np.array_equal(frames[1][0, :4, 0], np.mod(env.state.pose[1] * 16, 256).astype(np.uint8))
    assert RiverVectorEnv(ring(), 2, NONE).render() is None


def test_masks_are_drawn_without_frames_until_a_frame_is_asked_for():
    blank = BlankMaskRenderer()
    config = EnvConfig(observation="mask", max_steps=1)
    env = RiverVectorEnv(ring(), 2, config, renderer=blank, render_mode="rgb_array")
    env.reset(seed=0)
    observations, _, _, _, info = env.step(np.array([HOVER, HOVER]))
    assert observations in env.observation_space
    for shown, poses in ((observations, env.state.pose), (info["final_obs"], info["pose"])):
        assert np.array_equal(shown[1][0, :4, 0], np.mod(poses[1] * 16.0, 256.0).astype(np.uint8))
    assert (blank.mask_calls, blank.frame_calls) == (2, 0)
    frames = env.render()
    assert frames is not None and (frames[1] == 7).all()
    assert (blank.mask_calls, blank.frame_calls) == (2, 1)


def test_the_water_moves_by_one_tick_a_step():
    env = at(canal(), (10.5, 0.0, 5.0, 0.0), step_s=0.5)
    before = env.state.time_s[0]
    forward(env, 3)
    assert env.state.time_s[0] == pytest.approx(before + 1.5)


def test_worlds_are_dealt_out_in_turn():
    assert RiverVectorEnv([ring(), hairpin(), canal()], 7, NONE).world_index.tolist() == [0, 1, 2, 0, 1, 2, 0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"num_envs": 1, "autoreset_mode": "SOMETIMES"}, "known: NEXT_STEP, SAME_STEP, DISABLED"),
        ({"num_envs": 1.5}, "num_envs"),
        ({"num_envs": 1, "render_mode": "human"}, "known: rgb_array"),
    ],
)
def test_bad_arguments_list_the_known_ones(wrong, message):
    with pytest.raises(ConfigError, match=message):
        RiverVectorEnv(ring(), config=NONE, **wrong)


def test_gymnasiums_wrappers_read_the_info():
    env = RecordEpisodeStatistics(two("SAME_STEP"))
    env.reset(seed=4, options={"pose": np.array([END, (10.5, 0.0, 5.0, 0.0)])})
    info = forward(env, 9)[4]
    assert info["episode"]["r"][0] == pytest.approx(10 * 10 / 60)
    assert info["episode"]["l"][0] == 9
    listed = DictInfoToList(two("SAME_STEP"))
    infos = forward(listed, 9)[4]
    assert [one["done_reason"] for one in infos] == [6, -1]
    assert "final_info" not in infos[1]


def test_one_environment_is_a_vector_of_one():
    single, vector = RiverEnv(ring(), NONE), RiverVectorEnv(ring(), 1, NONE, autoreset_mode="DISABLED")
    first, info = single.reset(seed=3)
    firsts, infos = vector.reset(seed=3)
    assert np.array_equal(first, firsts[0])
    for _ in range(30):
        seen, reward, terminated, truncated, info = single.step(np.array(FORWARD))
        seens, rewards, terminations, truncations, infos = vector.step(np.array([FORWARD]))
        assert np.array_equal(seen, seens[0])
        assert (reward, terminated, truncated) == (rewards[0], terminations[0], truncations[0])
        assert (info["cost"], info["done_reason"], info["progress"]) == tuple(
            infos[key][0] for key in ("cost", "done_reason", "progress")
        )
        assert info["done_reason"].dtype == np.int64
        if terminated or truncated:
            break
    assert np.array_equal(single.pilot_action(), vector.pilot_actions()[0])


class WorldsRenderer(BlankRenderer):
    """One that says which worlds it draws, and through which camera."""

    def __init__(self, worlds, camera: Camera | None = None) -> None:
        super().__init__()
        self.worlds, self.camera = tuple(worlds), camera or Camera(16, 16)


@pytest.mark.parametrize("worlds", [[hairpin(), ring()], [ring()], [ring(), hairpin(width_m=5.9)]])
def test_a_renderer_of_other_worlds_is_refused(worlds):
    with pytest.raises(ConfigError, match="renderer draws other worlds"):
        RiverVectorEnv([ring(), hairpin()], 2, renderer=WorldsRenderer(worlds))


def test_a_renderer_of_equal_worlds_is_taken():
    env = RiverVectorEnv([ring(), hairpin()], 2, renderer=WorldsRenderer([ring(), hairpin()]))
    assert env.reset(seed=0)[0].shape == (2, 16, 16, 4)


def test_a_camera_that_the_renderer_does_not_have_is_refused():
    config = EnvConfig(camera=Camera(16, 16, fov_deg=50.0))
    with pytest.raises(ConfigError, match=r"config\.camera.*renderer"):
        RiverVectorEnv(ring(), 1, config, renderer=WorldsRenderer([ring()]))
    env = RiverVectorEnv(ring(), 1, config, renderer=WorldsRenderer([ring()], Camera(16, 16, fov_deg=50.0)))
    assert env.camera == config.camera


def test_objects_are_refused_before_there_is_a_state():
    env = RiverVectorEnv(canal(), 2, EnvConfig(observation="none", task="Portage"))
    with pytest.raises(ResetNeeded, match=re.escape("props()")):
        env.props()


def test_steps_without_time_are_shown_as_fast_as_usual():
    env = RiverVectorEnv(ring(), 1, EnvConfig(observation="none", step_s=0.0))
    assert env.metadata["render_fps"] == 4
