"""Tests of the evaluation of policies over a list of episodes."""

from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch

from tests.env import handmade
from tests.env.flights import FORWARD
from thalweg.algos import Policy
from thalweg.algos.policy.actions import actions_of
from thalweg.algos.policy.networks import NetworkShape
from thalweg.algos.policy.policy_file import About
from thalweg.bench.evaluate.baselines import BASELINES, Constant, sight_of
from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.episodes import REASONS, read_episodes, write_episodes
from thalweg.bench.evaluate.evaluation import Label, Step, encoded_frames, evaluate, start_env
from thalweg.core import versions
from thalweg.env import EnvConfig, RiverVectorEnv, sample_starts
from thalweg.render import Camera

CONFIG = EvaluationConfig(episodes=6)
LABEL = Label("tester", 3, "Easy")


class Sampler:
    """A policy that sees frames and samples its actions given the observations."""

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        drawn = torch.randint(3, (len(obs), 4), generator=generator).numpy()
        seen = np.abs(obs[:, :4] * 7).astype(np.int64) % 3
        actions = (drawn + seen) % 3
        actions[:, 2] = np.where(drawn[:, 2] > 0, 0, 1)  # mostly forward, so that flights differ in length
        return np.zeros_like(actions) if deterministic else actions


def course(world=None, count: int = 6) -> Course:
    world = world or handmade.ring()
    return Course(world, sample_starts(world, count, 0), np.linspace(0, 50, count), np.arange(count))


def observe(step: Step) -> np.ndarray:
    return np.column_stack([step.poses, step.time_s]).astype(np.float32)


def test_an_episode_does_not_depend_on_the_others_of_the_batch():
    whole = course()
    together = evaluate(Sampler(), whole, LABEL, CONFIG, observe=observe)
    alone = [evaluate(Sampler(), whole.only(place), LABEL, CONFIG, observe=observe)[0] for place in reversed(range(6))]
    assert together == alone[::-1]
    assert len({row.length for row in together}) > 1  # they did end at different times


def flicker(step: Step) -> np.ndarray:
    """Observations that differ from those of the step before."""
    return np.sin(np.column_stack([step.poses, step.time_s]) * [31, 37, 41, 43, 47]).astype(np.float32)


@pytest.mark.parametrize(("frames", "memory"), [(3, 0), (1, 4)], ids=["frames", "recurrent"])
def test_each_episode_has_a_memory_of_its_own(frames: int, memory: int):
    actions = actions_of(gym.spaces.MultiDiscrete([3, 3, 3, 3]))
    policy = Policy(5, actions, NetworkShape((8,), initial="kaiming", memory=memory), frames=frames, normalise=False)
    with torch.no_grad():
        policy.actor.stack.flat.mul_(10.0)  # so that what is remembered decides
    whole, told = course(), []
    together = evaluate(policy, whole, LABEL, CONFIG, observe=flicker, on_step=told.append)
    assert len({len(step.flying) for step in told}) > 1  # they did end at different times
    assert together == [evaluate(policy, whole.only(place), LABEL, CONFIG, observe=flicker)[0] for place in range(6)]
    assert together != evaluate(Forgetful(policy), whole, LABEL, CONFIG, observe=flicker)


class Forgetful:
    """Treats every observation as the first of an episode."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        return self.policy.player(1, deterministic=deterministic, generator=generator)(obs, np.ones(1, dtype=bool))


def test_each_start_gives_exactly_one_episode_however_early_others_end():
    canal = handmade.canal(length_m=60.0)
    starts = np.array([[x, 0.0, 5.0, 0.0] for x in (50.0, 5.0, 55.0, 30.0)])
    rows = evaluate(BASELINES["forward"], Course(canal, starts, np.zeros(4), np.arange(4)), LABEL, CONFIG)
    assert [row.x for row in rows] == [50, 5, 55, 30]
    assert [row.length for row in rows] == [10, 55, 5, 30]
    assert [(row.end_x, row.end_y, row.end_z) for row in rows] == [(60.0, 0.0, 5.0)] * 4
    assert {row.reason for row in rows} == {"Success"}


def test_hovering_ends_idle_with_a_loose_cost():
    for row in evaluate(BASELINES["hover"], course(), LABEL, CONFIG):
        assert (row.reason, row.cost, row.tight, row.loose, row.success) == ("Idle", 0.2, 0.0, 0.2, False)


def test_the_pilot_completes_a_ring():
    for row in evaluate(BASELINES["pilot"], course(), LABEL, CONFIG):
        assert (row.reason, row.cost, row.success, row.progress) == ("Success", 0.0, True, 1.0)
        assert row.return_ == pytest.approx(10.0)


def test_the_seed_determines_the_sampled_actions():
    rows = [evaluate(BASELINES["random"], course(), Label("random", seed, "Easy"), CONFIG) for seed in (0, 0, 1)]
    assert rows[0] == rows[1]
    assert [row.return_ for row in rows[0]] != [row.return_ for row in rows[2]]
    assert [(row.x, row.yaw) for row in rows[0]] == [(row.x, row.yaw) for row in rows[2]]


def test_a_deterministic_evaluation_passes_deterministic_to_the_policy():
    config = EvaluationConfig(episodes=6, deterministic=True)
    rows = [evaluate(Sampler(), course(), Label("tester", seed, "Easy"), config, observe=observe) for seed in (0, 1)]
    assert [row.length for row in rows[0]] == [row.length for row in rows[1]]


def test_a_policy_that_sees_frames_needs_an_observation_function():
    with pytest.raises(ValueError, match="sees frames"):
        evaluate(Sampler(), course(), LABEL, CONFIG)


class Recorder:
    """A policy of the privileged observation that flies ahead and writes down what it sees."""

    about = About("PPO", {}, {"observation": "privileged", "privileged_version": versions.PRIVILEGED})

    def __init__(self) -> None:
        self.saw: list[np.ndarray] = []

    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        self.saw.append(obs.copy())
        return np.tile([1, 1, 0, 1], (len(obs), 1))


def test_a_policy_of_the_privileged_observation_sees_that_of_the_environment():
    canal, recorder = handmade.canal(length_m=60.0), Recorder()
    starts = np.array([[50.0, 0.0, 5.0, 0.0], [5.0, 1.0, 4.0, 0.1]])
    rows = evaluate(recorder, Course(canal, starts, np.zeros(2), np.arange(2)), LABEL, CONFIG)
    env = RiverVectorEnv([canal], 2, EnvConfig(observation="privileged"))
    seen, _ = env.reset(seed=0, options={"pose": starts})
    for step in range(rows[0].length):  # both fly
        np.testing.assert_array_equal(np.concatenate(recorder.saw[2 * step : 2 * step + 2]), seen)
        seen, *_ = env.step(np.tile([1, 1, 0, 1], (2, 1)))
    assert rows[0].length == 10 and len(recorder.saw) == sum(row.length for row in rows)


def test_a_given_function_replaces_the_privileged_observation():
    recorder = Recorder()
    evaluate(recorder, course(), LABEL, CONFIG, observe=observe)
    assert {obs.shape for obs in recorder.saw} == {(1, 5)}


@pytest.mark.parametrize(
    ("policy", "sight"),
    [
        (BASELINES["pilot"], "scripted"),
        (BASELINES["steady"], "steady"),
        (BASELINES["hover"], "nothing"),
        (Recorder(), "privileged"),
        (Sampler(), "frames"),
        (SimpleNamespace(about=About("PPO", {}, {"encoder": "ab"})), "frames"),
    ],
)
def test_what_a_policy_sees_is_known_from_itself_or_its_training(policy: object, sight: str):
    assert sight_of(policy) == sight


def test_encoded_frames_are_those_of_the_environment():
    starts = np.array([[x, 0.0, 5.0, 0.0] for x in (5.0, 15.0, 25.0)])
    whole = Course(handmade.canal(), starts, np.array([0.0, 7.0, 31.0]), np.arange(3))
    shown: list[np.ndarray] = []

    class Encoder:
        device = torch.device("cpu")
        inputs = "rgb+mask"

        def of_tensor(self, frames: torch.Tensor) -> torch.Tensor:
            shown.append(frames.numpy().copy())
            return torch.zeros(len(frames), 4)

    renderer = handmade.BlankRenderer()
    renderer.camera = SimpleNamespace(**vars(Camera()) | vars(renderer.camera))  # smaller than a camera may be
    see = encoded_frames(whole.world, Encoder(), renderer)  # pyright: ignore[reportArgumentType]
    evaluate(Straight(), whole, LABEL, CONFIG, observe=see)
    env = RiverVectorEnv([whole.world], 3, renderer=handmade.BlankRenderer())
    env.reset(seed=0, options={"pose": whole.starts})
    env.set_state({**env.get_state(), "time_s": whole.clocks_s})
    for frames in shown[1:4]:
        seen, *_ = env.step(np.tile([1, 1, 0, 1], (3, 1)))
        np.testing.assert_array_equal(frames, seen)


class Straight:
    def act(self, obs: np.ndarray, *, deterministic: bool, generator: torch.Generator) -> np.ndarray:
        return np.tile([1, 1, 0, 1], (len(obs), 1))


def test_on_step_receives_the_running_episodes():
    told: list[Step] = []
    rows = evaluate(BASELINES["forward"], course(), LABEL, CONFIG, on_step=told.append)
    assert sum(len(step.flying) for step in told) == sum(row.length for row in rows)
    np.testing.assert_array_equal(told[0].poses, course().starts)
    np.testing.assert_array_equal(told[0].time_s, course().clocks_s)


def test_episodes_read_back_are_identical(tmp_path):
    rows = evaluate(BASELINES["random"], course(), LABEL, CONFIG)
    write_episodes(tmp_path / "rows.csv", rows)
    assert read_episodes(tmp_path / "rows.csv") == rows


def test_files_without_end_positions_can_be_read(tmp_path: Path):
    rows = evaluate(BASELINES["hover"], course(), LABEL, CONFIG)
    path = tmp_path / "rows.csv"
    write_episodes(path, rows)
    path.write_text("".join(",".join(line.split(",")[:-3]) + "\n" for line in path.read_text().splitlines()))
    found = read_episodes(path)
    assert all(np.isnan([row.end_x, row.end_y, row.end_z]).all() for row in found)
    assert [row.return_ for row in found] == [row.return_ for row in rows]


def test_reasons_have_the_names_of_the_paper():
    assert REASONS == (
        "Collision",
        "OutOfVolumeHorizontal",
        "OutOfVolumeVertical",
        "YawOverDeviation",
        "Idle",
        "MaxStepReached",
        "Success",
    )


def test_on_an_open_course_an_episode_says_what_share_of_the_way_ahead_was_flown(tmp_path: Path):
    """60 segments from x = 0. From x = 40.5, in segment 40, 20 lie ahead; four steps visit five of them."""
    world = handmade.canal()
    starts = np.array([[40.5, 0.0, 4.0, 0.0], [19.5, 0.0, 4.0, np.pi]])
    ahead = Course(world, starts, np.zeros(2), np.arange(2))
    rules = EnvConfig(observation="none", max_steps=4)
    rows = evaluate(BASELINES["forward"], ahead, LABEL, EvaluationConfig(episodes=2, env=rules))
    assert [row.progress for row in rows] == [5 / 60, 5 / 60]
    assert [row.ahead for row in rows] == pytest.approx([5 / 20, 5 / 20])
    write_episodes(tmp_path / "open.csv", rows)
    assert read_episodes(tmp_path / "open.csv") == rows


def test_on_a_loop_nothing_is_said_of_the_way_ahead_and_files_are_as_before(tmp_path: Path):
    (row,) = evaluate(BASELINES["hover"], course(count=1), LABEL, EvaluationConfig(episodes=1))
    assert row.ahead is None
    write_episodes(tmp_path / "loop.csv", [row])
    assert "ahead" not in (tmp_path / "loop.csv").read_text().splitlines()[0].split(",")
    assert read_episodes(tmp_path / "loop.csv") == [row]


def test_in_portage_what_lies_ahead_is_the_way_to_the_station():
    """The stations are 2 m from the ends of 60 m, so 17.5 m lie ahead of each start; four steps fly four of them."""
    starts = np.array([[40.5, 0.0, 4.0, 0.0], [19.5, 0.0, 4.0, np.pi]])
    ahead = Course(handmade.canal(), starts, np.zeros(2), np.arange(2))
    rules = EnvConfig(task="Portage", observation="none", max_steps=4)
    rows = evaluate(BASELINES["forward"], ahead, LABEL, EvaluationConfig(episodes=2, env=rules))
    assert [row.ahead for row in rows] == pytest.approx([4 / 17.5, 4 / 17.5])


def test_the_cost_of_an_episode_is_of_all_kinds():
    config = EvaluationConfig(4, env=EnvConfig(observation="none", task="RacingLine"))
    course = Course.on(handmade.ring(), config)
    env, flying, costs = start_env(course, config), np.ones(4, bool), np.zeros((4, 3))
    while flying.any():
        *_, terminated, truncated, info = env.step(np.tile(FORWARD, (4, 1)))
        costs[flying] += info["costs"][flying]
        flying &= ~(terminated | truncated)
    rows = evaluate(Constant(FORWARD), course, Label("ahead", 0, "Easy"), config)
    assert [row.cost for row in rows] == pytest.approx(costs.sum(1))
    assert [row.tight + row.loose for row in rows] == pytest.approx(costs[:, :2].sum(1))
    assert costs[:, 2].max() > 0


def test_each_start_has_its_own_scene_whichever_others_are_flown():
    config = EvaluationConfig(3, env=EnvConfig(observation="none", task="Swimmers"))
    course = Course.on(handmade.ring(), config)
    scenes = start_env(course, config).get_state()["scene"]
    assert len(set(scenes.tolist())) == 3
    np.testing.assert_array_equal(start_env(course.those([0, 2]), config).get_state()["scene"], scenes[[0, 2]])
