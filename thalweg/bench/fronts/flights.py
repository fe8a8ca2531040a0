"""Flights of the oracle from the fixed starts of a level, by price of cost: the points of its front."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from thalweg.bench.evaluate.course import Course, EvaluationConfig
from thalweg.bench.evaluate.evaluation import start_env
from thalweg.bench.fronts.fronts import FIXED, UNSEEN, FrontPoint
from thalweg.bench.results.inference import CONFIDENCE
from thalweg.core import versions
from thalweg.env import RiverVectorEnv
from thalweg.env.oracle.oracle import Oracle
from thalweg.env.spaces import from_unit_actions

PRICES = (0.0, 0.003, 0.01, 0.02, 0.025, 0.03, 0.04, 0.05, 0.07, 0.1, 0.2, 0.5, 2.0, 10.0)
"""Prices of a cost of 1 in units of return, of which a whole course pays 10."""


@dataclass(frozen=True)
class Flights:
    """What N flights returned and cost."""

    return_: np.ndarray
    """[N] float64."""
    cost: np.ndarray
    """[N] float64."""
    reason: np.ndarray
    """[N] int64, codes of `thalweg.env.DoneReason`."""


def fly(course: Course, config: EvaluationConfig, price: float) -> Flights:
    """Return the oracle's flights from the starts of a course at a price; raises the errors of `Oracle`."""
    if course.rivers:
        raise ValueError("an oracle flies in one river: give courses one by one")
    env = start_env(course, config)
    oracle = Oracle(env.courses, config.env, price)
    plan, ahead = oracle.plan(env.state)
    total = Flights(np.zeros(env.num_envs), np.zeros(env.num_envs), np.full(env.num_envs, -1))
    while (flying := total.reason < 0).any():
        _step(env, oracle.actions(plan, env.state, ahead, flying), flying, total)
    env.close()
    return total


def _step(env: RiverVectorEnv, unit_actions: np.ndarray, flying: np.ndarray, total: Flights) -> None:
    """Take a step, and add what it returned and cost where flying [N] is True."""
    actions = from_unit_actions(env.config.action, unit_actions, env.config.fast_ratio)
    _, reward, _, _, info = env.step(actions)
    total.return_[flying] += reward[flying]
    total.cost[flying] += info["cost"][flying]
    total.reason[flying] = info["done_reason"][flying]


def front_points(
    level: str,
    config: EvaluationConfig,
    *,
    unseen: bool = False,
    prices: Sequence[float] = PRICES,
    on_price: Callable[[float], None] | None = None,
) -> Iterator[FrontPoint]:
    """Yield a point of the front of a level for each price; `on_price` is called before each.

    `config` has the task and the number of starts: all on the level's fixed river, or, if `unseen`, one on each of as
    many unseen rivers.
    """
    fixed = () if unseen else (Course.of_level(level, config, drawn=False),)
    courses = list(Course.unseen(level, config, drawn=False)) if unseen else fixed
    for price in prices:
        if on_price is not None:
            on_price(price)
        flights = [fly(course, config, price) for course in courses]
        returns, costs = (np.concatenate([getattr(each, name) for each in flights]) for name in ("return_", "cost"))
        ends = (*_interval(returns), *_interval(costs))
        figures = price, len(returns), float(returns.mean()), *ends[:2], float(costs.mean()), *ends[2:]
        yield FrontPoint(config.env.task, level, UNSEEN if unseen else FIXED, *figures, versions.TASKS)


def _interval(values: np.ndarray) -> tuple[float, float]:
    """Return the ends of Student's t interval of the mean of independent flights [N]; those of the value for one."""
    mean = float(values.mean())
    if len(values) < 2 or np.ptp(values) == 0:
        return mean, mean
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * stats.sem(values))
    return mean - half, mean + half
