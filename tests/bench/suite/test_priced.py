"""The suites of the tasks where a limit has a price: what they train, and that their limits follow from the fronts."""

import pytest

from thalweg.algos.registry import ALGORITHMS, algorithm_named
from thalweg.bench.fronts.fronts import cost_limits, front_of, points_of, read_fronts
from thalweg.bench.suite.builtin import load_suite
from thalweg.bench.suite.config import Run
from thalweg.bench.suite.priced import LIMITS, arms_of
from thalweg.core import versions
from thalweg.env import EnvConfig
from thalweg.env.tasks import PAPER_TASK, TASKS, TaskName


def test_each_task_with_a_price_has_a_suite():
    assert set(LIMITS) == set(TASKS) - {PAPER_TASK}
    assert {load_suite(task).task for task in LIMITS} == set(LIMITS)


@pytest.mark.parametrize("task", LIMITS)
def test_its_limits_are_those_of_the_packaged_front_of_todays_tasks(task: TaskName):
    points = points_of(read_fronts(), task, "Medium")
    assert {point.tasks for point in points} == {versions.TASKS}
    assert cost_limits(front_of(points)) == LIMITS[task]


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
    for arm in limited:
        config = algorithm_named(arm.algorithm).configure(dict(arm.settings))
        assert {config.limits_at(share) for share in (0.0, 0.5, 1.0)} == {(arm.settings["cost_limit"],)}
