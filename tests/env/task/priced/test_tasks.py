"""Tasks as environments: ids, hard mode, deadlines, seeds, states, autoreset, and what is refused."""

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import thalweg
from tests.env.flights import FORWARD, HOVER
from tests.env.handmade import ring
from tests.env.task.priced.flights import PRICED, erratic, flown, made, rivers
from thalweg.env import ConfigError, DoneReason, EnvConfig, RiverEnv, RiverVectorEnv, StateError
from thalweg.env.rivers.river_list import RiverList
from thalweg.env.spaces import from_unit_actions, to_unit_actions
from thalweg.env.task.course_arrays import config_fingerprint
from thalweg.env.tasks import TASKS
from thalweg.env.torch_env import TensorRiverEnv


def test_the_registered_tasks_are_those_that_there_are():
    assert {task for task, _ in thalweg.TASK_IDS} | {"River"} == set(TASKS) and len(thalweg.TASK_IDS) == 12


@pytest.mark.parametrize(("task", "level"), thalweg.TASK_IDS)
def test_every_id_makes_its_task(task: str, level: str):
    name = thalweg.TASK_IDS[task, level]
    env = gymnasium.make(name, world=ring(), observation="none")
    assert isinstance(env.unwrapped, RiverEnv) and env.unwrapped.vector.config.task == task
    many = gymnasium.make_vec(name, num_envs=2, worlds=ring(), observation="none")
    assert many.unwrapped.config.task == task and many.unwrapped.cost_kinds == ("tight", "loose", TASKS[task].kind)  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("task", PRICED)
def test_hard_mode_ends_an_episode_at_its_first_cost(task: str):
    soft, hard = (list(flown(made(task, rivers()["ring"], 1, hard=hard), 80, seed=2)) for hard in (False, True))
    first = next(i for i, (*_, told, _) in enumerate(soft) if told["costs"][2] > 0)
    for (*_, a, _), (*_, b, _) in zip(soft[:first], hard[:first], strict=True):
        np.testing.assert_array_equal(a["pose"], b["pose"])
        assert b["done_reason"] == a["done_reason"]
    told = hard[first][2]
    assert told["done_reason"] == DoneReason.COST_INCURRED == 7 and told["terminated"] and not told["truncated"]
    assert told["costs"][2] == soft[first][2]["costs"][2] and soft[first][2]["done_reason"] == -1


def test_a_deadline_is_a_share_of_the_way_and_ends_without_a_cost():
    # A ring of 125.66 m; the station of a portage is half of it away.
    world = ring()
    limits = {task: int(made(task, world).courses.max_steps[0]) for task in PRICED}
    assert limits == {"Swimmers": 76, "Nests": 170, "RacingLine": 57, "Portage": 38}
    env = made("Portage", world, 1, max_idle_steps=99)
    env.reset(seed=0)
    told = None
    for _ in range(38):
        told = env.step(np.array([HOVER]))
    assert told is not None
    assert told[4]["done_reason"].tolist() == [DoneReason.MAX_STEP_REACHED] and told[4]["costs"].tolist() == [[0, 0, 0]]


@pytest.mark.parametrize("kind", ["single", "vector", "tensors"])
@pytest.mark.parametrize("task", ["River", *PRICED])
def test_a_deadline_terminates_and_the_step_limit_of_the_paper_truncates(task: str, kind: str):
    config = EnvConfig(task=task, observation="none", max_steps=4)  # pyright: ignore[reportArgumentType]
    env: Any
    if kind == "single":
        env, hover = RiverEnv(ring(), config), np.array(HOVER)
    elif kind == "vector":
        env, hover = RiverVectorEnv(ring(), 2, config), np.array([HOVER] * 2)
    else:
        env, hover = TensorRiverEnv(ring(), 2, config, device="cpu"), torch.tensor([HOVER] * 2)
    env.reset(seed=0)
    ends = [env.step(hover)[2:4] for _ in range(4)]
    assert not np.any(ends[:-1])
    terminated, truncated = (np.ravel(each).tolist() for each in ends[-1])
    last = [True] * len(terminated)
    assert (terminated, truncated) == ((last, [False] * len(last)) if task != "River" else ([False] * len(last), last))


def test_a_fast_step_is_two_metres_forward():
    world = ring()
    env = made("Swimmers", world, 3)
    env.reset(seed=0)
    before = env.state.pose.copy()
    _, _, _, _, info = env.step(np.array([(1, 1, 2, 1), FORWARD, HOVER]))
    assert np.hypot(*(info["pose"] - before)[:, :2].T) == pytest.approx([2.0, 1.0, 0.0])


def test_a_continuous_action_forward_reaches_to_the_fast_step_and_a_pilot_takes_half_of_it():
    given = np.array([[0, 0, c, 0] for c in (-1.0, 0.0, 0.25, 0.5, 0.75, 1.0)])
    units = to_unit_actions("continuous", given, 6, 2.0)[:, 2]
    assert units.tolist() == [0.0, 0.0, 0.5, 1.0, -0.75, -1.0]
    pilots = np.array([[0, 0, u, 0] for u in (-1, 0, 1)])
    assert from_unit_actions("continuous", pilots, 2.0)[:, 2].tolist() == [1.0, 0.0, 0.5]
    env = made("Swimmers", ring(), 6, action="continuous")
    env.reset(seed=0)
    before = env.state.pose.copy()
    info = env.step(given.astype(np.float32))[4]
    assert np.hypot(*(info["pose"] - before)[:, :2].T) == pytest.approx([0, 0, 0.5, 1.0, 1.5, 2.0])


def test_steps_over_land_are_not_idle():
    env = made("Portage", ring(), 1, "DISABLED", max_idle_steps=3)
    env.reset(seed=0)
    env.state.idle[:] = 2
    env.state.pose[0] = [0.0, 0.0, 8.0, 0.0]  # in the middle of the ring, far from its water
    for _ in range(5):
        _, _, _, _, info = env.step(np.ones((1, 4), np.int64))
        assert info["done_reason"][0] == -1 and env.state.idle[0] == 2


@pytest.mark.parametrize("step_m", [0.3, 0.6, 1.1, 1.2, 1.6])
def test_a_step_that_float32_makes_longer_is_no_fast_one(step_m: float):
    ratio = EnvConfig(task="Swimmers", forward_step_m=step_m).fast_ratio
    plain = from_unit_actions("continuous", np.array([[0.0, 0, 1, 0]]), ratio)
    assert plain.dtype == np.float32
    assert to_unit_actions("continuous", plain, 1, ratio)[0, 2] == pytest.approx(1.0, abs=1e-6)
    assert to_unit_actions("continuous", np.array([[0, 0, 1.01 / ratio, 0]], np.float32), 1, ratio)[0, 2] < 0.0


@pytest.mark.parametrize("task", PRICED)
def test_a_state_continues_to_the_bit(task: str):
    env, other = (made(task, [rivers()["ring"], rivers()["hairpin"]]) for _ in range(2))  # pyright: ignore[reportArgumentType]
    rng = np.random.default_rng(0)
    env.reset(seed=1)
    actions = [rng.integers(0, 3, (env.num_envs, 4)) for _ in range(40)]
    for chosen in actions[:20]:
        env.step(chosen)
    state = env.get_state()
    results = [env.step(chosen) for chosen in actions[20:]]
    other.set_state(state)
    for chosen, first in zip(actions[20:], results, strict=True):
        again = other.step(chosen)
        for a, b in zip(first[:4], again[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(first[4]["costs"], again[4]["costs"])
    state["way"][2] = -1.0
    with pytest.raises(StateError, match=r"^way has an impossible value, -1; allowed: .* 0 or more \(environment 2\)"):
        other.set_state(state)


@pytest.mark.parametrize("task", PRICED)
def test_rivers_may_change_with_each_episode(task: str):
    worlds = [rivers()[name] for name in ("ring", "hairpin", "canal")]
    config = EnvConfig(task=task, observation="privileged", max_steps=15)  # pyright: ignore[reportArgumentType]
    env, other = (RiverVectorEnv(RiverList(worlds), 4, config) for _ in range(2))
    rng, flown_in = np.random.default_rng(0), set()
    env.reset(seed=1)
    actions = rng.integers(0, 3, (60, 4, 4))
    for chosen in actions[:40]:
        flown_in |= set(env.step(chosen)[4]["river"].tolist())
    assert flown_in == {0, 1, 2}
    other.set_state(env.get_state())
    for chosen in actions[40:]:
        first, again = env.step(chosen), other.step(chosen)
        for a, b in zip(first[:4], again[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(first[4]["costs"], again[4]["costs"])
        # What the task put into the river of each environment is that of the river alone.
        for row, river in enumerate(env.rivers.river):  # pyright: ignore[reportAttributeAccessIssue]
            alone, slot = made(task, worlds[int(river)], 1, max_steps=15).courses, env.world_index[row]
            for name in ("swimmers", "max_steps"):
                assert getattr(env.courses, name)[slot] == getattr(alone, name)[0]
            for first_row, name in (("first_haunt", "haunt"), ("first_reserve", "reserve"), ("first_buoy", "buoy")):
                begin, end = getattr(env.courses, first_row)[slot : slot + 2]
                np.testing.assert_array_equal(getattr(env.courses, name)[begin:end], getattr(alone, name))
    env.close()
    other.close()


def test_states_of_the_papers_task_are_as_they_were():
    env = RiverVectorEnv(ring(), 2, EnvConfig(observation="none"))
    env.reset(seed=0)
    assert not {"scene", "station", "way"} & set(env.get_state())
    assert "task" not in EnvConfig().as_data() and EnvConfig(task="Nests").as_data()["task"] == "Nests"
    assert config_fingerprint(EnvConfig(task="Nests")) != config_fingerprint(EnvConfig())


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
@pytest.mark.parametrize("task", PRICED)
def test_ours_agrees_with_gymnasiums_vector_of_single_environments(task: str, mode: AutoresetMode):
    config = EnvConfig(task=task, observation="none", max_steps=25)  # pyright: ignore[reportArgumentType]
    ours = RiverVectorEnv(ring(), 3, config, autoreset_mode=mode)
    theirs = SyncVectorEnv([lambda: RiverEnv(ring(), config) for _ in range(3)], autoreset_mode=mode)
    np.testing.assert_array_equal(ours.reset(seed=5)[0], theirs.reset(seed=5)[0])
    rng, ended = np.random.default_rng(0), 0
    for _ in range(80):
        actions = erratic(ours, rng)
        a, b = ours.step(actions), theirs.step(actions)
        assert all(np.array_equal(x, y) for x, y in zip(a[:4], b[:4], strict=True))
        going = ~(a[2] | a[3])  # Gymnasium's has those of an ended episode in `final_info` alone
        if going.any():
            np.testing.assert_array_equal(a[4]["costs"][going], b[4]["costs"][going])
        ended += (~going).sum()
    assert ended > 3


@pytest.mark.parametrize("task", PRICED)
def test_episodes_follow_from_the_seed_alone(task: str):
    few, many = made(task, rivers()["ring"], 2, "DISABLED"), made(task, rivers()["ring"], 5, "DISABLED")
    few.reset(seed=3)
    many.reset(seed=3)
    for name in ("pose", "scene", "station", "way"):
        np.testing.assert_array_equal(getattr(few.state, name), getattr(many.state, name)[:2])
    moves = bool(TASKS[task].swimmer_spacing_m)
    assert len(np.unique(many.state.scene)) == (5 if moves else 1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"task": "Lake"}, "task must be one of 'River', 'Swimmers', 'Nests', 'RacingLine', 'Portage', got 'Lake'"),
        ({"hard": True}, "hard must be False in the task River"),
        ({"task": "Nests", "reward_scheme": "package"}, "reward_scheme must be paper in the task Nests"),
        ({"task": "Swimmers", "allow_backward": True}, "allow_backward must be False in the task Swimmers"),
        ({"task": "Swimmers", "forward_step_m": 2.0}, "forward_step_m must be below the fast step"),
        (
            {"task": "RacingLine", "dynamics": "inertial", "action": "continuous"},
            "dynamics must be kinematic in the task RacingLine",
        ),
    ],
)
def test_options_that_contradict_the_task_are_refused(wrong: dict, message: str):
    with pytest.raises(ConfigError, match=message):
        EnvConfig(**wrong)
