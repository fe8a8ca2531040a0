"""Checks of a suite's task on its levels before anything is run: deadlines and cost limits that nobody can hold."""

from collections.abc import Sequence

from thalweg.algos.registry import algorithm_named
from thalweg.bench.fronts.attainable import warn_of_limits
from thalweg.bench.suite.arms import Run
from thalweg.bench.suite.config import Suite
from thalweg.env.rivers.bare_river import load_or_plan
from thalweg.env.task.deadlines import check_deadline
from thalweg.env.tasks import TASKS
from thalweg.world import level_named


def check_feasible(suite: Suite, runs: Sequence[Run]) -> None:
    """Warn of cost limits of some runs that are below the oracle's safest point.

    Raises `ConfigError` for the task of a plug-in whose deadline nobody can meet on the fixed river of a level of the
    suite.
    """
    arms = [arm for arm in suite.arms if arm.label in {run.algorithm for run in runs if run.kind == "train"}]
    stages = [(arm, stage) for arm in arms for stage in (*arm.before, arm)]
    if suite.task not in TASKS:
        for name in dict.fromkeys([*(stage.level or suite.train_level for _, stage in stages), *suite.test_levels]):
            level = level_named(name)
            check_deadline(load_or_plan(level, level.default_seed), suite.rules)
    if suite.hard:  # an episode ends at its first cost
        return
    warn_of_limits(
        suite.task,
        (
            (
                arm.label,
                stage.level or suite.train_level,
                algorithm_named(stage.algorithm).configure(dict(stage.settings), stage.preset, suite.num_envs),
            )
            for arm, stage in stages
        ),
    )
