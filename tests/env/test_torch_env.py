"""Environments of tensors on the CPU: the rules and frames of the Gymnasium ones, begins that depend on nothing else,
and what is refused. The same on a GPU: tests/cuda."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

import thalweg
from tests.env.handmade import canal, ring
from tests.render.plain import plane
from thalweg.core.compute.counter_random import splitmix64, uniform
from thalweg.env import RiverVectorEnv
from thalweg.env.config import ConfigError, EnvConfig
from thalweg.env.device.memory import bytes_per_env, check_memory
from thalweg.env.initial_poses import CLOCK_RANGE_S, UnsafePoseError, check_pose
from thalweg.env.observation import PARTS
from thalweg.env.physics.wind import Wind
from thalweg.env.snapshot import StateError
from thalweg.env.spaces import ActionError
from thalweg.env.task.course_arrays import pack_courses
from thalweg.env.torch_env import BUFFERS, TensorRiverEnv
from thalweg.render import Camera, Look, Renderer
from thalweg.render.optics.lens import Lens
from thalweg.render.records.appearance import HALF_H, PITCH
from thalweg.render.records.randomisation import Randomisation

N = 6


def worlds() -> list:
    """Two rivers that need not be built: 40 m and open."""
    return [plane(water_level=1.0), plane(slope_y=0.01, water_level=2.0)]


def made(**options) -> TensorRiverEnv:
    return TensorRiverEnv(worlds(), N, EnvConfig(**{"observation": "none", **options}), device="cpu")


def actions(seed: int, steps: int) -> torch.Tensor:
    return torch.randint(0, 3, (steps, N, 4), generator=torch.Generator().manual_seed(seed))


def test_splitmix_gives_the_numbers_of_its_authors():
    # The first outputs of the reference generator seeded with 0 and with 1234567 (Vigna, splitmix64.c).
    assert int(splitmix64(np.uint64(0))) == 0xE220A8397B1DCDAF
    assert int(splitmix64(np.uint64(1234567))) == 6457827717110365317


def test_uniform_numbers_fill_0_to_1_and_differ_by_seed_episode_and_number():
    drawn = np.array([[[uniform(s, e, k) for k in range(20)] for e in range(10)] for s in range(10)])
    assert 0 <= drawn.min() < 0.01 and 0.99 < drawn.max() < 1
    assert abs(drawn.mean() - 0.5) < 0.03 and abs(drawn.var() - 1 / 12) < 0.01
    assert len(np.unique(drawn)) == drawn.size
    for axis in range(3):
        beside = np.corrcoef(drawn.take(range(9), axis).ravel(), drawn.take(range(1, 10), axis).ravel())[0, 1]
        assert abs(beside) < 0.1


def test_steps_are_those_of_the_gymnasium_environment_in_its_mode_next_step():
    tensors, vector = made(), RiverVectorEnv(
        worlds(), N, EnvConfig(observation="none"), autoreset_mode=AutoresetMode.NEXT_STEP
    )  # fmt: skip
    poses, _ = tensors.reset(seed=3)
    vector.reset(seed=0, options={"pose": poses.numpy()})
    ends = 0
    for chosen in actions(0, 400):
        before = tensors.get_state()["ended"].astype(bool)
        obs, reward, terminated, truncated, info = tensors.step(chosen)
        their_obs, their_reward, their_terminated, their_truncated, their_info = vector.step(chosen.numpy())
        if before.any():  # both have begun anew, each where it likes
            mask = {"reset_mask": before, "pose": obs.numpy()}
            their_obs, _ = vector.reset(options=mask)
        np.testing.assert_array_equal(obs.numpy(), their_obs)
        np.testing.assert_array_equal(reward.numpy(), their_reward)
        np.testing.assert_array_equal(terminated.numpy(), their_terminated)
        np.testing.assert_array_equal(truncated.numpy(), their_truncated)
        for name in ("cost", "costs", "done_reason"):
            np.testing.assert_array_equal(info[name].numpy(), their_info[name])
        np.testing.assert_array_equal(info["pose"].numpy(), vector.state.pose)
        ends += int(terminated.sum() + truncated.sum())
    assert ends > 20


def test_begins_are_safe_and_depend_on_seed_and_episode_alone():
    env, fewer = made(), TensorRiverEnv(worlds(), 2, EnvConfig(observation="none"), device="cpu")
    poses, info = env.reset(seed=5)
    for row, pose in enumerate(poses.numpy()):
        check_pose(env._courses, row % 2, env.config, pose)
    assert (info["done_reason"] == -1).all() and (info["progress"] == 0).all()
    clocks = env.get_state()["time_s"]
    assert (clocks >= 0).all() and clocks.max() < CLOCK_RANGE_S and len(np.unique(clocks)) == N
    np.testing.assert_array_equal(poses[:2], fewer.reset(seed=5)[0])
    np.testing.assert_array_equal(env.reset(seed=5)[0], poses)
    assert not np.array_equal(env.reset(seed=6)[0][0], poses[0])
    np.testing.assert_array_equal(env.reset(seed=7)[0][:2] == poses[:2], False)


def test_a_finished_episode_restarts_at_another_pose_with_zero_reward():
    env = made()
    first, _ = env.reset(seed=0)
    down = torch.tensor([[2, 1, 1, 1]]).repeat(N, 1)
    while True:
        obs, _, terminated, _, info = env.step(down)
        if terminated.any():
            break
    row = int(terminated.nonzero()[0])
    assert info["cost"][row] == 1.0 and info["costs"][row].tolist() == [1.0, 0.0]
    begun, reward, ended, cut, info = env.step(down)
    assert not (ended[row] or cut[row]) and reward[row] == 0 and info["cost"][row] == 0
    assert not np.array_equal(begun[row], first[row]) and not np.array_equal(begun[row], obs[row])
    check_pose(env._courses, row % 2, env.config, begun[row].numpy())


COMBINATIONS = [tuple(PARTS), ("rgb",), ("mask", "class"), ("depth", "privileged"), ("mask", "proprioception")]


@pytest.mark.parametrize("kind", ["rgb+mask", "rgb", "mask", "dict", *COMBINATIONS])
def test_frames_are_those_of_the_gymnasium_environment(kind: str | tuple):
    config = EnvConfig(observation=kind)  # pyright: ignore[reportArgumentType]
    tensors = TensorRiverEnv(worlds(), 2, config, device="cpu")
    frames, info = tensors.reset(seed=1)
    state = tensors.get_state()
    vector = RiverVectorEnv(worlds(), 2, config)
    vector.reset(seed=0, options={"pose": info["pose"].numpy()})
    vector.state.time_s[:] = state["time_s"]
    theirs = vector.observe()
    for ours, wanted in zip(*(v.values() if isinstance(v, dict) else [v] for v in (frames, theirs)), strict=True):
        np.testing.assert_array_equal(ours.numpy(), wanted)
        assert ours.numpy().dtype == wanted.dtype
        assert wanted.std() > 5 or kind not in ("rgb+mask", "rgb")
    if not isinstance(kind, str):
        assert tuple(frames) == tuple(theirs) == kind


def test_what_is_felt_is_what_the_gymnasium_environment_feels():
    felt = ("proprioception", "privileged")
    tensors = made(observation=felt)
    vector = RiverVectorEnv(worlds(), N, EnvConfig(observation=felt), autoreset_mode=AutoresetMode.NEXT_STEP)
    obs, info = tensors.reset(seed=3)
    theirs, _ = vector.reset(seed=0, options={"pose": info["pose"].numpy()})
    ends = 0
    for chosen in actions(0, 150):
        for part in felt:
            np.testing.assert_array_equal(obs[part].numpy(), theirs[part])
        before = tensors.get_state()["ended"].astype(bool)
        (obs, *_, info), theirs = tensors.step(chosen), vector.step(chosen.numpy())[0]
        if before.any():  # both have begun anew, each where it likes
            theirs, _ = vector.reset(options={"reset_mask": before, "pose": info["pose"].numpy()})
        ends += int(before.sum())
    assert ends > 10


def test_the_last_step_is_part_of_a_state_only_where_it_is_felt():
    felt, others = made(observation=("proprioception",)), made()
    states = []
    for env in (felt, others):
        env.reset(seed=0)
        env.step(torch.tensor([[0, 1, 0, 1]]).repeat(N, 1))
        states.append(env.get_state())
    assert set(states[0]) - set(states[1]) == {"last_pose", "last_action"}
    other = made(observation=("proprioception",))
    other.set_state(states[0])
    seen = other.observe()["proprioception"]
    assert torch.equal(seen, felt.observe()["proprioception"])
    assert torch.equal(seen[:, 3:], torch.tensor([[4.0, 0, 1, 0, 1, 0]]).repeat(N, 1))


def test_cameras_are_where_the_gymnasium_environment_has_them():
    looks = Randomisation.only(pitch_deg=(-5.0, 5.0), fov_deg=(-5.0, 5.0))
    env = made(randomisation=looks)
    _, info = env.reset(seed=2)
    matrices, rows = env.camera_matrices, env._observer._look_rows[env._tensors["look"]].double().numpy()
    pitch = np.degrees(rows[:, PITCH]) - env.config.camera.pitch_deg
    fov = np.degrees(2 * np.arctan(rows[:, HALF_H])) - env.config.camera.fov_deg
    expected = env.config.camera.camera_matrices(info["pose"].numpy(), pitch, fov)
    assert np.ptp(pitch) > 2 and np.ptp(fov) > 2
    for found, wanted in zip(matrices, expected, strict=True):
        assert found.dtype == torch.float64
        np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-6, atol=1e-6)


def test_frames_and_distortion_behind_a_lens_are_those_of_the_gymnasium_environment():
    behind = Camera(32, 48, lens=Lens("plumb_bob", (-0.2, 0.04), 0.95, 2.0, -1.5))
    env = made(observation="rgb+mask", camera=behind, randomisation=Randomisation.only(fov_deg=(-5.0, 5.0)))
    frames, info = env.reset(seed=2)
    rows = env._observer._look_rows[env._tensors["look"]].numpy()
    renderer, poses = env._observer.renderer, info["pose"].numpy()
    added = np.degrees(2 * np.arctan(rows[:, HALF_H].astype(np.float64))) - behind.fov_deg
    looks = [Look(fov_deg=float(each)) for each in added]
    alone = Renderer(renderer.worlds, behind).render(poses, env.world_index, env._tensors["time_s"].numpy(), look=looks)
    assert np.mean(np.abs(frames.numpy().astype(int) - alone) > 2) < 0.01
    expected = behind.distortion(added)
    assert env.camera_distortion.model == expected.model and np.ptp(expected.coefficients[:, 0]) > 0.005
    np.testing.assert_allclose(env.camera_distortion.coefficients.numpy(), expected.coefficients, rtol=1e-5)
    wanted = behind.camera_matrices(poses, 0.0, added).K
    np.testing.assert_allclose(env.camera_matrices.K.numpy(), wanted, rtol=1e-5)


def test_what_is_returned_is_valid_until_the_second_step_after():
    env = TensorRiverEnv(worlds(), 2, EnvConfig(), device="cpu")
    first, _ = env.reset(seed=0)
    kept, still = first.clone(), torch.ones(2, 4, dtype=torch.int64)
    climbed = env.step(still * 0)[0]
    assert torch.equal(first, kept) and not torch.equal(first, climbed)
    assert env.step(still)[0].data_ptr() == first.data_ptr()


@pytest.mark.slow
def test_to_observe_again_leaves_what_the_step_before_returned():
    env = made(observation="mask")
    before = env.reset(seed=0)[0]
    kept = before.clone()
    now = env.step(torch.tensor([[0, 1, 0, 1]]).repeat(N, 1))[0]
    again = env.observe()
    assert torch.equal(before, kept) and torch.equal(again, now) and not torch.equal(again, before)
    shown = now.clone()
    state = env.get_state()
    env.set_state(state | {"pose": state["pose"] + 0.5})
    env.observe()
    assert torch.equal(now, shown)


def test_to_observe_before_a_reset_is_refused():
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) before observe\(\)"):
        made().observe()


def test_looks_are_drawn_for_each_episode_or_environment_and_shown():
    shown = {}
    for per in ("episode", "environment"):
        looks = Randomisation(exposure_ev=(-2.0, 2.0), suns=0, per=per)
        env = made(randomisation=looks)
        env.reset(seed=0)
        first = env.get_state()["look"]
        assert len(np.unique(first)) == N
        env._tensors["ended"].fill_(1)
        env.step(torch.ones(N, 4, dtype=torch.int64))
        shown[per] = (env.get_state()["look"] == first).all()
    assert shown == {"episode": False, "environment": True}
    looks = Randomisation(exposure_ev=(-2.0, 2.0), suns=2)
    env = TensorRiverEnv(worlds(), 2, EnvConfig(randomisation=looks), device="cpu")
    dark, _ = env.reset(seed=0)
    assert abs(float(dark[0].float().mean()) - float(dark[1].float().mean())) > 1


def test_a_state_resumes_bit_for_bit_in_another_environment():
    env, other = made(), made()
    env.reset(seed=0)
    some = actions(1, 60)
    for chosen in some[:30]:
        env.step(chosen)
    other.set_state(env.get_state())
    np.testing.assert_array_equal(other.observe(), env.observe())
    for chosen in some[30:]:
        ours, theirs = env.step(chosen), other.step(chosen)
        assert torch.equal(ours[0], theirs[0]) and torch.equal(ours[1], theirs[1])


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(
    "options",
    [
        {"observation": ("mask", "privileged", "proprioception"), "critic_info": True},
        {"task": "Portage", "wind": Wind(), "dynamics": "inertial", "action": "continuous"},
    ],
    ids=["seen and felt", "forces"],
)
def test_a_copy_continues_bit_for_bit_and_apart(copied: Callable[[Any], Any], options: dict):
    env = made(**options)
    env.reset(seed=0)
    some = actions(1, 30)
    if env.config.action == "continuous":
        some = some - 1.0
    for chosen in some[:15]:
        env.step(chosen)
    twin = copied(env)
    expected = [flat(env.step(chosen)) for chosen in some[15:]]
    for chosen, ours in zip(some[15:], expected, strict=True):
        assert torch.equal(flat(twin.step(chosen)), ours)
    assert not torch.equal(expected[0], expected[-1])


def test_a_copy_of_an_environment_before_its_first_reset_needs_one_too():
    twin = copy.deepcopy(made())
    with pytest.raises(gymnasium.error.ResetNeeded):
        twin.step(actions(0, 1)[0])
    assert torch.equal(twin.reset(seed=4)[0], made().reset(seed=4)[0])


def flat(result: Any) -> torch.Tensor:
    """All numbers of a result of `step`, as one vector."""
    if isinstance(result, torch.Tensor):
        return result.double().flatten()
    return torch.cat([flat(part) for part in (result.values() if isinstance(result, dict) else result)])


def test_a_state_that_does_not_fit_is_refused_by_name():
    env = made()
    env.reset()
    state = env.get_state()
    with pytest.raises(StateError, match=r"belongs to another config \(config differs\)"):
        made(max_steps=7).set_state(state)
    with pytest.raises(StateError, match="pose is float32"):
        env.set_state({**state, "pose": state["pose"].astype(np.float32)})
    with pytest.raises(StateError, match=r"lacks \['config'.* and has unknown \[\]"):
        env.set_state({name: state[name] for name in ("pose",)})
    with pytest.raises(StateError, match=r"belongs to other worlds \(world differs\)"):
        env.set_state({**state, "world": state["world"][::-1].copy()})


IMPOSSIBLE = {
    "segment": 10**9, "travel": 0, "pose": np.nan, "time_s": np.inf, "visited": 2, "visited_count": 10**6, "steps": -1,
    "idle": -1, "seed": -1, "episode": 0, "look": 1, "ended": 2, "last_pose": np.nan, "last_action": np.nan,
    "scene": -1, "station": -1.0, "way": np.inf, "force_gust": np.nan, "force_velocity": np.inf,
    "force_mean_wind": np.nan, "force_current": np.nan,
}  # fmt: skip
"""A value of each array that no episode has."""


def flying() -> TensorRiverEnv:
    """Environments whose states have all arrays, in their first episode, without a step that is compiled."""
    options = {"action": "continuous", "dynamics": "inertial", "max_steps": 40}
    env = made(observation=("proprioception",), task="Portage", **options)
    count = np.ones(N, np.int64)
    env.set_state({**env.get_state(), "episode": count, "ended": np.zeros(N, np.uint8)})
    return env


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_values_that_no_episode_has_are_refused_by_name(name: str):
    env = flying()
    before, state = env.get_state(), env.get_state()
    state[name][1] = IMPOSSIBLE[name]
    with pytest.raises(StateError, match=rf"^{name} has an impossible value, .+; allowed: .+ \(environment 1\)"):
        env.set_state(state)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


def test_every_array_that_a_step_indexes_or_computes_with_is_checked():
    unchecked = {"world", "fingerprint", "config", "force_key"}  # three are compared, and any key gives numbers
    assert set(flying().get_state()) - unchecked == set(IMPOSSIBLE)


def test_actions_are_checked_before_anything_changes():
    env = made()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(torch.ones(N, 4, dtype=torch.int64))
    env.reset()
    before = env.get_state()
    for wrong, words in (
        (np.ones((N, 4), int), "not ndarray"),
        (torch.ones(N, 3, dtype=torch.int64), "have shape"),
        (torch.ones(N, 4), "integers 0, 1 or 2"),
        (torch.full((N, 4), 3), "out of range"),
    ):
        with pytest.raises(ActionError, match=words):
            env.step(wrong)  # pyright: ignore[reportArgumentType]
    assert all(np.array_equal(env.get_state()[name], value) for name, value in before.items())


def test_seeds_and_step_counts_beyond_what_kernels_hold_are_refused_by_name():
    env = TensorRiverEnv(ring(), 2, EnvConfig(observation="none"), device="cpu")
    with pytest.raises(ConfigError, match="seed must be at most 9223372036854775805 for 2 environments, not 92233720"):
        env.reset(seed=2**63 - 1)
    env.reset(seed=2**63 - 3)
    for name in ("max_steps", "max_idle_steps"):
        with pytest.raises(ConfigError, match=rf"{name} must be a whole number from 1 to 2147483647.*, got 2147483648"):
            EnvConfig(**{name: 2**31})


def test_make_torch_takes_the_options_of_the_gymnasium_ids():
    env = thalweg.make_torch("Easy", 2, device="cpu", observation="none", action="continuous")
    obs, _ = env.reset(seed=0)
    assert obs.shape == (2, 4) and obs.dtype == torch.float64
    assert env.single_action_space == gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float32)
    obs, *_ = env.step(torch.tensor([[0.0, 0.0, 0.5, 0.0]]).repeat(2, 1))
    assert torch.isfinite(obs).all()
    with pytest.raises(ConfigError, match="unknown option 'colour'"):
        thalweg.make_torch("Easy", 2, device="cpu", colour=1)
    with pytest.raises(ValueError, match="choose auto, cpu, cuda"):
        thalweg.make_torch("Easy", 2, device="tpu")


def test_more_environments_than_the_device_has_memory_for_are_refused_before_any_is_made(
    monkeypatch: pytest.MonkeyPatch,
):
    config = EnvConfig()
    each = bytes_per_env(pack_courses(worlds(), config), config, BUFFERS)
    assert each > BUFFERS * 4 * 128 * 128  # its frames alone
    layers = EnvConfig(observation=("rgb", "depth"))
    assert bytes_per_env(pack_courses(worlds(), layers), layers, BUFFERS) == each + BUFFERS * 5 * 128 * 128
    monkeypatch.setattr("thalweg.env.torch_env.free_bytes", lambda device: 10 * each)
    TensorRiverEnv(worlds(), 10, config, device="cpu")
    with pytest.raises(ConfigError, match=r"num_envs = 1,000,000,000,000 takes .* are free: at most 10 fit"):
        TensorRiverEnv(worlds(), 10**12, config, device="cpu")


def test_what_all_share_is_counted_once():
    check_memory(5, 100, 50, 550)
    with pytest.raises(ConfigError, match=r"num_envs = 5 takes .*: at most 4 fit"):
        check_memory(5, 100, 51, 550)
    check_memory(5, 100, 0, None)  # a system that does not tell


def test_a_world_without_a_safe_start_is_refused_as_environments_of_tensors_are_made():
    rivers = [canal(), replace(ring(width_m=0.9), name="narrow")]
    with pytest.raises(UnsafePoseError, match="no safe start found in narrow-0 among"):
        TensorRiverEnv(rivers, 2, EnvConfig(observation="none"), device="cpu")


def test_what_tensors_tell_of_a_step_is_valid_after_the_next_one():
    env = made(observation=("privileged", "proprioception"))
    env.reset(seed=0)
    down = torch.tensor([[2, 1, 0, 1]]).repeat(N, 1)
    for _ in range(20):
        obs, reward, *_, info = env.step(down)
        told = {**obs, "reward": reward, **info}
        kept = {name: values.clone() for name, values in told.items()}
        env.step(down)
        assert all(torch.equal(told[name], values) for name, values in kept.items())


def test_cameras_of_tensors_are_refused_before_a_reset():
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) before camera_matrices"):
        made().camera_matrices  # noqa: B018
