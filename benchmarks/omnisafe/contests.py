"""Settings of the comparison with OmniSafe, algorithm by algorithm, and the differences that remain.

Settings of OmniSafe are nested as in its own files. Those of Thalweg change the preset "paper", which has OmniSafe's
defaults and repeats its errors, except those that the pages of the algorithms list as not repeated. Both sides
therefore agree in everything that is not set here, and `MENDED` lists where they differ on purpose. `speed` has
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
"""Number of Thalweg's environments; planners have one."""
LIMIT = 0.1
"""Cost limit of an episode, for algorithms that have one."""
ACTION_REPEAT = 5
"""Steps for which a planner repeats an action."""
QUIET = {"logger_cfgs": {"use_tensorboard": False, "use_wandb": False, "save_model_freq": 10**9}}
"""Switches OmniSafe's logging off, which favours it."""


@dataclass(frozen=True)
class Work:
    """A run of either side."""

    steps: int
    peer: Mapping[str, Any]
    ours: Mapping[str, Any]
    start: int = 0
    """Random steps before learning begins, which are not measured."""
    stamp_every: int = 100
    """Steps between two time stamps of OmniSafe."""


class Works(NamedTuple):
    """The two runs of an algorithm: one for its speed, one for its learning curve."""

    speed: Work
    curves: Work


@dataclass(frozen=True)
class Contest:
    """One algorithm on both sides."""

    algorithm: str
    unit: Literal["steps", "decisions"]
    least: float | None
    """Required ratio of Thalweg's units per second to OmniSafe's."""
    works: Works
    differs: str = ""
    """Deviations of OmniSafe 0.5.0 from the algorithm's paper that Thalweg does not share."""
    envs: int = ENVS
    """Number of Thalweg's environments. OmniSafe has one; more would be processes that wait for each other."""
    threads: Mapping[str, int] = field(default_factory=lambda: {"OmniSafe": 1, "Thalweg": 1})
    """PyTorch threads of each side: one or two, whichever is faster."""


def merged(*settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the union of nested mappings; later ones take precedence."""
    result: dict[str, Any] = {}
    for part in settings:
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
"""Settings that avoid OmniSafe's errors in Thalweg; `Contest.differs` describes them."""
AS_IT_IS: Mapping[str, Any] = MappingProxyType({})
NATIVE = {"adapter": "native"}
"""The toy takes continuous actions without an adapter."""
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
    """Return the runs of an on-policy algorithm.

    The speed is measured over one epoch of OmniSafe's default size. The curves have fifty short epochs with larger
    minibatches and learning rates, and the settings `curves_peer` and `curves_ours`.
    """

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
    """Return the runs of an algorithm with a trust region, which fits only its critics in minibatches."""

    def work(steps: int, update: int) -> Work:
        theirs = {"train_cfgs": {"total_steps": steps}, "algo_cfgs": {"steps_per_epoch": update}}
        return Work(steps, merged(QUIET, peer, theirs), {**NATIVE, **UNCUT, **ours, "steps_per_update": update})

    return Works(work(SPEED_STEPS, SPEED_STEPS), work(CURVE_STEPS, CURVE_UPDATE))


def off_policy(ours: Mapping[str, Any]) -> Works:
    """Return the runs of an off-policy algorithm: OmniSafe's networks and batches, but fewer random steps."""
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
    """Return the runs of a planner: as many decisions of OmniSafe's size after one fit of the model, `small` for the
    curves.

    OmniSafe assumes episodes of 1,000 decisions. Its limit is therefore ten times that of the toy's 100 steps, times
    `ACTION_REPEAT`. It also scales returns to episodes of that length, which makes its weights sharp and ends its
    searches early. Thalweg gets the same limit and length here. Both sides learn the cost.
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
"""Step size and upper bound of the multiplier in the curves. With OmniSafe's own, 0.035 and for FOCOPS 2, the limit has
no effect on either side: the costs of rare falls are small compared with standardised advantages of the reward."""
RESETS = "all episodes are cut off and restarted at each update"
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
        differs="KL [B, 1] and surrogate [B] broadcast to [B, B], so that every "
        f"state's trust region weighs all states equally; advantages are divided by 1 + ν; {RESETS}",
    ),
    Contest(
        "P3O",
        "steps",
        None,
        on_policy(10, 64, IN_ALGO, {"cost_limit": LIMIT, **MENDED["P3O"]}),
        differs="the surrogate of the cost is not clipped, and the excess lacks its factor, which is 1 over the steps "
        f"of an episode here; {RESETS}",
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
        differs="the last step of each episode is dropped, and with it every cost; imagined episodes never end; "
        "values lag by one action",
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
        differs="the last step of each episode is dropped, and with it every cost; imagined episodes never end",
    ),
)


def contest_named(name: str) -> Contest:
    """Return the contest of an algorithm; raises `KeyError` for one that has none."""
    return {contest.algorithm: contest for contest in CONTESTS}[name]
