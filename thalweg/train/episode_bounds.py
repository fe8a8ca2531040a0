"""Bounds of values: those that an environment declares by `episode_bounds`, and which of them are left to be learnt.

Rivers declare none: the results that come with the package were made with learnt bounds.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gymnasium.vector import SyncVectorEnv

from thalweg.train.errors import TrainingError

ATTRIBUTE = "episode_bounds"
RETURN, COST, COSTS = "return", "cost", "costs"
"""Keys of `episode_bounds`: two numbers, the smallest and the largest discounted return from any step on; the largest
discounted cost from any step on; and the largest of the kinds that two limits apply to, tight and loose."""
BOUNDS = ("return_bounds", "largest_costs")
"""Settings of algorithms that hold values within what an episode can pay and cost."""
WHAT = {"return_bounds": "returns", "largest_costs": "costs"}
"""What the values of each setting are of."""


def with_declared_bounds(config: Any, env: Any) -> Any:
    """Return the config of an algorithm with the bounds that an environment declares, where it has settings for them
    that are not given.

    Raises `TrainingError` for bounds that are none.
    """
    declared = declared_bounds(env)
    limits = len(getattr(config, "limits", ()))
    found = {
        "return_bounds": declared.get(RETURN, ()),
        "largest_costs": declared.get(COST if limits == 1 else COSTS, ()),
    }
    used = {name: value for name, value in found.items() if value and getattr(config, name, None) == ()}
    return replace(config, **used) if used else config


def declared_bounds(env: Any) -> dict[str, tuple[float, ...]]:
    """Return the bounds that an environment declares, by their keys; none without `episode_bounds`.

    A `SyncVectorEnv` declares what its environments do. Raises `TrainingError` for bounds that are none.
    """
    base = getattr(env, "unwrapped", env)
    declared = getattr(env, ATTRIBUTE, getattr(base, ATTRIBUTE, None))
    if declared is None and isinstance(base, SyncVectorEnv) and base.envs[0].has_wrapper_attr(ATTRIBUTE):
        declared = base.envs[0].get_wrapper_attr(ATTRIBUTE)
    if declared is None:
        return {}
    if not isinstance(declared, Mapping) or not {*declared} <= {RETURN, COST, COSTS}:
        raise TrainingError(
            f"{ATTRIBUTE} must be a mapping with some of the keys {RETURN!r}, {COST!r} and {COSTS!r}, got {declared!r}"
        )
    return {key: _checked(key, value) for key, value in declared.items()}


def _checked(key: str, value: Any) -> tuple[float, ...]:
    """Return the numbers of a declared bound; raises `TrainingError` if they are none."""
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
            f"Values are kept near the range of {what} seen so far, which is the default; {' and '.join(missing)}"
            " would fix it."
        )
    return " ".join(lines)
