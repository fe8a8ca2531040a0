"""Tests of observations that are dictionaries: each part is what it is alone, and nothing else is drawn."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from tests.env.flights import FORWARD
from tests.env.handmade import BlankRenderer, canal, ring
from tests.render.plain import plane
from thalweg.env import ConfigError, EnvConfig, RiverEnv, RiverVectorEnv, StateError
from thalweg.env.observation import PARTS
from thalweg.env.rivers.river_list import RiverList
from thalweg.render import Camera, Renderer
from thalweg.render.optics.lens import Lens
from thalweg.render.records.appearance import PARAMETERS
from thalweg.render.records.randomisation import Randomisation

SMALL = Camera(24, 32)
ALL = ",".join(PARTS)


def worlds() -> list:
    """Two rivers that need not be built: a plane, and a slope with water on one side."""
    return [plane(water_level=1.0), plane(slope_y=0.05, water_level=0.2)]


def made(
    observation, *, mode: str = "SAME_STEP", rivers=None, num_envs: int = 3, lens=None, **options
) -> RiverVectorEnv:
    config = EnvConfig(observation=observation, camera=replace(SMALL, lens=lens), **options)
    return RiverVectorEnv(rivers or worlds(), num_envs, config, autoreset_mode=mode)


def flown(env: RiverVectorEnv, steps: int, seed: int = 0) -> list[tuple]:
    """What reset and random steps return."""
    random = np.random.default_rng(seed)
    return [env.reset(seed=seed), *(env.step(random.integers(0, 3, (env.num_envs, 4))) for _ in range(steps))]


def same(one, other) -> None:
    """Both are dictionaries of the same arrays to the bit."""
    assert list(one) == list(other)
    for key in one:
        assert one[key].dtype == other[key].dtype
        np.testing.assert_array_equal(one[key], other[key])


class SpyRenderer(Renderer):
    """A renderer that notes what it is asked to draw."""

    def __init__(self, *args, **options) -> None:
        super().__init__(*args, **options)
        self.asked: list[str] = []

    def render(self, *args, **options):
        self.asked.append("frame")
        return super().render(*args, **options)

    def render_mask(self, *args, **options):
        self.asked.append("mask")
        return super().render_mask(*args, **options)

    def render_layers(self, *args, **options):
        self.asked.append("+".join(options["layers"]))
        return super().render_layers(*args, **options)


@pytest.mark.parametrize("observation", [ALL, "rgb,mask,privileged", "mask,proprioception", "mask,depth", "rgb,class"])
def test_each_part_is_what_it_is_alone(observation: str):
    results = flown(made(observation), 12)
    parts = observation.split(",")
    alone = {part: flown(made(part), 12) for part in parts}
    renderer = Renderer(worlds(), SMALL)
    for step, (obs, *_, info) in enumerate(results):
        assert set(obs) == set(parts)
        for part in parts:
            single = alone[part][step][0]
            np.testing.assert_array_equal(obs[part], single[part] if isinstance(single, dict) else single)
        env = made("none")
        if "done_reason" in info and (info["done_reason"] < 0).all():
            layers = renderer.render_layers(info["pose"], env.world_index)
            for part, layer in (("depth", layers.depth_m), ("class", layers.class_id)):
                if part in parts:
                    np.testing.assert_array_equal(obs[part], layer[..., None])


@pytest.mark.parametrize(
    ("observation", "asked"),
    [
        ("mask,proprioception", ["mask"]),
        (("mask",), ["mask"]),
        ("rgb,privileged", ["frame"]),
        ("rgb,mask", ["frame"]),
        ("depth", ["depth_m"]),
        ("mask,class", ["mask+class_id"]),
        ("rgb,depth", ["rgb+depth_m"]),
        ("proprioception,privileged", []),
    ],
)
def test_only_what_is_asked_for_is_drawn(observation, asked: list[str]):
    renderer = SpyRenderer(worlds(), SMALL)
    env = RiverVectorEnv(worlds(), 2, EnvConfig(observation=observation), renderer=renderer)
    env.reset(seed=0)
    assert renderer.asked == asked


def test_colours_of_observations_are_not_drawn_again_for_pictures():
    for observation, asked in (
        ("rgb,depth", ["rgb+depth_m"]),
        ("rgb,mask", ["frame"]),
        ("class", ["class_id", "frame"]),
    ):
        renderer = SpyRenderer(worlds(), SMALL)
        config = EnvConfig(observation=observation)  # pyright: ignore[reportArgumentType]
        env = RiverVectorEnv(worlds(), 2, config, renderer=renderer, render_mode="rgb_array")
        obs, _ = env.reset(seed=0)
        pictures = env.render()
        assert renderer.asked == asked
        assert pictures is not None and pictures[1].shape == (24, 32, 3)
        np.testing.assert_array_equal(pictures, obs.get("rgb", pictures))


@pytest.mark.parametrize("mode", list(AutoresetMode), ids=lambda mode: mode.name)
def test_last_observations_have_all_parts_of_the_last_state_in_every_mode(mode: AutoresetMode):
    env = made("mask,depth,proprioception,privileged", mode=mode.name, max_steps=4)
    env.reset(seed=3)
    actions = np.array([FORWARD] * 3)
    for _ in range(3):
        before, *_ = env.step(actions)
    poses = env.state.pose.copy()
    obs, _, _, truncated, info = env.step(actions)
    assert truncated.all()
    last = obs
    if mode is AutoresetMode.SAME_STEP:
        last = {key: np.stack([final[key] for final in info["final_obs"]]) for key in obs}
        assert (obs["proprioception"][:, 1:] == 0).all()
        np.testing.assert_allclose(obs["proprioception"][:, 0], env.state.pose[:, 2])
    moved = info["pose"][:, :2] - poses[:, :2]
    np.testing.assert_allclose(last["proprioception"][:, 1], np.linalg.norm(moved, axis=1) / 0.25, rtol=1e-6)
    assert (last["proprioception"][:, 7] == 1).all()
    np.testing.assert_allclose(last["privileged"][:, 3], info["pose"][:, 2], rtol=1e-6)
    drawn = Renderer(worlds(), SMALL).render_layers(info["pose"], env.world_index)
    np.testing.assert_array_equal(last["depth"], drawn.depth_m[..., None])
    np.testing.assert_array_equal(last["mask"] > 0, drawn.mask[..., None])
    assert not np.array_equal(before["depth"], last["depth"])
    if mode is AutoresetMode.NEXT_STEP:
        obs, *_ = env.step(actions)
    elif mode is AutoresetMode.DISABLED:
        obs, _ = env.reset(options={"reset_mask": np.array([True, False, True])})
        np.testing.assert_array_equal(obs["proprioception"][1], last["proprioception"][1])
        obs = {key: value[[0, 2]] for key, value in obs.items()}
    assert (obs["proprioception"][:, 1:] == 0).all()


def test_one_environment_has_the_observations_of_a_vector_of_one():
    config = EnvConfig(observation=ALL, camera=SMALL)  # pyright: ignore[reportArgumentType]
    one, many = RiverEnv(worlds()[1], config), RiverVectorEnv(worlds()[1], 1, config, autoreset_mode="DISABLED")
    obs, _ = one.reset(seed=5)
    theirs, _ = many.reset(seed=5)
    for _ in range(3):
        assert obs in one.observation_space
        same(obs, {key: value[0] for key, value in theirs.items()})
        obs, theirs = one.step(FORWARD)[0], many.step(np.array([FORWARD]))[0]
    same(one.observe(), obs)


def test_gymnasiums_checker_only_warns_of_numbers_without_bounds():
    env = gymnasium.make("thalweg/Medium-v0", world=worlds()[0], observation=ALL, camera=SMALL, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*imum value is -?infinity.*")
        check_env(env.unwrapped)


def test_looks_change_depth_as_they_change_frames():
    lens = Randomisation(pitch_deg=(-8.0, 8.0), fov_deg=(-10.0, 10.0), suns=0)
    env = made("rgb,mask,depth,class", randomisation=lens)
    obs, info = env.reset(seed=2)
    frames = made("rgb+mask", randomisation=lens).reset(seed=2)[0]
    np.testing.assert_array_equal(np.concatenate([obs["rgb"], obs["mask"]], -1), frames)
    drawn = Renderer(worlds(), SMALL).render_layers(info["pose"], env.world_index, look=env.frames.look)
    np.testing.assert_array_equal(obs["depth"], drawn.depth_m[..., None])
    np.testing.assert_array_equal(obs["class"], drawn.class_id[..., None])
    assert len({float(look) for look in env.frames.look[:, 8]}) == 3


def test_rivers_that_change_have_all_parts_of_the_rivers_they_are():
    env = made(ALL, rivers=RiverList([*worlds(), plane(water_level=2.0)]), max_steps=3)
    renderer = Renderer([*worlds(), plane(water_level=2.0)], SMALL)
    seen = set()
    for obs, *_, info in flown(env, 25, seed=4):
        finals = info.get("final_obs", [None] * 3)
        river = info["river"]
        last = renderer.render_layers(info["pose"], river)
        for row in range(3):
            now = obs if finals[row] is None else {key: value[None] for key, value in finals[row].items()}
            at = row if finals[row] is None else 0
            np.testing.assert_array_equal(now["depth"][at], last.depth_m[row, ..., None])
            np.testing.assert_array_equal(now["class"][at], last.class_id[row, ..., None])
            assert now["proprioception"][at, 0] == pytest.approx(info["pose"][row, 2])
            seen.add((int(river[row]), finals[row] is None))
    assert len(seen) > 4
    env.close()


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_a_run_resumes_to_the_bit(mode: str):
    env = made("depth,proprioception", mode=mode, max_steps=9)
    flown(env, 13)
    state = env.get_state()
    seen = env.observe()
    actions = np.random.default_rng(1).integers(0, 3, (20, 3, 4))
    expected = [env.step(action)[0] for action in actions]
    other = made("depth,proprioception", mode=mode, max_steps=9)
    other.set_state(state)
    same(other.observe(), seen)
    for action, obs in zip(actions, expected, strict=True):
        same(other.step(action)[0], obs)


def test_the_last_step_is_part_of_a_state_only_where_it_is_felt():
    felt, others = made("proprioception"), made("mask,privileged")
    for env in (felt, others):
        env.reset(seed=0)
    felt.step(np.array([FORWARD] * 3))
    state = felt.get_state()
    assert set(state) - set(others.get_state()) == {"last_pose", "last_action"}
    assert state["last_action"].tolist() == [[0, 0, 1, 0]] * 3
    assert not np.array_equal(state["last_pose"], state["pose"])
    state["last_pose"][1, 2] = np.nan
    with pytest.raises(StateError, match=r"last_pose has .*nan.*; allowed: finite numbers \(environment 1\)"):
        felt.set_state(state)


def test_critics_see_what_the_ideal_eye_sees_unless_the_policy_does():
    sizes = {parts: made(parts, critic_info=True).single_critic_space.shape for parts in ("rgb,proprioception", ALL)}
    assert list(sizes.values()) == [(40,), (3,)]
    _, info = made("proprioception,privileged", critic_info=True).reset(seed=0)
    assert info["critic_obs"].shape == (3, 3)


def test_a_renderer_without_layers_is_refused_where_they_are_needed():
    config = EnvConfig(observation=("rgb", "depth"))
    with pytest.raises(ConfigError, match="rgb,depth needs a renderer with `render_layers`, which BlankRenderer has"):
        RiverVectorEnv(ring(), 1, config, renderer=BlankRenderer())
    env = RiverVectorEnv(ring(), 1, config.with_options(observation="rgb,mask"), renderer=BlankRenderer())
    assert env.reset(seed=0)[0]["mask"].min() == 255


def test_nothing_is_drawn_where_nothing_is_seen():
    refuses = SimpleNamespace(camera=SimpleNamespace(height_px=8, width_px=8))
    config = EnvConfig(observation=("proprioception", "privileged"))
    env = RiverVectorEnv(canal(), 2, config, renderer=refuses)
    obs, _ = env.reset(seed=0)
    assert obs["privileged"].shape == (2, 37) and obs["proprioception"].shape == (2, 9)


def test_environments_say_where_their_cameras_are_and_through_which_lens():
    lens = Randomisation(pitch_deg=(-8.0, 8.0), fov_deg=(-10.0, 10.0), suns=0)
    env = made("depth", rivers=[plane(water_level=0.5)], randomisation=lens)
    obs, info = env.reset(seed=1)
    matrices = env.camera_matrices
    angles = dict(zip(PARAMETERS, env.frames.look.T, strict=True))
    expected = SMALL.camera_matrices(info["pose"], angles["pitch_deg"], angles["fov_deg"])
    for found, wanted in zip(matrices, expected, strict=True):
        np.testing.assert_array_equal(found, wanted)
    assert matrices.K[0, 0, 0] != matrices.K[1, 0, 0]
    for row in range(3):
        # The last row of the image looks down on the water at 0.5 m.
        ray = np.linalg.inv(matrices.K[row]) @ [10.0, 23.0, 1.0] * obs["depth"][row, 23, 10, 0]
        assert (matrices.R[row].T @ (ray - matrices.t[row]))[2] == pytest.approx(0.5, abs=0.02)


def test_one_environment_has_one_camera():
    env = RiverEnv(worlds()[0], EnvConfig(observation="none"))
    _, info = env.reset(seed=3)
    matrices = env.camera_matrices
    assert [each.shape for each in matrices] == [(3, 3), (3, 3), (3,)]
    np.testing.assert_allclose(-matrices.R.T @ matrices.t, info["pose"][:3])
    np.testing.assert_array_equal(matrices.K, Camera().intrinsics())


def test_environments_say_how_their_lens_distorts():
    behind = Camera(24, 32, lens=Lens("plumb_bob", (-0.2, 0.04, 0.01), offset_x_px=2.0))
    looks = Randomisation.only(fov_deg=(-10.0, 10.0))
    env = RiverVectorEnv([plane(water_level=0.5)], 3, EnvConfig(camera=behind, randomisation=looks))
    env.reset(seed=1)
    model, coefficients = env.camera_distortion
    factors = behind.intrinsics()[1, 1] / env.camera_matrices.K[:, 1, 1]
    assert model == "plumb_bob" and np.ptp(factors) > 0.02
    expected = np.array([-0.2, 0.04, 0.01, 0.0, 0.0]) / factors[:, None] ** [2, 4, 1, 1, 6]
    np.testing.assert_allclose(coefficients, expected)
    np.testing.assert_allclose(env.camera_matrices.K[:, 0, 2], 17.5)


def test_one_environment_behind_a_lens_has_one_distortion_and_a_pinhole_none():
    alone = RiverEnv(worlds()[0], EnvConfig(camera=Camera(24, 32, lens=Lens("equidistant", (0.01,)))))
    frame, _ = alone.reset(seed=0)
    together = RiverVectorEnv(worlds()[:1], 1, alone.vector.config)
    np.testing.assert_array_equal(frame, together.reset(seed=0)[0][0])
    assert alone.camera_distortion.model == "equidistant"
    np.testing.assert_array_equal(alone.camera_distortion.coefficients, [0.01, 0, 0, 0])
    model, coefficients = RiverEnv(worlds()[0], EnvConfig(observation="none")).camera_distortion
    assert model == "plumb_bob" and not coefficients.any()


def test_the_state_of_another_lens_is_refused():
    one, other = (made("mask", lens=Lens("plumb_bob", (k1,))) for k1 in (-0.05, -0.06))
    one.reset(seed=0)
    with pytest.raises(StateError, match="config"):
        other.set_state(one.get_state())


def test_where_nothing_is_observed_poses_alone_are_copied():
    env = made("none")
    observations = flown(env, 3)[-1][0]
    views = env.observer.views(env.courses, env.state)
    np.testing.assert_array_equal(observations, env.state.pose)
    assert all(value is None for name, value in views._asdict().items() if name != "pose")
    env.state.pose[:] = 0.0
    assert observations.any() and views.pose.any(), "copies"


@pytest.mark.parametrize("observation", ["mask", "privileged", "none"])
def test_a_picture_shows_the_state_after_every_step_and_after_set_state(observation: str):
    config = EnvConfig(observation=observation)  # pyright: ignore[reportArgumentType]
    env = RiverVectorEnv(ring(), 2, config, renderer=BlankRenderer(), render_mode="rgb_array")

    def shown() -> list:
        return [frame[0, :4, 0].tolist() for frame in env.render() or ()]

    def at(poses: np.ndarray) -> list:
        return np.mod(poses * 16, 256).astype(np.uint8).tolist()

    env.reset(seed=0)
    state = env.get_state()
    assert shown() == at(state["pose"])
    env.step(np.array([FORWARD] * 2))
    assert shown() == at(env.state.pose) != at(state["pose"])
    env.set_state(state)
    assert shown() == at(state["pose"])


def test_a_quality_that_the_renderer_does_not_have_is_refused():
    renderer = BlankRenderer()
    renderer.quality = "full"  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ConfigError, match=r"config\.quality = 'fast' is not the renderer's, 'full'"):
        RiverVectorEnv(ring(), 1, EnvConfig(quality="fast"), renderer=renderer)
