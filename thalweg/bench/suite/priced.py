"""Suites of the tasks where a limit has a price: every algorithm at three cost limits by the ideal eye, and some
through frames."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.evaluate.conditions import CONDITIONS
from thalweg.bench.packaged import PACKAGED, PACKAGED_SEES
from thalweg.bench.suite.arms import Arm
from thalweg.bench.suite.config import Suite
from thalweg.bench.suite.policy_files import PolicyFile
from thalweg.env.tasks import TaskName

LIMITS: Mapping[TaskName, tuple[float, float, float]] = {
    "Swimmers": (5.6, 15.0, 32.0),
    "Nests": (8.2, 23.0, 49.0),
    "RacingLine": (1.2, 2.3, 4.2),
    "Portage": (2.1, 9.2, 23.0),
}
"""Cost limits of an episode by task: the mean costs at which the oracle keeps 10, 25 and 50 % of its front's span of
return on the fixed river of Medium (`thalweg.bench.fronts.fronts.cost_limits`). They belong to version
`thalweg.core.versions.TASKS` of the tasks. Those of Portage follow from a front of an oracle that turned back at some
starts; on today's it keeps 5, 24 and 53 %."""
TRAINED_ON = tuple(range(1000, 1016))
"""Rivers of training: a policy that is trained on one river learns that river."""
SEEING = ("PPO", "PPOLag", "FOCOPS", "P3O", "CPO", "CUP", "SACLag")
"""Algorithms that learn through frames."""
SEEING_LIMITS: Mapping[TaskName, tuple[float, ...]] = {
    task: limits[1:] if task in ("Swimmers", "RacingLine") else limits[1:2] for task, limits in LIMITS.items()
}
"""Their cost limits: the middle one, and in two tasks the generous one too."""
SEEING_ENCODER = "geometry-tasks"
"""Encoder of their frames, which tells swimmers, boats, buoys and stations too."""
CONTROLLED: TaskName = "Swimmers"
"""Task in which policies with convolutions of their own are trained beside them, at the middle limit."""


def arms_of(task: TaskName) -> tuple[Arm, ...]:
    """Return an arm of every algorithm for each limit of a task, named after both, and one where there is no limit.

    Limits stay the same while a policy learns. A wide one that tightens helps in the paper's task, where a beginner
    costs more than the limit. Here a beginner costs little, since its flights are short, and then finds it hard to give
    up what a wide limit has taught it.
    """
    arms = []
    for name, entry in ALGORITHMS.items():
        steps = 200_000 if issubclass(entry.config, OnPolicyConfig) else 100_000
        if not hasattr(entry.configure({}), "cost_limit"):
            arms.append(Arm(name, steps=steps))
            continue
        for limit in LIMITS[task]:
            arms.append(Arm(name, settings=_constant(limit), steps=steps, name=f"{name}-{limit:g}"))
    return tuple(arms)


def _constant(limit: float) -> dict[str, Any]:
    """Return the settings of a limit that stays the same."""
    return {"cost_limit": limit, "cost_limit_schedule": []}


def seeing_arms(task: TaskName) -> tuple[Arm, ...]:
    """Return an arm of each of `SEEING` for each of its limits of a task, named after both, and one where there is no
    limit; of the task `CONTROLLED` also those of `_with_convolutions`."""
    arms = []
    for name in SEEING:
        if hasattr(ALGORITHMS[name].configure({}), "cost_limit"):
            arms += [Arm(name, settings=_constant(limit), name=f"{name}-{limit:g}") for limit in SEEING_LIMITS[task]]
        else:
            arms.append(Arm(name))
    return (*arms, *(_with_convolutions(task) if task == CONTROLLED else ()))


def _with_convolutions(task: TaskName) -> tuple[Arm, ...]:
    """Return arms of policies that learn their convolutions too: PPOLag from nothing, and PPOLag and CPO from the
    packaged policy, which was imitated on the paper's task, with a KL from it that vanishes after half of the run.

    That task has no fast step; `thalweg.train.fast_steps` says which share of the moves forward are fast at first.
    """
    limit = LIMITS[task][1]
    settings = {"policy": "cnn"} | _constant(limit)
    near = settings | {"imitation_kl": 1.0, "imitation_kl_share": 0.5}
    begun: dict[str, Any] = {"settings": near, "observation": PACKAGED_SEES, "begin_with": PolicyFile.of(PACKAGED)}
    return (
        Arm("PPOLag", settings=settings, observation=PACKAGED_SEES, name=f"PPOLag-cnn-{limit:g}"),
        *(Arm(name, name=f"{name}-imitated-{limit:g}", **begun) for name in ("PPOLag", "CPO")),
    )


def suite_of(task: TaskName) -> Suite:
    """Return the suite of a task, which has its name in small letters."""
    return Suite(
        task.lower(),
        arms_of(task),
        packaged=False,
        conditions=tuple(condition for condition in CONDITIONS if condition.name == "unseen"),
        observation="privileged",
        world_seeds=TRAINED_ON,
        task=task,
    )


def seeing_suite_of(task: TaskName) -> Suite:
    """Return the suite of a task through frames, with `-frames` after the name of the other: on the level of training
    alone, on its fixed river and on unseen ones."""
    return replace(
        suite_of(task),
        name=f"{task.lower()}-frames",
        arms=seeing_arms(task),
        test_levels=("Medium",),
        observation="frames",
        encoder=SEEING_ENCODER,
    )


PRICED_SUITES = (*map(suite_of, LIMITS), *map(seeing_suite_of, LIMITS))
