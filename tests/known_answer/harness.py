"""Known-answer cases as data, and training runs that compare an algorithm with the optimum of a problem.

A cell is an algorithm in an action space on a problem. It is compared with the best policy of its kind:

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
"""Least share of the optimum's return."""
EXCESS, LEAST_EXCESS = 0.1, 0.02
"""By how much the cost may exceed its limit: as a share of the limit, or so much, whichever is more."""


@dataclass(frozen=True)
class Place:
    """Action space of the environment, and the settings that adapt the policy to it."""

    space: SpaceName
    config: Mapping[str, Any] = field(default_factory=dict)
    """Settings that the algorithm needs for it."""


PLACES: dict[str, Place] = {
    "multidiscrete": Place("multidiscrete"),
    "discrete": Place("discrete"),
    "box": Place("box"),
    "box_literal": Place("multidiscrete", {"adapter": "box_literal"}),
    "box_scaled": Place("multidiscrete", {"adapter": "box_scaled"}),
}
"""The action spaces, and the two adapters, by which numbers choose among three. `box_literal` is there to show what
is wrong with it: nothing is asked of it."""


@dataclass(frozen=True)
class Row:
    """Requirements on an algorithm, and the settings of its runs."""

    against: Against
    steps: int = 160_000
    config: Mapping[str, Any] = field(default_factory=dict)
    """Other settings than its own defaults."""
    places: tuple[str, ...] = tuple(PLACES)
    """The first is its native one."""
    problems: tuple[str, ...] = tuple(PROBLEMS)
    in_ci: tuple[str, ...] = ("dense",)
    """Problems of which CI tries the native space, with one seed."""


OFF_POLICY = {"hidden": (64, 64), "minibatch": 128, "steps_per_update": 512}
OFF_POLICY |= {"multiplier_rate": 2.0, "multiplier_gain": 5.0, "updates_per_step": 0.5}
"""For tables of four states and episodes of ten steps: small networks, more gradient steps, as many episodes between
two moves of a multiplier as a river has, and multipliers that reach the 5 to 13 that a cost is worth there. SACLag is
told to keep more entropy: a policy that draws lots has it. PPOLag gets PPO's entropy bonus, for its own is meant for
rivers, and CUP's multiplier answers less to a violation, which is larger here than a river's can be."""
ROWS: dict[str, Row] = {
    "PPO": Row("free", in_ci=("dense", "end")),
    "PPOLag": Row("limited", config={"entropy": 0.003}),
    "FOCOPS": Row("limited", in_ci=("dense", "end")),
    "P3O": Row("limited"),
    "OnCRPO": Row("limited"),
    "CPO": Row("limited"),
    "CUP": Row("limited", config={"multiplier_gain": 2.0}),
    "DDPGLag": Row("deterministic", steps=60_000, config=OFF_POLICY),
    "TD3Lag": Row("deterministic", steps=60_000, config=OFF_POLICY),
    "SACLag": Row("limited", steps=60_000, config={**OFF_POLICY, "entropy_share": 0.3}),
    "SafeLOOP": Row("planner", steps=10_000, in_ci=("mixture",)),
    "CCEPETS": Row("planner", steps=10_000),
}
"""Every algorithm that Thalweg has. SafeLOOP ends near nine tenths on `dense`, above it with some seeds and below it
with others, so that CI tries it on another problem; the benchmark's table has all of them."""


@dataclass(frozen=True)
class Cell:
    """An algorithm in a place on a problem."""

    algorithm: str
    place: str
    problem: str

    @property
    def row(self) -> Row:
        return ROWS[self.algorithm]

    @property
    def limit(self) -> Limit:
        """What the run is told to keep: a number, or one for each kind of cost where there are several."""
        limits = PROBLEMS[self.problem].limits
        return limits[0] if len(limits) == 1 else limits

    @property
    def config(self) -> dict[str, Any]:
        """The settings that differ from the algorithm's defaults."""
        told: dict[str, Any] = {}
        if self.row.against != "free":
            told = {"cost_limits": self.limit} if isinstance(self.limit, tuple) else {"cost_limit": self.limit}
        return told | dict(self.row.config) | dict(PLACES[self.place].config)

    @property
    def horizon(self) -> int:
        """H of a planner, in steps; of any other algorithm 0."""
        config = ALGORITHMS[self.algorithm].configure(self.config)
        return config.sizes.horizon * config.action_repeat if isinstance(config, PlanningConfig) else 0


@dataclass(frozen=True)
class Result:
    """Score of a trained policy beside the optimum."""

    cell: Cell
    score: Score
    optimum: Outcome

    @property
    def share(self) -> float:
        """Share of the optimum's return."""
        return self.score.reward / self.optimum.reward

    @property
    def excess(self) -> float:
        """Largest excess of a cost over its limit and tolerance; negative if all are within."""
        if self.cell.row.against == "free":
            return -np.inf
        limits = np.atleast_1d(np.asarray(self.cell.limit, dtype=float))
        costs = self.score.costs if len(limits) > 1 else np.array([self.score.cost])
        return float((costs - limits - np.maximum(EXCESS * limits, LEAST_EXCESS)).max())

    @property
    def reached(self) -> bool:
        return self.share >= SHARE and self.excess <= 0.0


def cells(algorithms: Collection[str] = tuple(ROWS), problems: Collection[str] = tuple(PROBLEMS)) -> Iterator[Cell]:
    """Every cell of the algorithms and problems named."""
    for algorithm in algorithms:
        row = ROWS[algorithm]
        for problem in (name for name in row.problems if name in problems):
            yield from (Cell(algorithm, place, problem) for place in row.places)


def reference(cell: Cell) -> Outcome:
    """Optimum that the cell is compared with."""
    return _reference(cell.problem, cell.row.against, cell.limit, cell.horizon)


@cache
def _reference(name: str, against: Against, limit: Limit, horizon: int) -> Outcome:
    problem = PROBLEMS[name]
    if against == "free":
        return optimum(problem)
    best = optimum(problem, limit)
    if against == "deterministic":
        return best_deterministic(problem, limit)
    return planned(problem, limit, horizon, length=best.length) if against == "planner" else best


def trained(cell: Cell, seed: int, folder: Path) -> Result:
    """Train and compare the final policy with the optimum; an interrupted run is resumed."""
    problem, place, row = PROBLEMS[cell.problem], PLACES[cell.place], cell.row
    env = ProblemEnv(problem, space=place.space)
    ended = run(cell.algorithm, env, steps=row.steps, seed=seed, folder=folder, config=cell.config)
    return Result(cell, score(ended.policy, problem, place.space, seed), reference(cell))
