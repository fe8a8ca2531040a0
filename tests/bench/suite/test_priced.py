"""The suites of the tasks where a limit has a price: what they train, and that their limits follow from the fronts."""

import pytest

from thalweg.algos.registry import ALGORITHMS, algorithm_named
from thalweg.bench.fronts.fronts import cost_limits, front_of, points_of, read_fronts
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.builtin import load_suite
from thalweg.bench.suite.priced import LIMITS, SEEING, arms_of, seeing_arms
from thalweg.core import versions
from thalweg.env import EnvConfig
from thalweg.env.tasks import PAPER_TASK, TASKS, TaskName


def test_each_task_with_a_price_has_a_suite():
    assert set(LIMITS) == set(TASKS) - {PAPER_TASK}
    for suffix in ("", "-frames"):
        assert {load_suite(task + suffix).task for task in LIMITS} == set(LIMITS)


@pytest.mark.parametrize("task", LIMITS)
def test_its_limits_are_those_of_the_packaged_front_of_todays_tasks(task: TaskName):
    points = points_of(read_fronts(), task, "Medium")
    assert {point.tasks for point in points} == {versions.TASKS}
    if task != "Portage":
        assert cost_limits(front_of(points)) == LIMITS[task]


def test_the_limits_of_portage_stayed_when_its_oracle_was_mended():
    front = front_of(points_of(read_fronts(), "Portage", "Medium"))
    least, most = front.return_[[0, -1]]
    kept = [(float(front.greatest_return(limit)) - least) / (most - least) for limit in LIMITS["Portage"]]
    assert kept == pytest.approx([0.05, 0.24, 0.53], abs=0.005)


@pytest.mark.parametrize("task", LIMITS)
def test_every_algorithm_is_trained_at_each_limit_with_three_seeds(task: TaskName):
    suite = load_suite(task.lower())
    limits = {name: [] for name in ALGORITHMS}
    for arm in suite.arms:
        limits[arm.algorithm].append(arm.settings.get("cost_limit"))
    assert limits.pop("PPO") == [None]
    assert len(limits) == 11 and all(tuple(found) == LIMITS[task] for found in limits.values())
    trained = [run for run in suite.runs() if run.kind == "train"]
    assert len(trained) == 3 * (1 + 11 * 3) and len({run.name for run in trained}) == len(trained)


def test_policies_see_the_ideal_eye_on_sixteen_rivers_and_fly_all_levels_and_unseen_rivers():
    suite = load_suite("nests")
    run = Run("train", f"FOCOPS-{LIMITS['Nests'][0]:g}", 0)
    assert suite.observation_of(run) == "privileged" and suite.world_seeds == tuple(range(1000, 1016))
    assert {arm.label: arm.steps for arm in suite.arms}[run.algorithm] == 200_000
    assert {arm.label: arm.steps for arm in suite.arms}[f"SafeLOOP-{LIMITS['Nests'][1]:g}"] == 100_000
    flown = [str(trial) for trial in suite.trials(run)]
    assert flown == ["Easy", "Medium", "Hard", "Easy, unseen", "Medium, unseen", "Hard, unseen"]


@pytest.mark.parametrize("task", LIMITS)
def test_limits_lie_between_the_ends_of_the_front(task: TaskName):
    front = front_of(points_of(read_fronts(), task, "Medium"))
    assert front.cost[0] < LIMITS[task][0] < LIMITS[task][1] < LIMITS[task][2] < front.cost[-1]
    assert EnvConfig(task=task, observation="none").task_record.cost_kinds[2]


@pytest.mark.parametrize("task", LIMITS)
def test_limits_stay_the_same_while_a_policy_learns(task: TaskName):
    limited = [arm for arm in arms_of(task) if "cost_limit" in arm.settings]
    assert len(limited) == 3 * (len(ALGORITHMS) - 1)
    for arm in (*limited, *(arm for arm in seeing_arms(task) if arm.algorithm != "PPO")):
        config = algorithm_named(arm.algorithm).configure(dict(arm.settings))
        assert {config.limits_at(share) for share in (0.0, 0.5, 1.0)} == {(arm.settings["cost_limit"],)}


@pytest.mark.parametrize(
    ("task", "limits"), [("Swimmers", (15, 32)), ("RacingLine", (2.3, 4.2)), ("Nests", (23,)), ("Portage", (9.2,))]
)
def test_seven_algorithms_learn_through_frames_at_the_middle_limit_and_in_two_tasks_at_the_generous_one(
    task: TaskName, limits: tuple[float, ...]
):
    suite = load_suite(f"{task.lower()}-frames")
    assert suite.task == task and suite.world_seeds == tuple(range(1000, 1016))
    coded = [arm for arm in suite.arms if arm.observation is None]
    runs = [Run("train", arm.label, 0) for arm in coded]
    assert {(suite.observation_of(run), suite.encoder_of(run)) for run in runs} == {("frames", "geometry-tasks")}
    found = {name: [arm.settings.get("cost_limit") for arm in coded if arm.algorithm == name] for name in SEEING}
    assert found.pop("PPO") == [None] and list(found.values()) == [list(limits)] * 6
    assert {(arm.steps, arm.seeds) for arm in suite.arms} == {(200_000, (0, 1, 2))}
    assert [str(trial) for trial in suite.trials(runs[0])] == ["Medium", "Medium, unseen"]


def test_policies_with_convolutions_learn_to_mind_swimmers_from_nothing_and_from_the_packaged_policy():
    arms = {arm.label: arm for arm in load_suite("swimmers-frames").arms if arm.observation == "rgb+mask"}
    begun = {"PPOLag-cnn-15": "", "PPOLag-imitated-15": "packaged", "CPO-imitated-15": "packaged"}
    assert {name: arm.as_data().get("begin_with", "") for name, arm in arms.items()} == begun
    for name, arm in arms.items():
        config = algorithm_named(arm.algorithm).configure(dict(arm.settings))
        assert config.cost_limit == 15.0 and config.sees_images
        assert config.imitation_weight(0.0) == (1.0 if begun[name] else 0.0) and config.imitation_weight(0.5) == 0.0
