"""Known-answer cases as data, and training runs that compare an algorithm with the optimum of a problem.

A case is an algorithm in an action space on a problem. It is compared with the best policy of its kind:

* `free`: the best without a limit (PPO, which knows none);
* `limited`: the best within the limit, which may be stochastic;
* `deterministic`: the best deterministic policy within the limit (DDPG, TD3);
* `planner`: what a perfect planner with the algorithm's horizon reaches (`solutions.planned`): with the same number
  of steps ahead, terminal value 0 and its share of the limit at every decision.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tests.known_answer.envs import ProblemEnv, SpaceName
from tests.known_answer.problems import PROBLEMS
from tests.known_answer.scores import Score, score
from tests.known_answer.solutions import Limit, Outcome, best_deterministic, optimum, planned
from thalweg.algos import ALGORITHMS
from thalweg.algos.planning.config import PlanningConfig
from thalweg.train import run

Against = Literal["free", "limited", "deterministic", "planner"]
SHARE = 0.9
"""Required share of the optimum's return."""
EXCESS, LEAST_EXCESS = 0.1, 0.02
"""Tolerance of a cost above its limit: a share of the limit, or an absolute value; the larger one counts."""


@dataclass(frozen=True)
class ActionSetup:
    """Action space of the environment, and the settings that adapt the policy to it."""

    space: SpaceName
    config: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the algorithm for this setup."""


ACTION_SETUPS: dict[str, ActionSetup] = {
    "multidiscrete": ActionSetup("multidiscrete"),
    "discrete": ActionSetup("discrete"),
    "box": ActionSetup("box"),
    "box_literal": ActionSetup("multidiscrete", {"adapter": "box_literal"}),
    "box_scaled": ActionSetup("multidiscrete", {"adapter": "box_scaled"}),
}
"""The action spaces, and the two adapters that round continuous actions to options. `box_literal` is included to show
its defect; nothing is required of it."""


@dataclass(frozen=True)
class Requirement:
    """Requirements on an algorithm, and the settings of its runs."""

    against: Against
    steps: int = 160_000
    config: Mapping[str, Any] = field(default_factory=dict)
    """Settings that differ from the algorithm's defaults."""
    action_setups: tuple[str, ...] = tuple(ACTION_SETUPS)
    """Action setups that it runs with, the native one first."""
    problems: tuple[str, ...] = tuple(PROBLEMS)
    in_ci: tuple[str, ...] = ("dense",)
    """Problems that CI runs in the native space."""


OFF_POLICY = {"steps_per_update": 512, "updates_per_step": 0.5}
"""Settings for episodes of ten steps: about as many episodes between two updates of a multiplier as on a river, and
more gradient steps between them. All else, multipliers and bounds included, is as by default."""
REQUIREMENTS: dict[str, Requirement] = {
    "PPO": Requirement("free", in_ci=("dense", "end")),
    "PPOLag": Requirement("limited"),
    "FOCOPS": Requirement("limited", in_ci=("dense", "end")),
    "P3O": Requirement("limited"),
    "OnCRPO": Requirement("limited"),
    "CPO": Requirement("limited"),
    "CUP": Requirement("limited"),
    "DDPGLag": Requirement("deterministic", steps=60_000, config=OFF_POLICY),
    "TD3Lag": Requirement("deterministic", steps=60_000, config=OFF_POLICY),
    "SACLag": Requirement("limited", steps=60_000, config=OFF_POLICY),
    "SafeLOOP": Requirement("planner", steps=10_000, in_ci=("mixture",)),
    "CCEPETS": Requirement("planner", steps=10_000),
}
"""The requirements on every algorithm. SafeLOOP ends just below nine tenths on `dense`, so that CI runs it on
another problem; the benchmark's table has all problems."""


@dataclass(frozen=True)
class Case:
    """An algorithm with an action setup on a problem."""

    algorithm: str
    action_setup: str
    problem: str

    @property
    def requirement(self) -> Requirement:
        return REQUIREMENTS[self.algorithm]

    @property
    def limit(self) -> Limit:
        """The limit of the run: a number, or one for each kind of cost if there are several."""
        limits = PROBLEMS[self.problem].limits
        return limits[0] if len(limits) == 1 else limits

    @property
    def config(self) -> dict[str, Any]:
        """The settings that differ from the algorithm's defaults."""
        limits: dict[str, Any] = {}
        if self.requirement.against != "free":
            limits = {"cost_limits": self.limit} if isinstance(self.limit, tuple) else {"cost_limit": self.limit}
        return limits | dict(self.requirement.config) | dict(ACTION_SETUPS[self.action_setup].config)

    @property
    def horizon(self) -> int:
        """H of a planner, in steps; of any other algorithm 0."""
        config = ALGORITHMS[self.algorithm].configure(self.config)
        return config.sizes.horizon * config.action_repeat if isinstance(config, PlanningConfig) else 0


@dataclass(frozen=True)
class Result:
    """Score of a trained policy beside the optimum."""

    case: Case
    score: Score
    optimum: Outcome

    @property
    def share(self) -> float:
        """Share of the optimum's return."""
        return self.score.reward / self.optimum.reward

    @property
    def excess(self) -> float:
        """Largest excess of a cost over its limit and tolerance; negative if all are within."""
        if self.case.requirement.against == "free":
            return -np.inf
        limits = np.atleast_1d(np.asarray(self.case.limit, dtype=float))
        costs = self.score.costs if len(limits) > 1 else np.array([self.score.cost])
        return float((costs - limits - np.maximum(EXCESS * limits, LEAST_EXCESS)).max())

    @property
    def reached(self) -> bool:
        return self.share >= SHARE and self.excess <= 0.0


def cases(
    algorithms: Collection[str] = tuple(REQUIREMENTS), problems: Collection[str] = tuple(PROBLEMS)
) -> Iterator[Case]:
    """Yield every case of the named algorithms and problems."""
    for algorithm in algorithms:
        requirement = REQUIREMENTS[algorithm]
        for problem in (name for name in requirement.problems if name in problems):
            yield from (Case(algorithm, setup, problem) for setup in requirement.action_setups)


def reference(case: Case) -> Outcome:
    """Return the optimum that the case is compared with."""
    return _reference(case.problem, case.requirement.against, case.limit, case.horizon)


@cache
def _reference(name: str, against: Against, limit: Limit, horizon: int) -> Outcome:
    problem = PROBLEMS[name]
    if against == "free":
        return optimum(problem)
    best = optimum(problem, limit)
    if against == "deterministic":
        return best_deterministic(problem, limit)
    return planned(problem, limit, horizon, length=best.length) if against == "planner" else best


def trained(case: Case, seed: int, folder: Path) -> Result:
    """Train and compare the final policy with the optimum; an interrupted run is resumed."""
    problem, setup, requirement = PROBLEMS[case.problem], ACTION_SETUPS[case.action_setup], case.requirement
    env = ProblemEnv(problem, space=setup.space)
    ended = run(case.algorithm, env, steps=requirement.steps, seed=seed, folder=folder, config=case.config)
    return Result(case, score(ended.policy, problem, setup.space, seed), reference(case))
