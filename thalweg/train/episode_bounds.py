"""Bounds of values: those that an environment declares by `episode_bounds`, and which of them are left to be learnt.

Rivers declare none: the results that come with the package were made with learnt bounds.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv, VectorRewardWrapper, VectorWrapper

from thalweg.train.errors import TrainingError

ATTRIBUTE = "episode_bounds"
RETURN, COST, COSTS = "return", "cost", "costs"
"""Keys of `episode_bounds`: two numbers, the smallest and the largest discounted return from any step on; the largest
discounted cost from any step on; and the largest of the kinds that two limits apply to, tight and loose."""
KEYS = frozenset((RETURN, COST, COSTS))
REWARD_WRAPPERS = (
    gymnasium.RewardWrapper,
    VectorRewardWrapper,
    gymnasium.wrappers.NormalizeReward,
    gymnasium.wrappers.vector.NormalizeReward,
)
"""Gymnasium's wrappers that change rewards."""
SEVERAL_STEPS = (
    gymnasium.wrappers.RepeatAction,
    gymnasium.wrappers.MaxAndSkipObservation,
    gymnasium.wrappers.AtariPreprocessing,
)
"""Gymnasium's wrappers that take several steps as one, so that less is discounted."""
OWN_STEP = ("gymnasium", "thalweg")
"""Packages whose other wrappers change no rewards and no costs."""
BOUNDS = ("return_bounds", "largest_costs")
"""Settings of algorithms that hold values within what an episode can pay and cost."""
WHAT = {"return_bounds": "returns", "largest_costs": "costs"}
"""What the values of each setting are of."""


def with_declared_bounds(config: Any, env: Any) -> Any:
    """Return the config of an algorithm with the bounds that an environment declares, where it has settings for them
    that are not given.

    Raises `TrainingError` for bounds of the wrong kind or order.
    """
    declared = declared_bounds(env)
    limits = len(getattr(config, "limits", ()))
    found = {
        "return_bounds": declared.get(RETURN, ()),
        # Those that are normalised are no longer in the units of what an environment declares.
        "largest_costs": ()
        if getattr(config, "normalise_cost", False)
        else declared.get(COST if limits == 1 else COSTS, ()),
    }
    used = {name: value for name, value in found.items() if value and getattr(config, name, None) == ()}
    return replace(config, **used) if used else config


def declared_bounds(env: Any) -> dict[str, tuple[float, ...]]:
    """Return the bounds that an environment declares, by their keys; an empty dictionary without `episode_bounds`.

    The declaration is that of the outermost layer which has one; a `SyncVectorEnv` declares what its environments do.
    Bounds of what a wrapper around that layer may change are left out, see `_kept`. Raises `TrainingError` for bounds
    of the wrong kind or order.
    """
    declared, kept = None, KEYS
    for layer in _layers(env):
        if (declared := getattr(layer, ATTRIBUTE, None)) is not None:
            break
        kept = kept & _kept(layer)
    if declared is None:
        return {}
    if not isinstance(declared, Mapping) or not {*declared} <= KEYS:
        raise TrainingError(
            f"{ATTRIBUTE} must be a mapping with some of the keys {RETURN!r}, {COST!r} and {COSTS!r}, got {declared!r}"
        )
    checked = {key: _checked(key, value) for key, value in declared.items()}
    return {key: numbers for key, numbers in checked.items() if key in kept}


def _layers(env: Any) -> Iterator[Any]:
    """Yield an environment and what it wraps, from the outside in, single environments of a vector included."""
    while True:
        yield env
        if isinstance(env, gymnasium.Wrapper | VectorWrapper):
            env = env.env
        elif isinstance(env, SyncVectorEnv):
            env = env.envs[0]
        elif (base := getattr(env, "unwrapped", env)) is not env:
            env = base
        else:
            return


def _kept(layer: Any) -> frozenset[str]:
    """Return the keys of the bounds that still hold around a layer.

    Wrappers that change rewards keep those of costs; others of Gymnasium and of this package keep all, but for those
    that take several steps as one. Of a wrapper from elsewhere with a `step` of its own nothing is known.
    """
    if isinstance(layer, REWARD_WRAPPERS):
        return KEYS - {RETURN}
    stepped = next((kind for kind in type(layer).__mro__ if "step" in vars(kind)), object)
    known = stepped.__module__.partition(".")[0] in OWN_STEP
    return KEYS if known and not isinstance(layer, SEVERAL_STEPS) else frozenset()


def _checked(key: str, value: Any) -> tuple[float, ...]:
    """Return the numbers of a declared bound; raises `TrainingError` for others than its key has."""
    try:
        numbers = (float(value),) if key == COST else tuple(map(float, value))
    except (TypeError, ValueError):
        numbers = ()
    finite = all(map(math.isfinite, numbers))
    if key == RETURN and not (len(numbers) == 2 and finite and numbers[0] < numbers[1]):
        expected = "two finite numbers, the smaller one first"
    elif key == COST and not (len(numbers) == 1 and finite and numbers[0] >= 0.0):
        expected = "a finite number, not negative"
    elif key == COSTS and not (len(numbers) == 2 and finite and min(numbers) >= 0.0):
        expected = "two finite numbers, tight and loose, not negative"
    else:
        return numbers
    raise TrainingError(f"{ATTRIBUTE}[{key!r}] must be {expected}, got {value!r}")


def bounds_in_words(config: Any, given: Any) -> str:
    """Return a sentence about the bounds of values which a config leaves to be learnt, or has from the environment;
    empty if there are none.

    `given` is the config without what the environment declares.
    """
    if not getattr(config, "bound_targets", False) or not getattr(config, "terminal_value", True):
        return ""
    known = [name for name in BOUNDS if hasattr(config, name)]
    declared = [f"{name} {getattr(config, name)}" for name in known if getattr(config, name) != getattr(given, name)]
    missing = [name for name in known if not getattr(config, name)]
    lines = [f"Values are kept within {' and '.join(declared)}, which the environment declares."] if declared else []
    if missing:
        what = " and ".join(WHAT[name] for name in missing)
        lines.append(
            f"Values are kept near the range of {what} seen so far, which is the default; for fixed bounds set"
            f" {' and '.join(missing)}."
        )
    return " ".join(lines)
