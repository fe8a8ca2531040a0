"""Environments of boats: costs, endings, starts and states, beside a slow reference on random voyages."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.env.vehicle.basins import arch_at, basin
from tests.env.vehicle.reference_boat import ReferenceBoat
from thalweg import BOAT_IDS, make_torch
from thalweg.env import ConfigError, DoneReason, EnvConfig, RiverVectorEnv, StateError, UnsafePoseError, sample_starts
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.task.ideal_eye import FEATURES
from thalweg.env.task.priced.eye import features_of
from thalweg.env.vehicle.boat import Boat, BoatError
from thalweg.world import World, level_named, load_or_build

CONFIG = EnvConfig(vehicle="asv", observation="none")
LEVEL_M = 2.0
UP, STAY, DOWN, AHEAD = [0, 1, 1, 1], [1, 1, 1, 1], [2, 1, 1, 1], [1, 1, 0, 1]


def voyage(world: World, config: EnvConfig = CONFIG, **options) -> RiverVectorEnv:
    return RiverVectorEnv([world], 1, config, autoreset_mode="disabled", **options)


def test_the_camera_stays_at_its_height_over_the_water_whatever_the_vertical_branch_says():
    env = voyage(basin(level_m=LEVEL_M))
    pose, _ = env.reset(seed=0, options={"pose": [10.0, 0.0, 99.0, 0.0]})
    assert pose[0] == pytest.approx([10.0, 0.0, LEVEL_M + 1.2, 0.0])
    for action in (UP, DOWN, STAY, AHEAD):
        pose, _, _, _, info = env.step([action])
        assert pose[0, 2] == pytest.approx(LEVEL_M + 1.2) and info["done_reason"][0] == DoneReason.RUNNING
    assert env.single_action_space == gymnasium.spaces.MultiDiscrete([3, 3, 3, 3])


def test_shallow_water_costs_each_step_and_ends_nothing():
    world = basin(lambda x, y: np.where(x > 20.0, 0.37, 1.5))
    env = voyage(world)
    env.reset(seed=0, options={"pose": [15.0, 0.0, 0.0, 0.0]})
    assert env.cost_kinds == ("tight", "loose", "shallow")
    costs = []
    for _ in range(12):
        _, _, terminated, truncated, info = env.step([AHEAD])
        assert info["costs"].shape == (1, 3) and info["costs"][0, :2].tolist() == [0.0, 0.0]
        assert info["cost"][0] == info["costs"][0].sum()
        assert not terminated[0] and not truncated[0]
        costs.append(info["cost"][0])
    # The bow is over the shallows when the middle has passed x = 19; the depth falls between two nodes.
    assert costs[:3] == [0.0] * 3 and costs[-5:] == pytest.approx([0.5] * 5, abs=1e-5)


def ending(world: World, pose: list, action: list, steps: int = 10) -> tuple[DoneReason, np.ndarray]:
    """The reason and costs of the step that ends an episode which repeats an action."""
    env = voyage(world)
    env.reset(seed=0, options={"pose": pose})
    for _ in range(steps):
        _, _, _, _, info = env.step([action])
        if info["done_reason"][0] >= 0:
            break
    return DoneReason(info["done_reason"][0]), info["costs"][0]


def test_a_boat_that_runs_aground_has_left_the_volume_and_pays_the_tight_cost_alone():
    bar = basin(lambda x, y: np.where((np.abs(x - 30.0) < 3.0) & (y < 2.0), 0.2, 1.5))
    reason, costs = ending(bar, [22.0, -1.0, 0.0, 0.0], AHEAD)
    assert reason == DoneReason.OUT_OF_VOLUME_HORIZONTAL and costs.tolist() == [1.0, 0.0, 0.0]
    bank, costs = ending(basin(), [22.0, 3.0, 0.0, 1.2], AHEAD)
    assert bank == DoneReason.OUT_OF_VOLUME_HORIZONTAL and costs.tolist() == [1.0, 0.0, 0.0]


def test_rocks_and_piers_are_collisions():
    reason, costs = ending(basin(rocks=((30.0, 0.3, 0.5),)), [24.0, 0.0, 0.0, 0.0], AHEAD)
    assert reason == DoneReason.COLLISION and costs.tolist() == [1.0, 0.0, 0.0]
    bridged = basin(bridges=arch_at(30.0, 10.0))
    assert ending(bridged, [24.0, 4.2, 0.0, 0.0], AHEAD)[0] == DoneReason.COLLISION
    assert ending(bridged, [24.0, 0.0, 0.0, 0.0], AHEAD, 14)[0] == DoneReason.RUNNING


def test_headings_idling_and_success_are_those_of_the_paper():
    assert ending(basin(), [22.0, 0.0, 0.0, 1.5], [1, 0, 1, 1])[0] == DoneReason.YAW_OVER_DEVIATION
    assert ending(basin(), [22.0, 0.0, 0.0, 0.0], STAY, 60)[0] == DoneReason.IDLE
    assert ending(basin(), [50.0, 0.0, 0.0, 0.0], AHEAD, 20)[0] == DoneReason.SUCCESS


def test_random_voyages_agree_with_the_reference(easy_world: World):
    env = RiverVectorEnv([easy_world], 12, CONFIG, autoreset_mode="disabled")
    env.reset(seed=5)
    reference = ReferenceBoat(easy_world, CONFIG)
    rng = np.random.default_rng(5)
    seen: dict[str, int] = dict.fromkeys(("", "solid", "aground"), 0)
    shallow = 0
    for _ in range(120):
        before = env.state.pose.copy()
        actions = np.where(rng.random((12, 1)) < 0.2, env.pilot_actions(), rng.integers(0, 3, (12, 4)))
        actions[:, 2] = 0
        _, _, _, _, info = env.step(actions)
        for row, (a, b) in enumerate(zip(before, info["pose"], strict=True)):
            pieces = 1 if np.hypot(*(b - a)[:2]) < 0.6 else 2
            ways = [a + (b - a) * piece / pieces for piece in range(int(b[3] == a[3]), pieces + 1)]  # it turns first
            found = [reference.hits(x, y, b[3]) for x, y, *_ in ways]
            first = next((hit for hit in found if hit), "")
            if "unsure" in found:
                continue
            seen[first] += 1
            assert (first == "solid") == (info["done_reason"][row] == DoneReason.COLLISION)
            if first == "aground":
                assert info["done_reason"][row] == DoneReason.OUT_OF_VOLUME_HORIZONTAL
            elif first == "":
                assert info["costs"][row, 2] == pytest.approx(reference.cost(b[0], b[1], b[3]), abs=1e-5)
                shallow += info["costs"][row, 2] > 0
        ended = info["done_reason"] >= 0
        if ended.any():
            env.reset(options={"reset_mask": ended})
    assert min(seen.values()) > 0 and shallow > 20


def test_starts_float_with_the_margin_at_every_heading_to_the_direction_of_travel(easy_world: World):
    reference = ReferenceBoat(easy_world, CONFIG)
    starts = sample_starts(easy_world, 60, 1, CONFIG)
    tangent = easy_world.river.tangent
    for x, y, _, yaw in starts:
        sample = np.linalg.norm(easy_world.river.position_m - [x, y], axis=1).argmin()
        course = np.arctan2(tangent[sample, 1], tangent[sample, 0])
        error = (course - yaw + np.pi) % (2 * np.pi) - np.pi
        if abs(error) > np.pi / 2:
            error -= np.copysign(np.pi, error)
        for share in (0.0, 0.25, 0.5, 0.75):
            assert reference.hits(x, y, yaw + share * error) == ""
        assert reference.cost(x, y, yaw) == 0.0
    assert np.abs(np.diff(starts[:, 3])).max() > 1.0


def test_a_given_pose_must_float():
    env = voyage(basin(lambda x, y: np.where(x > 40.0, 0.36, 1.5), rocks=((20.0, 2.0, 0.5),)))
    with pytest.raises(UnsafePoseError, match=r"the hull touches a rock or a bridge at \(20\.00, 1\.00\)"):
        env.reset(options={"pose": [20.0, 1.0, 0.0, 0.0]})
    with pytest.raises(UnsafePoseError, match=r"aground at .*: -0\.50 m of water under the hull, draught 0\.32 m"):
        env.reset(options={"pose": [30.0, 4.9, 0.0, 0.0]})
    with pytest.raises(UnsafePoseError, match="beyond the bank"):
        env.reset(options={"pose": [30.0, 9.0, 0.0, 0.0]})
    env.reset(options={"pose": [45.0, 0.0, 0.0, 0.0]})  # shallow, but afloat


def test_states_are_restored_to_the_bit(easy_world: World):
    config = EnvConfig(vehicle="asv", observation="privileged", critic_info=True)
    env = RiverVectorEnv([easy_world], 4, config)
    env.reset(seed=2)
    rng = np.random.default_rng(0)
    actions = rng.integers(0, 3, (60, 4, 4))
    for action in actions[:20]:
        env.step(action)
    state = env.get_state()
    first = [env.step(action) for action in actions[20:]]
    env.set_state(state)
    for action, expected in zip(actions[20:], first, strict=True):
        obs, reward, _, _, info = env.step(action)
        assert np.array_equal(obs, expected[0]) and np.array_equal(reward, expected[1])
        assert np.array_equal(info["costs"], expected[4]["costs"])
        assert np.array_equal(info["critic_obs"], expected[4]["critic_obs"])
    flies = RiverVectorEnv([easy_world], 4, EnvConfig(observation="privileged"))
    flies.reset(seed=2)
    with pytest.raises(StateError, match="another config"):
        flies.set_state(state)


@pytest.mark.parametrize("mode", ["same_step", "next_step", "disabled"])
def test_info_belongs_to_the_action_in_every_autoreset_mode(mode: str):
    env = RiverVectorEnv([basin()], 2, CONFIG, autoreset_mode=mode)
    env.reset(seed=0, options={"pose": np.array([[22.0, 3.5, 0.0, 1.2], [22.0, 0.0, 0.0, 0.0]])})
    _, _, terminated, _, info = env.step([AHEAD, AHEAD])
    assert terminated.tolist() == [True, False]
    assert info["costs"].tolist() == [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]] and info["cost"].tolist() == [1.0, 0.0]


def test_rivers_that_change_have_a_bed_where_nothing_is_drawn():
    rivers = RiverList.of_levels([("Easy", "1 3001")])
    env = RiverVectorEnv(rivers, 2, CONFIG)
    env.reset(seed=0)
    for _ in range(30):
        _, _, _, _, info = env.step(env.pilot_actions())
    assert info["cost"].tolist() == [0.0, 0.0]
    env.close()


def test_a_torch_environment_takes_the_same_steps(easy_world: World):
    torch = pytest.importorskip("torch")
    config = EnvConfig(vehicle="asv", observation="privileged")
    tensors = make_torch("Easy", 4, worlds=easy_world, device="cpu", config=config)
    seen, info = tensors.reset(seed=1)
    env = RiverVectorEnv([easy_world], 4, config, autoreset_mode="next_step")
    expected, _ = env.reset(seed=0, options={"pose": info["pose"].numpy()})
    assert np.array_equal(seen.numpy(), expected) and seen.shape == (4, len(features_of("River", "asv")))
    rng = np.random.default_rng(1)
    running = np.ones(4, bool)
    for _ in range(40):
        actions = rng.integers(0, 3, (4, 4))
        seen, reward, terminated, truncated, info = tensors.step(torch.from_numpy(actions))
        expected, expected_reward, *_, expected_info = env.step(actions)
        assert np.array_equal(reward.numpy()[running], expected_reward[running])
        assert np.array_equal(info["costs"].numpy()[running], expected_info["costs"][running])
        assert np.array_equal(seen.numpy()[running], expected[running])
        running &= ~(terminated | truncated).numpy()
    assert tensors.cost_kinds == env.cost_kinds and not running.all()


def test_what_a_boat_sees_and_feels_is_the_same_in_both_environments(easy_world: World):
    torch = pytest.importorskip("torch")
    config = EnvConfig(vehicle="asv", observation=("privileged", "proprioception"), critic_info=True)
    env = RiverVectorEnv([easy_world], 3, config, autoreset_mode="next_step")
    starts = sample_starts(easy_world, 3, 0, config)
    high = starts + np.array([0.0, 0.0, 5.0, 0.0])
    tensors = make_torch("Easy", 3, worlds=easy_world, device="cpu", config=config)
    _, begun = tensors.reset(seed=1)
    seen, info = env.reset(seed=0, options={"pose": high})
    # The given height is not a step that the boat took.
    assert seen["proprioception"][0] == pytest.approx([1.2, *[0.0] * 8], abs=1e-6)
    assert info["critic_obs"].shape == (3, 3) and seen["privileged"].shape == (3, len(features_of("River", "asv")))
    seen, _ = env.reset(seed=0, options={"pose": begun["pose"].numpy()})
    running = np.ones(3, bool)
    for action in (AHEAD, UP, AHEAD):
        expected, _, ended, *_ = env.step([action] * 3)
        running &= ~ended
        felt, *_ = tensors.step(torch.tensor([action] * 3))
        for part in config.parts:
            np.testing.assert_array_equal(felt[part].numpy()[running], expected[part][running])
    assert (
        running.any()
        and seen in env.observation_space
        and env.single_observation_space == tensors.single_observation_space
    )


def test_the_ids_make_boats():
    assert set(BOAT_IDS.values()) == {"thalweg/Easy-ASV-v0", "thalweg/Medium-ASV-v0", "thalweg/Hard-ASV-v0"}
    env: Any = gymnasium.make("thalweg/Easy-ASV-v0", observation="privileged").unwrapped
    assert env.vector.config.vehicle == "asv" and env.cost_kinds[-1] == "shallow"
    check_env(env, skip_render_check=True)
    many: Any = gymnasium.make_vec("thalweg/Easy-ASV-v0", num_envs=2, observation="none").unwrapped
    assert many.config.vehicle == "asv"


def test_the_data_and_numbers_of_the_uav_know_no_boat():
    assert not {"vehicle", "boat"} & set(EnvConfig().as_data())
    assert CONFIG.as_data()["boat"]["draught_m"] == 0.32 and CONFIG.as_data()["vehicle"] == "asv"
    assert EnvConfig().limits[:12] == EnvConfig(vehicle="asv").limits[:12]
    assert features_of("River") == FEATURES and features_of("River", "asv")[: len(FEATURES)] == FEATURES
    assert EnvConfig().cost_kinds == ("tight", "loose")


def test_wrong_values_are_named():
    with pytest.raises(BoatError, match="draught_m must be a finite number above 0"):
        Boat(draught_m=0.0)
    with pytest.raises(ConfigError, match="task must be River for the vehicle asv, got 'Portage'"):
        EnvConfig(vehicle="asv", task="Portage")
    with pytest.raises(ConfigError, match="vehicle must be one of 'uav', 'asv'"):
        EnvConfig(vehicle="ship")  # pyright: ignore[reportArgumentType]
    env = voyage(basin())
    env.reset(seed=0)
    with pytest.raises(ConfigError, match="unknown pilot 'steady' of the asv; known: scripted"):
        env.pilot_actions("steady")


def test_the_deep_levels_have_the_step_limit_of_levels():
    env = RiverVectorEnv([load_or_build(level_named("Medium-Deep"), 3000)], 1, CONFIG)
    assert env.courses.max_steps.tolist() == [500]
