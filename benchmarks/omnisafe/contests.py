"""What is compared? A row for each algorithm: what to set on either side so that both do the same, and what cannot be.

Settings of OmniSafe are nested as in its own files, those of Thalweg are keys of the algorithm's config on top of the
preset "paper", which is OmniSafe's defaults: so what is not named here is alike, down to OmniSafe's errors, but for
what the pages of the algorithms list as not repeated, and what is `MENDED` is where the two differ. `speed` has
OmniSafe's own sizes of networks, batches and updates, and stops no update early, so that both sides do the same work;
`curves` is small enough for three seeds on two cores.
"""

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

ENVS = 16
"""Thalweg's environments where it learns from steps; a planner decides for one."""
LIMIT = 0.1
"""Mean cost that an episode may have, where an algorithm has a limit."""
ACTION_REPEAT = 5
"""Steps for which a decision of a planner holds."""
QUIET = {"logger_cfgs": {"use_tensorboard": False, "use_wandb": False, "save_model_freq": 10**9}}
"""What OmniSafe need not write, which favours it."""


@dataclass(frozen=True)
class Work:
    """A run of either side."""

    steps: int
    peer: Mapping[str, Any]
    ours: Mapping[str, Any]
    start: int = 0
    """Steps that are not measured: actions at random, before there is something to learn from."""
    stamp_every: int = 100
    """Steps between two looks of OmniSafe's at the clock."""


class Works(NamedTuple):
    """What an algorithm is compared by."""

    speed: Work
    curves: Work


@dataclass(frozen=True)
class Contest:
    """One algorithm on both sides."""

    algorithm: str
    unit: Literal["steps", "decisions"]
    least: float | None
    """Thalweg must do so many times OmniSafe's units a second."""
    works: Works
    differs: str = ""
    """What OmniSafe 0.5.0 does otherwise than the algorithm's paper, and Thalweg does not."""
    envs: int = ENVS
    """Thalweg's environments; OmniSafe has one, more would be processes that wait for each other."""
    threads: Mapping[str, int] = field(default_factory=lambda: {"OmniSafe": 1, "Thalweg": 1})
    """Of PyTorch: the faster of one and two."""


def merged(*parts: Mapping[str, Any]) -> dict[str, Any]:
    """One nested mapping of several, of which the later ones win."""
    result: dict[str, Any] = {}
    for part in parts:
        for key, value in part.items():
            both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
            result[key] = merged(result[key], value) if both else deepcopy(value)
    return result


MENDED: Mapping[str, Mapping[str, Any]] = {
    "PPO": {},
    "PPOLag": {},
    "FOCOPS": {"mask": "state", "normalise_by_multiplier": False},
    "P3O": {"clip_cost": True, "limit_scale": "length"},
    "OnCRPO": {"kl_per_dimension": False},
    "DDPGLag": {"target_actor": True},
    "TD3Lag": {"cost_target": "smoothed"},
    "SACLag": {"cost_target": "policy"},
    "SafeLOOP": {"drop_terminal": False, "predict_end": True, "stale_action_value": False},
    "CCEPETS": {"drop_terminal": False, "predict_end": True},
}
"""OmniSafe's errors that Thalweg does without, as settings of ours; `Contest.differs` says them in words."""
AS_IT_IS: Mapping[str, Any] = MappingProxyType({})
NATIVE = {"adapter": "native"}
"""The toy's actions are numbers as they are."""
SPEED_STEPS, CURVE_STEPS, CURVE_UPDATE = 20_000, 100_000, 2_000
UNCUT = {"reset_each_update": False}


def on_policy(
    passes: int,
    minibatch: int,
    peer: Mapping[str, Any],
    ours: Mapping[str, Any],
    curves_peer: Mapping[str, Any] = AS_IT_IS,
    curves_ours: Mapping[str, Any] = AS_IT_IS,
) -> Works:
    """One epoch of OmniSafe's default for the speed; fifty short ones, of larger minibatches and steps, for the curves,
    with what else these need."""

    def work(steps: int, update: int, times: int, batch: int, rate: float, stops: bool) -> Work:
        algo = {"steps_per_epoch": update, "update_iters": times, "batch_size": batch, "kl_early_stop": stops}
        model = {"actor": {"lr": rate}, "critic": {"lr": rate}}
        theirs = {"train_cfgs": {"total_steps": steps}, "algo_cfgs": algo, "model_cfgs": model}
        mine = {"steps_per_update": update, "passes": times, "minibatch": batch}
        mine |= {"learning_rate": rate, "critic_learning_rate": rate, "target_kl": 0.02 if stops else math.inf}
        return Work(steps, merged(QUIET, peer, theirs), {**NATIVE, **UNCUT, **ours, **mine})

    curves = work(CURVE_STEPS, CURVE_UPDATE, 10, 256, 1e-3, True)
    curves = replace(curves, peer=merged(curves.peer, curves_peer), ours={**curves.ours, **curves_ours})
    return Works(work(SPEED_STEPS, SPEED_STEPS, passes, minibatch, 3e-4, False), curves)


def trust_region(peer: Mapping[str, Any], ours: Mapping[str, Any]) -> Works:
    """As `on_policy`, for an algorithm that itself bounds the KL and passes only its critics over the steps."""

    def work(steps: int, update: int) -> Work:
        theirs = {"train_cfgs": {"total_steps": steps}, "algo_cfgs": {"steps_per_epoch": update}}
        return Work(steps, merged(QUIET, peer, theirs), {**NATIVE, **UNCUT, **ours, "steps_per_update": update})

    return Works(work(SPEED_STEPS, SPEED_STEPS), work(CURVE_STEPS, CURVE_UPDATE))


def off_policy(ours: Mapping[str, Any]) -> Works:
    """A gradient step for each step, of OmniSafe's own networks and batches, after a shorter start at random."""
    algo = {"cost_normalize": False, "steps_per_epoch": 1000, "warmup_epochs": 2}
    multiplier = {"cost_limit": LIMIT, "lambda_lr": 3e-4}

    def work(steps: int, start: int) -> Work:
        theirs = {
            "train_cfgs": {"total_steps": steps, "eval_episodes": 0},
            "algo_cfgs": {**algo, "start_learning_steps": start},
            "lagrange_cfgs": multiplier,
        }
        mine = {**NATIVE, "cost_limit": LIMIT, "normalise_cost": False, "multiplier_rate": 3e-4}
        # Epochs are counted from 0, and the first to move the multiplier is the one after `warmup_epochs`.
        first = (algo["warmup_epochs"] + 1) * algo["steps_per_epoch"]
        mine |= {"random_steps": start, "multiplier_warmup": first - start, "steps_per_update": algo["steps_per_epoch"]}
        mine |= {"steps_per_collection": ENVS}
        return Work(steps, merged(QUIET, theirs), {**mine, **ours}, start)

    return Works(work(4_000, 1_000), work(20_000, 2_000))


def planner(
    decisions: int,
    ours: Mapping[str, Any],
    small: Mapping[str, Any] = AS_IT_IS,
    small_ours: Mapping[str, Any] = AS_IT_IS,
) -> Works:
    """So many decisions of OmniSafe's own size after one fit of the model; for the curves `small` ones.

    For OmniSafe an episode has 1,000 decisions, whatever it is: its limit is ten times that of the toy's 100 steps if
    each of them were decided, and `ACTION_REPEAT` times that as they are; and its returns are multiplied to be of so
    long an episode, which makes its weights sharp and ends its searches early. Thalweg is told the same here. OmniSafe
    learns the cost, as Thalweg does, and is told nothing of it.
    """
    limit, length = 10 * ACTION_REPEAT * LIMIT, 1_000 * ACTION_REPEAT

    def work(steps: int, start: int) -> Work:
        theirs = {
            "train_cfgs": {"total_steps": steps},
            "algo_cfgs": {
                "steps_per_epoch": steps,
                "start_learning_steps": start,
                "cost_limit": limit,
            },
            "dynamics_cfgs": {"predict_cost": True},
            "evaluation_cfgs": {"use_eval": False},
        }
        mine = {**NATIVE, "cost_limit": limit, "episode_length": length, "random_steps": start}
        mine |= {"steps_per_collection": 50, "steps_per_update": 50}
        return Work(steps, merged(QUIET, theirs), {**mine, **ours}, start, stamp_every=ACTION_REPEAT)

    curves = work(8_000, 2_000)
    both = replace(curves, peer=merged(curves.peer, small), ours={**curves.ours, **small_ours})
    return Works(work(1_300 + ACTION_REPEAT * decisions, 1_300), both)


LAGRANGE = {"lagrange_cfgs": {"cost_limit": LIMIT}}
IN_ALGO = {"algo_cfgs": {"cost_limit": LIMIT}}
SWIFT, HIGH = 3.0, 100.0
"""Step size and bound of the multiplier in the curves. By OmniSafe's own, 0.035 and for FOCOPS 2, no limit is felt on
either side: the costs of rare falls are small beside standardised advantages of the reward."""
RESETS = "all episodes are cut and begun anew at each update"
TWO = {"OmniSafe": 2, "Thalweg": 2}

CONTESTS = (
    Contest("PPO", "steps", None, on_policy(40, 64, {}, {}), differs=RESETS),
    Contest(
        "PPOLag",
        "steps",
        8.0,
        on_policy(
            *(40, 64, LAGRANGE, {"cost_limit": LIMIT}),
            curves_peer={"lagrange_cfgs": {"lambda_lr": SWIFT}},
            curves_ours={"multiplier_rate": SWIFT},
        ),
        differs=RESETS,
    ),
    Contest(
        "FOCOPS",
        "steps",
        8.0,
        on_policy(
            *(40, 64, LAGRANGE, {"cost_limit": LIMIT, **MENDED["FOCOPS"]}),
            curves_peer={"lagrange_cfgs": {"lambda_lr": SWIFT, "lagrangian_upper_bound": HIGH}},
            curves_ours={"multiplier_rate": SWIFT, "multiplier_max": HIGH},
        ),
        differs="KL [B, 1] and surrogate [B] broadcast to [B, B], so that the trust region of a state weighs all of "
        f"them alike; advantages are divided by 1 + ν; {RESETS}",
    ),
    Contest(
        "P3O",
        "steps",
        None,
        on_policy(10, 64, IN_ALGO, {"cost_limit": LIMIT, **MENDED["P3O"]}),
        differs="the cost's surrogate is not clipped, and the excess lacks its factor, for which 1 over the steps of "
        f"an episode stands here; {RESETS}",
    ),
    Contest(
        "OnCRPO",
        "steps",
        None,
        trust_region(
            merged(IN_ALGO, {"algo_cfgs": {"distance": 0.02}}),
            {"cost_limit": LIMIT, "tolerance": 0.02, **MENDED["OnCRPO"]},
        ),
        differs=f"KL is the mean over the action's dimensions, not their sum; {RESETS}",
    ),
    Contest(
        "DDPGLag",
        "steps",
        2.5,
        off_policy(MENDED["DDPGLag"]),
        threads=TWO,
        differs="targets take the online actor's action",
    ),
    Contest(
        "TD3Lag",
        "steps",
        2.5,
        off_policy(MENDED["TD3Lag"]),
        threads=TWO,
        differs="the cost's target takes the online actor's action, unsmoothed",
    ),
    Contest(
        "SACLag",
        "steps",
        2.5,
        off_policy(MENDED["SACLag"]),
        threads=TWO,
        differs="the cost's target takes the mean action instead of a sampled one",
    ),
    Contest(
        "SafeLOOP",
        "decisions",
        3.0,
        planner(40, {"critic_steps": 10, **MENDED["SafeLOOP"]}),
        envs=1,
        threads=TWO,
        differs="the last step of each episode is thrown away, and with it every cost; imagined episodes never end; "
        "values lag an action behind",
    ),
    Contest(
        "CCEPETS",
        "decisions",
        3.0,
        planner(
            *(15, MENDED["CCEPETS"]),
            small={"planner_cfgs": {"num_samples": 100, "num_elites": 20}},
            small_ours={"samples": 100, "elites": 20},
        ),
        envs=1,
        threads=TWO,
        differs="the last step of each episode is thrown away, and with it every cost; imagined episodes never end",
    ),
)


def contest_named(name: str) -> Contest:
    """The row of an algorithm; raises `KeyError` for one that has none."""
    return {contest.algorithm: contest for contest in CONTESTS}[name]
