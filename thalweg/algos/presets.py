"""The presets of settings, as data, and the settings that depend on the number of environments or on images.

`default` is ours: the fields' defaults, some of which scale with the number of environments. `paper` holds the settings
of the study as far as they are known: the defaults of OmniSafe 0.5, which the study adapted, with its quirks. Each
quirk is a setting that can be tried alone. A preset may repeat a default, so that it survives a change of the default.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from thalweg.algos.common.errors import AlgorithmError

Settings = Mapping[str, Any]

PRESETS = ("default", "paper")

REFERENCE_ENVS = 64
"""The defaults hold for at most this many environments."""
PROPORTIONAL = (
    "steps_per_update",
    "steps_per_collection",
    "random_steps",
    "refit_steps",
    "minibatch",
)
"""Settings that are multiplied by num_envs / REFERENCE_ENVS."""
FEW_ENVS = 16
"""The defaults of `PER_ENV` hold for at most this many environments."""
PER_ENV: Mapping[str, int] = {"critic_warmup_steps": 625, "cost_episodes": 2}
"""Settings that are at least so many times num_envs above `FEW_ENVS`: steps and episodes of each environment."""
INVERSELY_PROPORTIONAL = ("updates_per_step",)
"""Settings that are divided by num_envs / REFERENCE_ENVS."""

FOR_IMAGES: Settings = {"passes": 4, "learning_rate": 3e-4, "curvature_steps": 256}
"""Defaults of on-policy algorithms with policy=cnn, whose gradient steps take hundreds of times as long as those of
a perceptron of codes."""

_ON_POLICY_ROLLOUT: Settings = {
    "steps_per_update": 20_000,
    "critic_decay": 5e-4,  # beside half the squared error; there 1e-3 beside all of it
    "max_grad_norm": 40.0,
    "initial": "kaiming",
    "adapter": "box_literal",
    "reset_each_update": True,
    "discount": 0.99,
    "trace": 0.95,
    "hidden": [64, 64],
    "activation": "tanh",
    "normalise_observations": True,
    "asymmetric_critics": False,
    "critic_warmup_steps": 0,
}
_ON_POLICY: Settings = {
    **_ON_POLICY_ROLLOUT,
    "passes": 40,
    "minibatch": 64,
    "learning_rate": 3e-4,
    "critic_learning_rate": 3e-4,
    "linear_decay": True,
    "target_kl": 0.02,
    "entropy": 0.0,
}
_CLIPPED: Settings = {**_ON_POLICY, "clip": 0.2}
_LIMITED: Settings = {
    "cost_limit": 25.0,
    "cost_limit_schedule": [],
    "standardise_cost": False,
    "cost_discount": 0.99,
    "cost_trace": 0.95,
}
_MULTIPLIER: Settings = {
    "multiplier_rule": "adam",
    "multiplier_violation": "absolute",
    "multiplier_antiwindup": False,
    "multiplier_rate": 0.035,
    "multiplier_gain": 0.0,
    "multiplier_derivative": 0.0,
    "multiplier_smoothing": 0.0,
    "multiplier_warmup": 0,
    "multiplier_settles": False,
    "multiplier_initial": 0.001,
    "cost_window": 50,
}

_PLANNING: Settings = {
    "size": "full",
    "cost_limit": 1.0,
    "cost_limit_schedule": [],
    "plan_budget": "share",
    "episode_length": 5000,  # 1000 over H there, whatever the action repeat
    "action_repeat": 5,
    "drop_terminal": True,
    "predict_end": False,
    "shared_noise": False,
    "planning_discount": 1.0,
    "discount": 0.99,
    "exploration": 0.0,
    "rarity": 1.0,
    "fitting": "refit",
    "hold_out": 0.2,
    "fixed_variance_bounds": True,
    "random_steps": 10_000,
    "bound_targets": False,
    "steps_per_collection": 250,
    "steps_per_update": 20_000,
    "adapter": "box_literal",
}

_OFF_POLICY: Settings = {
    "steps_per_collection": 1,
    "updates_per_step": 1.0,
    "steps_per_update": 2000,
    "minibatch": 256,
    "replay_size": 1_000_000,
    "discount": 0.99,
    "cost_discount": 0.99,
    "hidden": [256, 256],
    "activation": "relu",
    "max_grad_norm": 40.0,
    "cost_critics": 1,
    "target_rate": 0.005,
    "learning_rate": 3e-4,
    "critic_learning_rate": 3e-4,
    "linear_decay": False,
    "normalise_cost": True,
    "cost_floor": False,
    "scale_returns": False,
    "bound_targets": False,
    "asymmetric_critics": False,
    "critic_warmup_steps": 0,
    "normalise_observations": False,
    "initial": "kaiming",
    "adapter": "box_literal",
    "cost_limit": 25.0,
    "cost_limit_schedule": [],
    "cost_window": 50,
    "multiplier_settles": False,
    "multiplier_schedule": "gradient_step",
    "multiplier_rule": "adam",
    "multiplier_violation": "absolute",
    "multiplier_antiwindup": False,
    "multiplier_rate": 1e-5,
    "multiplier_gain": 0.0,
    "multiplier_derivative": 0.0,
    "multiplier_smoothing": 0.0,
    "multiplier_initial": 0.001,
    "multiplier_max": math.inf,
}
_FIRST_MOVE = 202_000  # steps: epochs of 2,000 are counted from 0, and the first to move the multiplier is number 101
_DETERMINISTIC: Settings = {
    **_OFF_POLICY,
    "random_steps": 25_000,
    "multiplier_warmup": _FIRST_MOVE - 25_000,
    "exploration": 0.0,
    "exploration_noise": 0.1,
    "exploration_fades": False,
    "output_decay": 0.0,
    "flight_temperature": 0.0,
}

PAPER: dict[str, Settings] = {
    "PPO": _CLIPPED,
    "PPOLag": {**_CLIPPED, **_LIMITED, **_MULTIPLIER, "multiplier_max": math.inf},
    "FOCOPS": {
        **_ON_POLICY,
        **_LIMITED,
        **_MULTIPLIER,
        "multiplier_max": 2.0,
        "temperature": 1.5,
        "trust_radius": 0.02,
        "mask": "batch",
        "normalise_by_multiplier": True,
    },
    "P3O": {
        **_CLIPPED,
        **_LIMITED,
        "passes": 10,
        "penalty": 20.0,
        "clip_cost": False,
        "limit_scale": "none",
        "centre_minibatches": False,
        "cost_window": 50,
    },
    "OnCRPO": {
        **_ON_POLICY_ROLLOUT,
        **_LIMITED,
        "passes": 10,
        "minibatch": 128,
        "critic_learning_rate": 1e-3,
        "trust_radius": 0.01,
        "radius_settles": False,
        "conjugate_iterations": 15,
        "damping": 0.1,
        "backtracks": 15,
        "backtrack_factor": 0.8,
        "kl_per_dimension": True,
        "tolerance": 2.0,
        "cost_window": 50,
    },
    "DDPGLag": {**_DETERMINISTIC, "target_actor": False, "policy_delay": 1},
    "TD3Lag": {
        **_DETERMINISTIC,
        "cost_target": "online",
        "policy_delay": 2,
        "target_noise": 0.2,
        "target_noise_clip": 0.5,
    },
    "SACLag": {
        **_OFF_POLICY,
        "random_steps": 10_000,
        "multiplier_warmup": _FIRST_MOVE - 10_000,
        "policy_delay": 2,
        "alpha": 0.2,
        "auto_alpha": False,
        "entropy_in_targets": True,
        "cost_target": "mode",
    },
    "CCEPETS": {**_PLANNING, "initial_std": 2.0, "terminal_value": False, "critic_steps": 0},
    "SafeLOOP": {
        **_PLANNING,
        "settled_variance": 1e-3,
        "initial_std": 0.075**0.5,
        "largest_variance": 2.0,
        "cost_over": "max",
        "proposals": 1,
        "proposal_share": 0.0,
        "standardise_returns": False,
        "sharpness": 10.0,
        "cost_sharpness": 100.0,
        "stale_action_value": True,
        "entropy_in_targets": True,
        "auto_alpha": False,
        "alpha": 0.2,
        "alpha_decay": 0.99,
        "standardise_rewards": False,
        "target_rate": 0.005,
        "critic_steps": 50,
        "critics_wait": True,
    },
}
"""Settings of the preset `paper`, by algorithm."""


def settings_for_envs(config: type, num_envs: int) -> dict[str, Any]:
    """Return the settings of a config that follow the number of environments; none up to `FEW_ENVS`.

    Some count what each environment must have flown (`PER_ENV`). Others change above `REFERENCE_ENVS` only: with f
    times as many environments, each of them still takes as many steps between two updates, and a gradient step learns
    from f times as many steps. The number of gradient steps stays the same; each keeps a GPU busier.
    """
    defaults: dict[str, Any] = {field.name: field.default for field in dataclasses.fields(config)}
    each = {name: count * num_envs for name, count in PER_ENV.items() if name in defaults and num_envs > FEW_ENVS}
    found = {name: max(defaults[name], count) for name, count in each.items()}
    factor = num_envs / REFERENCE_ENVS
    if factor <= 1:
        return found
    grown = {name: math.ceil(defaults[name] * factor) for name in PROPORTIONAL if name in defaults}
    return found | grown | {name: defaults[name] / factor for name in INVERSELY_PROPORTIONAL if name in defaults}


def settings_for_images(config: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the defaults of a config that differ for a policy that sees images; none for any other."""
    names = [field.name for field in dataclasses.fields(config)]
    return {name: value for name, value in FOR_IMAGES.items() if name in names} if given.get("policy") == "cnn" else {}


def settings_of(algorithm: str, preset: str) -> Settings:
    """Return the settings of a preset; raise `AlgorithmError` for an unknown preset, listing the known ones."""
    if preset not in PRESETS:
        raise AlgorithmError(f"there is no preset {preset!r}; there are {', '.join(PRESETS)}")
    if preset == "default":
        return {}
    if algorithm not in PAPER:
        named = ", ".join(PAPER)
        raise AlgorithmError(
            f"{algorithm} is not among the algorithms of the study, so it has no preset 'paper': {named}"
        )
    return PAPER[algorithm]
