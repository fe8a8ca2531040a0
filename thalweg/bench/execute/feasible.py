"""Checks of a suite's rivers before anything is run: files from which no river can be made, reaches of banks beyond
the end of a course, and deadlines and cost limits of tasks that nobody can hold."""

from collections.abc import Sequence

from thalweg.algos.registry import algorithm_named
from thalweg.bench.fronts.attainable import warn_of_limits
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.task.deadlines import check_deadline
from thalweg.env.tasks import TASKS
from thalweg.world import Reach, World, level_named
from thalweg.world.banks import check_banks


def check_feasible(suite: Suite, runs: Sequence[Run]) -> None:
    """Warn of cost limits of some runs that are below the oracle's safest point, as far as their level has a front.

    Raises `WorldError` for rivers that cannot be built, and `ConfigError` for the task of a plug-in whose deadline
    nobody can meet on the fixed river of a level of the suite, or on a real river in place of one.
    """
    _check_courses(suite)
    arms = [arm for arm in suite.arms if arm.label in {run.algorithm for run in runs if run.kind == "train"}]
    stages = [(arm, stage) for arm in arms for stage in (*arm.before, arm)]
    if suite.task not in TASKS:
        for name in dict.fromkeys([*(suite.level_of(stage) for _, stage in stages), *suite.test_levels]):
            check_deadline(_course(suite.ground(name)), suite.rules)
    if suite.hard:  # an episode ends at its first cost
        return
    warn_of_limits(
        suite.task,
        (
            (
                arm.label,
                suite.level_of(stage),
                algorithm_named(stage.algorithm).configure(dict(stage.settings), stage.preset, suite.num_envs),
            )
            for arm, stage in stages
        ),
    )


def _check_courses(suite: Suite) -> None:
    """Raise `WorldError` for a file from which no river can be made, and for a reach of other banks that does not lie
    on the fixed river of its level."""
    for condition in suite.conditions:
        for name in condition.files:
            condition.river(name).check()
    for name in (*suite.grounds, *(level for condition in suite.conditions for level in condition.levels)):
        ground = suite.ground(name)
        if isinstance(ground, Reach):
            ground.check()
        elif banks := level_named(ground).banks:
            river = _course(ground).river
            check_banks(banks, river.length_m, river.closed)


def _course(ground: str | Reach) -> World:
    """Return a real river, or the fixed river of a level without its land."""
    if isinstance(ground, Reach):
        return ground.build()
    level = level_named(ground)
    return load_or_plan(level, level.default_seed)
