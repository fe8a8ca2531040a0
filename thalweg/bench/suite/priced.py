"""Suites of the tasks where a limit has a price: every algorithm at three cost limits, by the ideal eye."""

from collections.abc import Mapping

from thalweg.algos.onpolicy.config import OnPolicyConfig
from thalweg.algos.registry import ALGORITHMS
from thalweg.bench.evaluate.conditions import CONDITIONS
from thalweg.bench.suite.config import Arm, Suite
from thalweg.env.tasks import TaskName

LIMITS: Mapping[TaskName, tuple[float, float, float]] = {
    "Swimmers": (5.6, 15.0, 32.0),
    "Nests": (8.2, 23.0, 49.0),
    "RacingLine": (1.2, 2.3, 4.2),
    "Portage": (2.1, 9.2, 23.0),
}
"""Cost limits of an episode by task: the mean costs at which the oracle keeps 10, 25 and 50 % of its front's span of
return on the fixed river of Medium (`thalweg.bench.fronts.fronts.cost_limits`). They belong to version
`thalweg.core.versions.TASKS` of the tasks."""
TRAINED_ON = tuple(range(1000, 1016))
"""Rivers of training: a policy that is trained on one river learns that river."""


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
            settings = {"cost_limit": limit, "cost_limit_schedule": []}
            arms.append(Arm(name, settings=settings, steps=steps, name=f"{name}-{limit:g}"))
    return tuple(arms)


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


PRICED_SUITES = tuple(map(suite_of, LIMITS))
